//! Recorded cycles as what a feed-forward is trained on.
//!
//! `tau_whole_body` is what inverse dynamics gives for the motion that was measured, under the contact
//! wrenches that were measured, and is as late as the filtered motion. `tau_d` is smoothed to the same
//! delay: a mean over twice the delay.

use super::motion::MotionLog;
use robot_config::Robot;
use robot_config::feed_forward::{motion_inputs, neighbours};
use robot_state::{
    CycleRecord, JointCommanded, JointMeasured, Mode, command_flags, measured_flags, torque_flags,
};

/// Modes in which a desired motion is followed by torques.
const FOLLOWING: [Mode; 4] = [
    Mode::InverseDynamics,
    Mode::Position,
    Mode::TorqueFeedbackMotion,
    Mode::LowGainTracking,
];
/// Reason why a sample is useless.
const LOST: u32 = measured_flags::NEVER
    | measured_flags::STALE
    | measured_flags::SETTLING
    | measured_flags::IMPLAUSIBLE;
/// Only the torque limit of these changes `tau_d` itself.
const LIMITED: u32 = command_flags::TORQUE_LIMITED | command_flags::NOT_FINITE;

/// Gathers the motion of a robot's joints, cycle by cycle.
#[derive(Debug)]
pub struct GatherMotion {
    joints: Vec<Joint>,
    sample_period: f64,
    /// Mode of the last cycle, and cycles since it began.
    mode: u32,
    since: usize,
}

#[derive(Debug)]
struct Joint {
    neighbours: [Option<usize>; 2],
    log: MotionLog,
    /// The last desired torques, N·m, oldest first; NaN where there was none.
    desired: Vec<f64>,
}

impl GatherMotion {
    /// Of a robot before its first cycle.
    #[must_use]
    pub fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        let joint = |j: usize| Joint {
            neighbours: neighbours(&robot.model, &p.joints, j),
            log: MotionLog::default(),
            desired: Vec::new(),
        };
        Self {
            joints: (0..p.joints.len()).map(joint).collect(),
            sample_period: p.timing.sample_period,
            mode: Mode::Hold.number(),
            since: 0,
        }
    }

    /// Takes one cycle.
    pub fn take(&mut self, record: &CycleRecord) {
        self.since = if record.mode == self.mode {
            self.since + 1
        } else {
            0
        };
        self.mode = record.mode;
        let follows = Mode::from_number(record.mode).is_some_and(|mode| FOLLOWING.contains(&mode));
        let delay = (record.measured.filter_delay_s / self.sample_period).round() as usize;
        let window = 2 * delay + 1;
        for (j, joint) in self.joints.iter_mut().enumerate() {
            let commanded = &record.commanded.joints[j];
            joint.desired.push(desired(commanded, follows));
            let excess = joint.desired.len().saturating_sub(window);
            joint.desired.drain(..excess);
            let torque = &record.estimated.joints[j].tau_whole_body;
            let sound = follows
                && self.since >= window
                && joint.desired.len() == window
                && torque.flags & torque_flags::VALID != 0
                && record.measured.joints[j].flags & LOST == 0;
            if !sound {
                continue;
            }
            let mean = joint.desired.iter().sum::<f64>() / window as f64;
            let motion = |j: usize| motion(&record.measured.joints[j]);
            joint
                .log
                .inputs
                .push(motion_inputs(j, joint.neighbours, motion));
            joint.log.missing.push(mean - torque.tau);
        }
    }

    /// Gathered samples, by joint in config order.
    #[must_use]
    pub fn logs(self) -> Vec<MotionLog> {
        self.joints.into_iter().map(|joint| joint.log).collect()
    }
}

fn desired(commanded: &JointCommanded, follows: bool) -> f64 {
    let sent = commanded.flags & command_flags::ENGAGED != 0;
    if follows && sent && commanded.flags & LIMITED == 0 {
        commanded.tau_d
    } else {
        f64::NAN
    }
}

fn motion(joint: &JointMeasured) -> [f64; 3] {
    [joint.q_hat, joint.dq_hat, joint.ddq_hat]
}
