//! Whether a motor's current shows its joint's torque.
//!
//! In: the drives' states of the last cycle. Out, for each joint: `false` while its drive is off by its status
//! word, as a brake may then carry all of the torque and the current none of it, and for as long after enabling as
//! brakes may take to let go. A drive without states counts as enabled.

use robot_config::Robot;
use robot_state::{CommandedRecord, DriveState};

/// Time after enabling in which brakes let go, s: before it the current does not show the joint's torque. The simulated
/// ones take 20 ms. Chosen; no experiment recorded.
pub(crate) const SETTLING_S: f64 = 0.5;

#[derive(Debug)]
pub(crate) struct Power {
    joints: Vec<Joint>,
    settling: u32,
}

#[derive(Debug)]
struct Joint {
    has_states: bool,
    /// Cycles until its current counts.
    left: u32,
}

impl Power {
    pub(crate) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        let settling = (SETTLING_S / p.timing.sample_period).ceil() as u32;
        let joint = |joint: &robot_config::JointParameters| {
            let has_states = joint.drive_profile.is_some();
            let left = if has_states { settling } else { 0 };
            Joint { has_states, left }
        };
        Self {
            joints: p.joints.iter().map(joint).collect(),
            settling,
        }
    }

    /// `commanded`: of the last cycle.
    pub(crate) fn update(&mut self, commanded: &CommandedRecord) {
        let powered = [DriveState::Enabled, DriveState::Stopping].map(DriveState::number);
        for (joint, commanded) in self.joints.iter_mut().zip(&commanded.joints) {
            joint.left = if joint.has_states && !powered.contains(&commanded.drive_state) {
                self.settling
            } else {
                joint.left.saturating_sub(1)
            };
        }
    }

    /// Whether the current of this joint counts.
    pub(crate) fn shows_torque(&self, joint: usize) -> bool {
        self.joints.get(joint).is_some_and(|joint| joint.left == 0)
    }
}
