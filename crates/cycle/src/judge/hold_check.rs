//! Joints whose encoders contradict each other, and that can therefore not be held for ever: their drives
//! are switched off, and their brakes hold them.
//!
//! A drive that takes currents has stopped its joint after a while, without the encoders, unless its motor pushes the
//! other way ([`supervisor::RunawayWatch`]). One that takes positions holds its joint as long as both encoders show that
//! it stands ([`supervisor::HoldWatch`]).

use core::f64::consts::PI;

use robot_config::{JointParameters, Robot};
use robot_state::{JointCommanded, JointMeasured, measured_flags};
use supervisor::{
    Held, HoldWatch, HoldWatchParameters, JointCondition, RunawayParameters, RunawayWatch,
};

use crate::emit::has_brake;
use crate::measure::JointReadiness;

/// Time after which a joint that takes currents and cannot be held by its encoders is left to its brake, s: by then it
/// has been stopped. Chosen; no experiment recorded.
const LEFT_TO_BRAKE_S: f64 = 0.5;
/// Way, rad, by which either encoder may show a joint beside its set-point: less than half of the degree that a fault
/// may move a joint, as brakes take their time.
const WAY: f64 = 0.4 * PI / 180.0;
/// Time from the decision to a joint that its brake holds, s: control word, the drive's step, the brake's closing. The
/// simulated brakes take 5 ms. Chosen; no experiment recorded.
const AHEAD_S: f64 = 0.02;
/// Time for which a motor that presses with all that it may is let go on, s. Chosen on a simulated robot that shares no
/// code with this project, on which a joint with reversed encoders ran away at the drive's limit (cases of
/// `rt-tests/second-robot`).
const PRESSED_S: f64 = 0.01;
/// Velocity and torque over their limits from which on a joint that is braked and does not become slower runs away, and
/// for how long, s. Chosen on a simulated arm that shares no code with this project, whose drives took currents, and
/// whose motor began to push the other way: it went on by 127 degrees.
const RUNAWAY_SHARE: [f64; 2] = [0.1, 0.1];
const RUNAWAY_S: f64 = 0.02;

/// What becomes of a joint that cannot be held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Unheld {
    /// The joint is held.
    No,
    /// The joint has been stopped, or nothing shows where it is: it is left to its brake.
    ToBrake,
    /// The joint is not where it is held.
    Away,
}

#[derive(Debug, Clone)]
enum Joint {
    Current {
        /// Cycles left until it is left to its brake; none without one.
        left: Option<u32>,
        watch: Box<RunawayWatch>,
        torque_per_current: f64,
    },
    Position {
        watch: HoldWatch,
        torque_per_current: f64,
    },
}

#[derive(Debug)]
pub(crate) struct HoldCheck {
    joints: Vec<Joint>,
    to_brake: u32,
}

impl HoldCheck {
    pub(crate) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        let cycles = |time: f64| (time / p.timing.sample_period).ceil() as u32;
        let to_brake = cycles(LEFT_TO_BRAKE_S);
        let joint = |joint: &JointParameters| {
            let torque_per_current =
                joint.encoders.gear_ratio * joint.estimator.wave_generator.torque_constant;
            if joint.takes_position() {
                Joint::Position {
                    watch: HoldWatch::new(HoldWatchParameters {
                        way: joint.kind.threshold(WAY),
                        ahead: AHEAD_S / p.timing.sample_period,
                        torque: joint.limits.torque,
                        samples: cycles(PRESSED_S),
                    }),
                    torque_per_current,
                }
            } else {
                let [velocity, torque] = RUNAWAY_SHARE;
                Joint::Current {
                    left: has_brake(joint).then_some(to_brake),
                    watch: Box::new(RunawayWatch::new(RunawayParameters {
                        way: velocity * joint.limits.velocity * p.timing.sample_period,
                        torque: torque * joint.limits.torque,
                        samples: cycles(RUNAWAY_S),
                    })),
                    torque_per_current,
                }
            }
        };
        Self {
            joints: p.joints.iter().map(joint).collect(),
            to_brake,
        }
    }

    /// Joint `j` takes currents, and has a brake.
    pub(crate) fn brakes(&self, j: usize) -> bool {
        matches!(
            self.joints.get(j),
            Some(Joint::Current { left: Some(_), .. })
        )
    }

    /// Takes a cycle of joint `j`, which has set-points; `stopped`: a fault is latched.
    pub(crate) fn update(
        &mut self,
        j: usize,
        (condition, readiness): (&JointCondition, &JointReadiness),
        (measured, commanded): (&JointMeasured, &JointCommanded),
        stopped: bool,
    ) -> Unheld {
        let in_doubt = stopped && condition.distrusted;
        match self.joints.get_mut(j) {
            Some(Joint::Current { left, watch, .. }) if !in_doubt => {
                *left = left.map(|_| self.to_brake);
                watch.rest();
            }
            Some(Joint::Current {
                left,
                watch,
                torque_per_current,
            }) => {
                *left = left.map(|left| left.saturating_sub(1));
                if *left == Some(0) {
                    return Unheld::ToBrake;
                }
                if watch.update(readiness.shown, *torque_per_current * commanded.current_c) {
                    return Unheld::Away;
                }
            }
            Some(Joint::Position { watch, .. }) if !in_doubt => watch.rest(),
            // The drive's own loop may run on the encoder that is flat, and nothing shows where the joint is.
            Some(Joint::Position { .. }) if readiness.blind => return Unheld::ToBrake,
            Some(Joint::Position {
                watch,
                torque_per_current,
            }) if measured.flags & measured_flags::MISSED == 0 => {
                let held = Held {
                    angles: readiness.shown,
                    torque: *torque_per_current * measured.current,
                    set_point: commanded.q_c,
                };
                if watch.update(&held) {
                    return Unheld::Away;
                }
            }
            _ => {}
        }
        Unheld::No
    }
}
