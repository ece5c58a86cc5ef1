//! Torque check: an F/T sensor or IMU that errs, found by motor current.
//!
//! In: of the joints without a link-side encoder whose torque is fed back, that torque, from F/T sensors and IMU,
//! and the one by motor current less friction. Out: the torque is not valid while both have changed unlike. The
//! current is late by the same filters, so that motion and load change both alike, whatever their rate:
//!
//! ```text
//! d = h * (k_1 i - k_2 omega - k_3 sign(omega) - J omega') - tau      must stay near its mean of the last time
//! ```
//!
//! The mean over [`SLOW_S`] takes up what is wrong all the time: offset, torque constant, friction that a joint at
//! rest carries. What remains are friction that reverses and errors of both models as the torque changes. Beyond
//! them either a sensor errs, or something touches the limb where no sensor measures it. In both cases the motor's
//! torque is the right one. The mean then stands, until both agree again; drives that are switched off and a tare
//! begin anew.

use estimators::filter_bank::FilterBank;
use problem::Problem;
use robot_config::{JointParameters, Robot};
use robot_state::{Event, JointMeasured, command_flags, measured_flags};
use supervisor::count_in_a_row;

use super::{Check, Evidence, Verdict};
use crate::estimate::{UNUSABLE, valid};
use crate::events::Subject;

/// Time constant of the mean, s. Chosen as [`SHARE`].
const SLOW_S: f64 = 0.5;
/// Change by which both may differ, share of the torque limit. Chosen on the simulated leg without link-side encoders:
/// none of 60 sound runs is found, and F/T sensors that err are (docs/results/motor-alone.md).
const SHARE: f64 = 0.05;
/// Further difference per change of the torque: torque constant, inertias, friction by the load. Chosen as [`SHARE`].
const MODEL_SHARE: f64 = 0.3;
/// Further difference, of the Coulomb friction: 1 that is foreseen wrongly, from one side to the other.
/// Chosen as [`SHARE`].
const REVERSAL: f64 = 1.25;
/// Standard deviations of the torque by which both may differ besides. Chosen as [`SHARE`].
const SIGMAS: f64 = 3.0;
/// Samples in a row.
const SAMPLES: u32 = 5;
/// Share of the tolerance within which both agree again. Chosen as [`SHARE`].
const AGREE_SHARE: f64 = 0.5;

/// Means of a joint, N·m.
#[derive(Debug, Clone, Copy)]
struct Means {
    difference: f64,
    tau: f64,
    /// Samples in a row that contradict, or agree again.
    over: u32,
    contradicts: bool,
}

#[derive(Debug, Clone)]
struct Joint {
    index: usize,
    /// Difference that is always explained, N·m.
    explained: f64,
    /// Means of both torques; none before the first sample.
    means: Option<Means>,
}

/// The joints of a robot whose torque is fed back without a link-side encoder; of most robots none.
#[derive(Debug)]
struct TorqueCheck {
    joints: Vec<Joint>,
    /// h: the smoothing of the torque, on the torques by current.
    smoothed: FilterBank,
    currents: Vec<f64>,
}

/// # Errors
/// A filter that cannot be used.
pub(super) fn make(robot: &Robot) -> Result<Box<dyn Check>, Problem> {
    let p = &robot.parameters;
    let joints: Vec<_> = (p.joints.iter().enumerate())
        .filter(|(_, joint)| {
            let fed_back = joint.gains.k_p > 0.0 || joint.gains.k_i > 0.0;
            !joint.has_link_encoder && fed_back
        })
        .map(|(index, joint)| Joint::new(index, joint))
        .collect();
    Ok(Box::new(TorqueCheck {
        smoothed: FilterBank::new(joints.len(), p.filters.long.sensor)?,
        currents: vec![f64::NAN; joints.len()],
        joints,
    }))
}

impl Check for TorqueCheck {
    fn retare(&mut self) {
        self.joints.iter_mut().for_each(|joint| joint.means = None);
    }

    fn judge(&mut self, evidence: &Evidence<'_>, verdict: &mut Verdict<'_>) {
        let (measured, estimated) = (&evidence.measured.joints, &evidence.estimated.joints);
        if self.joints.is_empty() {
            return;
        }
        for (joint, current) in self.joints.iter().zip(&mut self.currents) {
            let (measured, estimated) = (measured.get(joint.index), estimated.get(joint.index));
            *current = match (measured, estimated) {
                (Some(measured), Some(estimated)) if has_current(measured) => {
                    estimated.tau_current.tau
                }
                // Bridged.
                _ => f64::NAN,
            };
        }
        self.smoothed.update(&self.currents);
        for (channel, joint) in self.joints.iter_mut().enumerate() {
            let index = joint.index;
            let engaged = (evidence.commanded.joints.get(index))
                .is_some_and(|joint| joint.flags & command_flags::ENGAGED != 0);
            let Some(estimated) = estimated.get(index) else {
                continue;
            };
            if !engaged || self.smoothed.settling(channel) {
                // Off, brakes carry the torque and the current none of it.
                joint.means = None;
                continue;
            }
            let by_current = self.smoothed.values().get(channel);
            let (Some(&by_current), Some(torque)) = (by_current, valid(&estimated.tau_whole_body))
            else {
                continue;
            };
            let before = joint.contradicts();
            joint.update(by_current, (torque.tau, torque.sigma), evidence.dt);
            if joint.contradicts() {
                verdict.contradict(index);
                verdict.lasts(Event::FtImplausible, Subject::Joint(index), !before);
            }
        }
    }
}

/// The motor's current can be used.
fn has_current(measured: &JointMeasured) -> bool {
    let unsound = UNUSABLE | measured_flags::FLAT | measured_flags::SATURATED;
    measured.flags & (unsound | measured_flags::MISSED) == 0
}

impl Joint {
    fn new(index: usize, joint: &JointParameters) -> Self {
        let friction = joint.encoders.gear_ratio * joint.estimator.wave_generator.friction;
        Self {
            index,
            explained: REVERSAL * friction + SHARE * joint.limits.torque,
            means: None,
        }
    }

    fn contradicts(&self) -> bool {
        self.means.is_some_and(|means| means.contradicts)
    }

    fn update(&mut self, by_current: f64, (tau, sigma): (f64, f64), dt: f64) {
        let difference = by_current - tau;
        let means = self.means.get_or_insert(Means {
            difference,
            tau,
            over: 0,
            contradicts: false,
        });
        let change = (tau - means.tau)
            .abs()
            .min((by_current - means.difference - means.tau).abs());
        let tolerance = self.explained + MODEL_SHARE * change + SIGMAS * sigma;
        let way = (difference - means.difference).abs();
        let turns = if means.contradicts {
            way < AGREE_SHARE * tolerance
        } else {
            way > tolerance
        };
        if count_in_a_row(&mut means.over, turns) >= SAMPLES {
            (means.contradicts, means.over) = (!means.contradicts, 0);
        }
        if !means.contradicts && means.over == 0 {
            means.difference += dt / SLOW_S * (difference - means.difference);
            means.tau += dt / SLOW_S * (tau - means.tau);
        }
    }
}
