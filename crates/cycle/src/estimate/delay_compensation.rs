//! Predict: every joint's torque now, from a fast source that drifts and a late one that does not.

use estimators::compliance::ComplianceEstimator;
use estimators::compliance::JointEstimatorParameters;
use estimators::filter_bank::FilterBank;
use estimators::joint::JointTorqueEstimator;
use robot_config::{JointParameters, Robot};
use robot_state::{CycleRecord, Event, measured_flags, torque_flags};
use whole_body::{DelayCompensator, DelayCompensatorParameters, DelayedTorque, WholeBody};

use super::usable::{all_flags, valid};
use crate::error::CycleError;
use crate::events::Counts;
use crate::measure::{Measure, whole_body};

/// The torque now of all joints.
#[derive(Debug)]
pub(crate) struct Predict {
    /// From F/T sensors and IMU through short filters.
    whole_body: WholeBody,
    joints: Vec<Joint>,
}

#[derive(Debug)]
struct Joint {
    /// The compliance without its low-pass, which would be late; none where a joint file's
    /// estimators are as fast as they can.
    fast: Option<ComplianceEstimator>,
    compensator: DelayCompensator,
    torque_limit: f64,
}

impl Predict {
    pub(crate) fn new(robot: &Robot) -> Result<Self, CycleError> {
        let p = &robot.parameters;
        let kernel = FilterBank::new(1, p.filters.short.sensor)?.kernel();
        let joint = |joint: &JointParameters| Joint {
            fast: joint.calibration.is_none().then(|| {
                ComplianceEstimator::new(JointEstimatorParameters {
                    low_pass_pole: 0.0,
                    ..joint.estimator.clone()
                })
            }),
            compensator: DelayCompensator::new(DelayCompensatorParameters {
                sample_period: p.timing.sample_period,
                kernel: kernel.clone(),
                fast_sigma: resolution(&joint.estimator),
                torque_limit: joint.limits.torque,
            }),
            torque_limit: joint.limits.torque,
        };
        Ok(Self {
            whole_body: whole_body(robot, p.filters.short)?,
            joints: p.joints.iter().map(joint).collect(),
        })
    }

    /// `contacts`: shares of the sets of contacts.
    pub(crate) fn update(
        &mut self,
        measure: &Measure,
        contacts: &[f64],
        record: &mut CycleRecord,
        counts: &mut Counts,
    ) {
        self.whole_body.blend(contacts);
        let late = self.whole_body.update(&measure.quick().input());
        // Short filters have settled when the long ones, which the flags are about, have.
        let unusable = measured_flags::NEVER | measured_flags::SETTLING | measured_flags::STALE;
        let usable = late.valid && all_flags(record) & unusable == 0;
        let samples = measure.samples().iter().enumerate();
        for ((own, (j, sample)), joint) in
            (self.joints.iter_mut().zip(samples)).zip(&mut record.joints)
        {
            let fast = match &mut own.fast {
                Some(compliance) => compliance.update(sample),
                None => joint.tau_encoder,
            };
            let (tau, sigma) = (late.tau[j], late.sigma[j]);
            let believed = usable && tau.abs() <= own.torque_limit;
            let late = believed.then_some(DelayedTorque { tau, sigma });
            let fast = valid(&fast).map(|fast| fast.tau);
            joint.tau_hat = own.compensator.update(fast, late);
            if joint.tau_hat.flags & torque_flags::SATURATED != 0 {
                counts.add(Event::TorqueSaturated);
            }
        }
    }
}

/// Standard deviation of the compliance's torque that counts of the encoders explain: a count hides a
/// uniform error whose variance is its square over 12.
fn resolution(e: &JointEstimatorParameters) -> f64 {
    let counts = (e.motor_resolution / e.gear_ratio).hypot(e.link_resolution);
    e.compliance.k_fs0 * counts / 12f64.sqrt()
}
