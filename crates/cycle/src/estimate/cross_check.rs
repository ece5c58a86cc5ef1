//! Cross-check: comparison of the torques from encoders, F/T sensors and current.
//!
//! In: the estimates of the cycle. Out: `tau_current`, and the warnings 204 to 208, each naming the
//! joint or sensor that is probably wrong.

use estimators::current_based::{CurrentEstimator, CurrentParameters};
use estimators::joint::{JointSample, JointTorqueEstimator};
use robot_config::{CrossCheckSettings, JointParameters, Robot};
use robot_state::{EstimatedRecord, Event, JointMeasured, TorqueEstimate};
use whole_body::{Cause, CrossCheck, CrossCheckParameters, Sources, WholeBody};

use super::usable::valid;
use crate::events::{Counts, Subject};

/// Pole of the low-pass of the torque from current.
const POLE: f64 = 0.9;
/// |dq| over which friction changes sign, rad/s.
pub(super) const SIGN_SMOOTHING: f64 = 0.02;

/// The cross-check of a robot, with the torque from current that it needs.
#[derive(Debug)]
pub(crate) struct CrossCheckStage {
    check: CrossCheck,
    currents: Vec<CurrentEstimator>,
    sources: Vec<Sources>,
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
            encoder_threshold: limits(settings.encoder_share),
            current_load: limits(settings.current_load_share),
            current_ratio: settings.current_ratio,
            residual_ratio: settings.residual_ratio,
            residual_floor: [0.5, 0.05],
        };
        let n = p.joints.len();
        Self {
            check: CrossCheck::new(whole_body, check),
            currents: (p.joints.iter())
                .map(|j| CurrentEstimator::new(current(j, p.timing.sample_period)))
                .collect(),
            sources: vec![Sources::default(); n],
            reported: Vec::with_capacity(3 * n + 2 * p.ft_sensors.len()),
        }
    }

    /// Starts again after a tare, which changes the F/T sensors' readings.
    pub(crate) fn reset(&mut self) {
        self.check.reset();
    }

    pub(crate) fn update(
        &mut self,
        samples: &[JointSample],
        measured: &[JointMeasured],
        whole_body: &WholeBody,
        estimated: &mut EstimatedRecord,
        counts: &mut Counts,
    ) {
        let valid = |e: &TorqueEstimate| valid(e).map(|e| e.tau);
        for (j, sample) in samples.iter().enumerate() {
            let joint = &mut estimated.joints[j];
            let sample = JointSample {
                dq: measured[j].dq,
                ..*sample
            };
            joint.tau_current = self.currents[j].update(&sample);
            self.sources[j] = Sources {
                encoder: valid(&joint.tau_encoder),
                whole_body: valid(&joint.tau_whole_body),
                current: valid(&joint.tau_current),
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

/// Parameters of the torque from current, link side.
fn current(joint: &JointParameters, sample_period: f64) -> CurrentParameters {
    let e = &joint.estimator;
    let (n, motor) = (e.gear_ratio, &e.wave_generator);
    CurrentParameters {
        k_1: n * motor.torque_constant,
        k_2: n * n * motor.viscous_friction,
        k_3: n * motor.friction,
        k_4: 0.0,
        inertia: n * n * joint.rotor_inertia,
        offset: 0.0,
        sign_smoothing: SIGN_SMOOTHING,
        low_pass_pole: POLE,
        sigma: 0.0,
        sample_period,
        // A wrong torque constant must show, not saturate.
        torque_limit: 10.0 * joint.limits.torque,
    }
}
