//! Cross-check: comparison of the torques from encoders, F/T sensors and current.
//!
//! In: the estimates of the cycle. Out: the warnings 204 to 208, each naming the joint or sensor that is
//! probably wrong. Of a joint without a link-side encoder F/T sensors and current are compared: the current
//! stands where else the encoders do, with the friction that its torque is uncertain by.

use robot_config::{JointParameters, Robot};
use robot_state::{Event, TorqueEstimate};
use whole_body::{Cause, CrossCheck, CrossCheckParameters, Sources, WholeBody};

use super::{Check, Evidence, Verdict};
use crate::estimate::valid;
use crate::events::Subject;

#[derive(Debug)]
struct CrossCheckStage {
    check: CrossCheck,
    sources: Vec<Sources>,
    /// The joint has no link-side encoder.
    by_current: Vec<bool>,
    /// Causes that were found in the cycle before.
    reported: Vec<Cause>,
}

/// Makes the check; none where it is not configured.
pub(super) fn make(robot: &Robot, whole_body: &WholeBody) -> Option<Box<dyn Check>> {
    let p = &robot.parameters;
    let settings = p.cross_check.as_ref()?;
    let joints = p.joints.iter();
    let threshold = |j: &JointParameters| settings.encoder_share * j.limits.torque + friction(j);
    let load = |j: &JointParameters| settings.current_load_share * j.limits.torque;
    let check = CrossCheckParameters {
        sample_period: p.timing.sample_period,
        window: p.filters.window,
        average: settings.average,
        hold: settings.hold,
        encoder_threshold: joints.clone().map(threshold).collect(),
        current_load: joints.clone().map(load).collect(),
        current_ratio: settings.current_ratio,
        residual_ratio: settings.residual_ratio,
        residual_floor: [0.5, 0.05],
    };
    let n = p.joints.len();
    Some(Box::new(CrossCheckStage {
        check: CrossCheck::new(whole_body, check),
        sources: vec![Sources::default(); n],
        by_current: joints.map(|j| !j.has_link_encoder).collect(),
        reported: Vec::with_capacity(3 * n + 2 * p.ft_sensors.len()),
    }))
}

impl Check for CrossCheckStage {
    fn retare(&mut self) {
        self.check.reset();
    }

    fn judge(&mut self, evidence: &Evidence<'_>, verdict: &mut Verdict<'_>) {
        let (estimated, power) = (evidence.estimated, evidence.power);
        let valid = |e: &TorqueEstimate| valid(e).map(|e| e.tau);
        let joints = estimated.joints.iter().zip(&self.by_current);
        for (j, (sources, (joint, by_current))) in self.sources.iter_mut().zip(joints).enumerate() {
            let current = valid(&joint.tau_current).filter(|_| power.shows_torque(j));
            *sources = Sources {
                encoder: if *by_current {
                    current
                } else {
                    valid(&joint.tau_encoder)
                },
                whole_body: valid(&joint.tau_whole_body),
                current,
                current_sigma: joint.tau_current.sigma,
            };
        }
        let found = self.check.update(&self.sources, evidence.whole_body);
        for (k, cause) in found.iter().enumerate() {
            let (event, subject) = event(*cause);
            verdict.lasts(event, subject, !self.reported.contains(cause));
            if k == 0 {
                verdict.warn(event, subject);
            }
        }
        self.reported.clear();
        self.reported.extend_from_slice(found);
    }
}

/// The event of a cause, and the joint or sensor that it is about.
fn event(cause: Cause) -> (Event, Subject) {
    match cause {
        Cause::EncoderSlip { joint } => (Event::EncoderSlip, Subject::Joint(joint)),
        Cause::FtDrift { sensor } => (Event::FtDrift, Subject::FtSensor(sensor)),
        Cause::TorqueConstant { joint } => (Event::TorqueConstant, Subject::Joint(joint)),
        Cause::TorqueSign { joint } => (Event::TorqueSign, Subject::Joint(joint)),
        Cause::MissingContact { sensor } => (Event::MissingContact, Subject::FtSensor(sensor)),
    }
}

/// Further difference that is normal, N·m: what friction makes of the torque by current where that stands
/// for the encoders', as it may point either way and exceed sliding friction at rest.
fn friction(joint: &JointParameters) -> f64 {
    let coulomb = joint.encoders.gear_ratio * joint.estimator.wave_generator.friction;
    if joint.has_link_encoder {
        0.0
    } else {
        STICTION * coulomb
    }
}

/// Greatest friction at rest over that in motion: as `STICTION` of joint/law/motor_side.rs.
const STICTION: f64 = 1.5;
