//! Cross-check: comparison of the torques from encoders, F/T sensors and current.
//!
//! In: the estimates of the cycle. Out: the warnings 204 to 208, each naming the joint or sensor that is
//! probably wrong. Of a joint without a link-side encoder F/T sensors and current are compared: the current
//! stands where else the encoders do, with the friction that its torque is uncertain by.

use robot_config::{CrossCheckSettings, JointParameters, Robot};
use robot_state::{EstimatedRecord, Event, TorqueEstimate};
use whole_body::{Cause, CrossCheck, CrossCheckParameters, Sources, WholeBody};

use super::power::Power;
use super::usable::valid;
use crate::events::{Counts, Subject};

/// The cross-check of a robot.
#[derive(Debug)]
pub(crate) struct CrossCheckStage {
    check: CrossCheck,
    sources: Vec<Sources>,
    /// The joint has no link-side encoder.
    by_current: Vec<bool>,
    /// Causes that were found in the cycle before.
    reported: Vec<Cause>,
}

impl CrossCheckStage {
    pub(crate) fn new(
        robot: &Robot,
        whole_body: &WholeBody,
        settings: &CrossCheckSettings,
    ) -> Self {
        let p = &robot.parameters;
        let limits = |share: f64| p.joints.iter().map(|j| share * j.limits.torque).collect();
        let check = CrossCheckParameters {
            sample_period: p.timing.sample_period,
            window: p.filters.window,
            average: settings.average,
            hold: settings.hold,
            encoder_threshold: (p.joints.iter())
                .map(|j| settings.encoder_share * j.limits.torque + friction(j))
                .collect(),
            current_load: limits(settings.current_load_share),
            current_ratio: settings.current_ratio,
            residual_ratio: settings.residual_ratio,
            residual_floor: [0.5, 0.05],
        };
        let n = p.joints.len();
        Self {
            check: CrossCheck::new(whole_body, check),
            sources: vec![Sources::default(); n],
            by_current: p.joints.iter().map(|j| !j.has_link_encoder).collect(),
            reported: Vec::with_capacity(3 * n + 2 * p.ft_sensors.len()),
        }
    }

    /// Starts again after a tare, which changes the F/T sensors' readings.
    pub(crate) fn reset(&mut self) {
        self.check.reset();
    }

    pub(crate) fn update(
        &mut self,
        whole_body: &WholeBody,
        power: &Power,
        estimated: &mut EstimatedRecord,
        counts: &mut Counts,
    ) {
        let valid = |e: &TorqueEstimate| valid(e).map(|e| e.tau);
        let joints = estimated.joints.iter().zip(&self.by_current);
        for (j, (sources, (joint, by_current))) in self.sources.iter_mut().zip(joints).enumerate() {
            let current = valid(&joint.tau_current).filter(|_| power.shows_torque(j));
            *sources = Sources {
                encoder: match by_current {
                    true => current,
                    false => valid(&joint.tau_encoder),
                },
                whole_body: valid(&joint.tau_whole_body),
                current,
                current_sigma: joint.tau_current.sigma,
            };
        }
        let found = self.check.update(&self.sources, whole_body);
        for cause in found {
            let begins = !self.reported.contains(cause);
            let (event, subject) = event(*cause);
            counts.lasting(event, subject, begins);
        }
        let (warning, subject) = found.first().map_or((0, 0), |cause| {
            let (event, subject) = event(*cause);
            (event.number(), subject.index())
        });
        (estimated.warning, estimated.warning_subject) = (warning, subject);
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
    match joint.has_link_encoder {
        true => 0.0,
        false => STICTION * coulomb,
    }
}

/// Greatest friction at rest over that in motion.
const STICTION: f64 = 1.5;
