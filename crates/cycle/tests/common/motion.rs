//! True motion of the joints while nobody asks for motion, beside the record's.

use super::Bench;
use robot_state::{CycleRecord, RobotState, command_flags};

/// Greatest uncommanded displacement, rad, of slides what counts as such, and share of the velocity limit.
const DISPLACEMENT: f64 = 1.0 * std::f64::consts::PI / 180.0;
const SPEED_SHARE: f64 = 0.1;

/// Motion of the joints since the beginning, beyond the motion asked for.
pub(crate) struct Motion {
    start: Vec<f64>,
    displacement: f64,
    speed_share: f64,
}

impl Motion {
    pub(crate) fn of(bench: &Bench) -> Self {
        Self {
            start: bench.plant.truth().joints.iter().map(|j| j.q).collect(),
            displacement: 0.0,
            speed_share: 0.0,
        }
    }

    pub(crate) fn take(&mut self, bench: &Bench) {
        let joints = bench.plant.truth().joints.iter().zip(&self.start);
        for ((joint, start), parameters) in joints.zip(&bench.robot.parameters.joints) {
            let way = (joint.q - start).abs() / parameters.kind.threshold(1.0);
            self.displacement = self.displacement.max(way);
            let share = joint.dq.abs() / parameters.limits.velocity;
            self.speed_share = self.speed_share.max(share);
        }
    }

    /// Greatest way of a joint, degrees.
    pub(crate) fn displacement_deg(&self) -> f64 {
        self.displacement.to_degrees()
    }

    /// Greatest share of a velocity limit, 1.
    pub(crate) fn speed_share(&self) -> f64 {
        self.speed_share
    }

    pub(crate) fn assert_small(&self, what: &str) {
        let (way, share) = (self.displacement, self.speed_share);
        assert!(way < DISPLACEMENT, "{what}: {:.2} deg", way.to_degrees());
        assert!(
            share < SPEED_SHARE,
            "{what}: {:.1} % of the velocity limit",
            100.0 * share
        );
    }
}

pub(crate) fn state(record: &CycleRecord) -> RobotState {
    RobotState::from_number(record.state).unwrap()
}

pub(crate) fn engaged(record: &CycleRecord) -> usize {
    let joints = record.commanded.joints.iter();
    joints
        .filter(|j| j.flags & command_flags::ENGAGED != 0)
        .count()
}
