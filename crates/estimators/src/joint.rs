//! The sample that every estimator of one joint's torque takes, and the trait of such an estimator.

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
    /// Feed-forward: torque that a controller or a rigid-body model expects, N·m; none where there is none.
    pub feed_forward: Option<f64>,
    /// Bits of `robot_state::measured_flags`, and [`DRIVE_OFF`].
    pub flags: u32,
}

/// Bit of a sample's flags beside those of `robot_state::measured_flags`: the drive is off, or has just been switched
/// on. A brake may carry the torque, of which the current then shows nothing.
pub const DRIVE_OFF: u32 = 1 << 31;

/// A source of one joint's torque that is fed once a cycle.
///
/// Every implementation passes the same conformance suite (`tests/conformance`): finite output
/// for any input, saturation and never wrapping, recovery after a gap, the same output from the
/// same samples, no allocation, sign symmetry, continuity.
pub trait JointTorqueEstimator {
    /// Takes one sample and gives the torque at its instant.
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate;
    /// The last sample's torque without a filter's delay, N·m; none where the estimate has no filter,
    /// the sample was not usable or its torque is saturated.
    fn undelayed(&self) -> Option<f64> {
        None
    }
    /// Forgets every sample.
    fn reset(&mut self);
    /// The torque at the last sample has become known, with a standard deviation in N·m: the reported
    /// sigma may shrink by what a shift of the torsion's zero compensates.
    fn tare(&mut self, _sigma: f64) {}
    /// Tares: the torque at the last sample is `tau`, N·m, within the standard deviation `sigma`. Called
    /// sample by sample over some tens of them at rest. Nothing happens where no zero can be moved.
    fn tare_to(&mut self, _tau: f64, _sigma: f64) {}
    /// Another source says that the torque at the last sample is `tau`, N·m, within the standard deviation `sigma`;
    /// called once a sample at most. Only what is not known of the estimator's own past follows, slowly. Gives the
    /// change of the torque, N·m.
    fn show(&mut self, _tau: f64, _sigma: f64) -> f64 {
        0.0
    }
    /// Standard deviation of the torque at the last sample by the estimator's past, N·m: [`Self::show`] makes the torque
    /// follow another one by as much, whose errors it has from then on.
    fn past(&self) -> f64 {
        0.0
    }
    /// Whether sources that fail for different reasons have long been further apart than their sigmas
    /// allow; never for a single source.
    fn disagrees(&self) -> bool {
        false
    }
}

/// An estimator of any kind.
pub type AnyEstimator = Box<dyn JointTorqueEstimator + Send>;
