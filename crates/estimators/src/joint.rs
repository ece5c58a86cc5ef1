//! What every estimator of one joint's torque shares: its sample, its parameters, its trait.

use crate::compliance::ComplianceParameters;
use crate::kinematic_error::KinematicErrorParameters;
use crate::wave_generator::WaveGeneratorParameters;
use robot_state::TorqueEstimate;

/// A joint at one instant, as the estimators want it: unwrapped, free of skew, SI.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointSample {
    /// q: link-side angle, rad.
    pub q: f64,
    /// theta: motor-side angle, rad, unwrapped.
    pub theta: f64,
    /// dq: link-side velocity, rad/s.
    pub dq: f64,
    /// omega: motor-side velocity, rad/s.
    pub omega: f64,
    /// i: motor current, A.
    pub current: f64,
    /// Bits of `robot_state::measured_flags`.
    pub flags: u32,
}

/// A source of one joint's torque that is fed once a cycle.
///
/// Every implementation passes the same conformance suite (`tests/conformance`): finite output
/// for any input, saturation and never wrapping, recovery after a gap, the same output from the
/// same samples, no allocation, sign symmetry, continuity.
pub trait JointTorqueEstimator {
    /// Takes one sample and gives the torque at its instant.
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate;
    /// Forgets every sample.
    fn reset(&mut self);
}

/// An estimator of any kind.
pub type AnyEstimator = Box<dyn JointTorqueEstimator + Send>;

/// Everything that leads from a joint's encoders and current to its torque.
#[derive(Debug, Clone, PartialEq)]
pub struct JointEstimatorParameters {
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Pole of the torque's low-pass, 0 (none) to below 1 (Z prints 0.95 at 1 kHz).
    pub low_pass_pole: f64,
    /// One count of the link-side encoder, rad, link side.
    pub link_resolution: f64,
    /// One count of the motor-side encoder, rad, motor side.
    pub motor_resolution: f64,
    /// Standard deviation of the torsion that the model does not explain (hysteresis, residual
    /// kinematic error), rad, link side; identified, 0 if unknown.
    pub torsion_sigma: f64,
    /// Standard deviation of the current, A; 0 if unknown.
    pub current_sigma: f64,
    /// Compliance of flexspline and wave generator.
    pub compliance: ComplianceParameters,
    /// From current to the wave generator's torque.
    pub wave_generator: WaveGeneratorParameters,
    /// Kinematic error.
    pub kinematic_error: KinematicErrorParameters,
}
