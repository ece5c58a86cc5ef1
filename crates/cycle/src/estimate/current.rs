//! Current: the torque from motor current less friction (D3).
//!
//! In: samples and velocities. Out: `tau_current` of the joints for which it is used: all with
//! `[cross_check]`, and those without a link-side encoder, where it is the torque without delay. There the
//! velocity is the motor's, and the low-pass is shorter: the delay compensation averages by itself.

use estimators::current_based::{CurrentEstimator, CurrentParameters, NO_PRESLIDING};
use estimators::joint::{JointSample, JointTorqueEstimator};
use robot_config::{JointParameters, Robot};
use robot_state::{JointEstimated, JointMeasured};

/// Poles of the low-pass of the torque from current: with a link-side encoder, and without. At 1 kHz they are 9.5 ms
/// and 1.4 ms; at another rate these times change with the period. Chosen; no experiment recorded.
const POLES: [f64; 2] = [0.9, 0.5];
/// |dq| over which friction changes sign, rad/s of a revolute joint. Chosen; no experiment recorded.
const SIGN_SMOOTHING: f64 = 0.02;

/// |dq| over which the joint's friction changes sign, rad/s.
pub(crate) fn sign_smoothing(joint: &JointParameters) -> f64 {
    joint.kind.threshold(SIGN_SMOOTHING)
}

/// The torque from current of one joint.
#[derive(Debug)]
struct Joint {
    estimator: CurrentEstimator,
    /// 1/N where its velocity is the motor's.
    by_motor: Option<f64>,
}

/// The torques from current of a robot's joints; none where they are not used.
#[derive(Debug)]
pub(super) struct CurrentTorques {
    joints: Vec<Option<Joint>>,
}

impl CurrentTorques {
    pub(super) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        let period = p.timing.sample_period;
        let used = |joint: &&JointParameters| p.cross_check.is_some() || !joint.has_link_encoder;
        let joint = |joint: &JointParameters| Joint {
            estimator: CurrentEstimator::of_data_sheet(current(joint, period)),
            by_motor: (!joint.has_link_encoder).then_some(1.0 / joint.encoders.gear_ratio),
        };
        let joints = p.joints.iter();
        Self {
            joints: joints.map(|j| Some(j).filter(used).map(joint)).collect(),
        }
    }

    pub(super) fn update(
        &mut self,
        samples: &[JointSample],
        measured: &[JointMeasured],
        estimated: &mut [JointEstimated],
    ) {
        let inputs = samples.iter().zip(measured).zip(estimated);
        for (own, ((sample, measured), joint)) in self.joints.iter_mut().zip(inputs) {
            let Some(own) = own else { continue };
            let dq = own
                .by_motor
                .map_or(measured.dq, |share| share * measured.omega);
            joint.tau_current = own.estimator.update(&JointSample { dq, ..*sample });
        }
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
        sign_smoothing: sign_smoothing(joint),
        presliding: NO_PRESLIDING,
        gear_ratio: n,
        low_pass_pole: POLES[usize::from(!joint.has_link_encoder)],
        sigma: 0.0,
        sample_period,
        // A wrong torque constant must show, not saturate.
        torque_limit: 10.0 * joint.limits.torque,
    }
}
