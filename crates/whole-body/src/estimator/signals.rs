//! Input and output of the estimator in one cycle.

use dynamics::ImuMotion;
use robot_state::Wrench;

/// One cycle's signals, in the orders of [`WholeBodyParameters`].
#[derive(Debug, Clone, Copy)]
pub struct WholeBodyInput<'a> {
    /// q: joint angles, rad.
    pub q: &'a [f64],
    /// dq: joint velocities, rad/s.
    pub dq: &'a [f64],
    /// ddq: joint accelerations, rad/s².
    pub ddq: &'a [f64],
    /// Wrench that the part beyond each sensor applies to the part before it, in its frame.
    pub ft: &'a [Wrench],
    /// The IMU's measurement; not used with a fixed base.
    pub imu: ImuMotion,
}

/// A contact's wrench.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ContactEstimate {
    /// f_hat: wrench that the environment applies to the link, at the contact's point in the link's
    /// axes.
    pub wrench: Wrench,
    /// Standard deviation of each of its components.
    pub sigma: Wrench,
}

/// Estimate of a part of the robot.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PartEstimate {
    /// Wrench that the environment must apply to the part to explain its motion and its sensors,
    /// whatever the contacts are taken to be; in the frame of its first link.
    pub net: Wrench,
    /// Share of `net` that the declared contacts cannot explain; in the frame of the first link.
    pub residual: Wrench,
    /// Standard deviation of each component of `residual`, if the contacts are the true ones.
    pub residual_sigma: Wrench,
    /// Independent unknowns of the declared contacts at this pose.
    pub rank: u32,
    /// Unknowns of the declared contacts.
    pub unknowns: u32,
}

impl PartEstimate {
    /// The largest component of the residual, in its standard deviations; none where the contacts
    /// explain anything.
    #[must_use]
    pub fn residual_ratio(&self) -> Option<f64> {
        if self.unknowns >= 6 {
            return None;
        }
        let (r, s) = (self.residual.to_array(), self.residual_sigma.to_array());
        let ratios = r
            .iter()
            .zip(&s)
            .map(|(r, s)| if *s > 0.0 { r.abs() / s } else { 0.0 });
        Some(ratios.fold(0.0, f64::max))
    }
}

/// Result of one cycle's signals.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeBodyEstimate {
    /// tau: joint torques, N·m, in the order of the parameters' joints.
    pub tau: Vec<f64>,
    /// sigma: their standard deviations by noise and model, N·m.
    pub sigma: Vec<f64>,
    /// Their standard deviations by what lasts of the errors of F/T sensors and accelerometer, N·m; independent of
    /// those of `sigma`.
    pub lasting_sigma: Vec<f64>,
    /// The contacts of the chosen hypothesis, in its order; as long as the longest has contacts.
    pub contacts: Vec<ContactEstimate>,
    /// The part with the root, then the part beyond each sensor in the parameters' order.
    pub parts: Vec<PartEstimate>,
    /// Whether the last signals and all that follows from them are finite, and every contact could be
    /// found; otherwise all but `rank` and `unknowns` of the parts is from the cycle before.
    pub valid: bool,
}

impl WholeBodyEstimate {
    pub(super) fn is_finite(&self) -> bool {
        let finite = |w: &Wrench| w.to_array().iter().all(|x| x.is_finite());
        (self
            .tau
            .iter()
            .chain(&self.sigma)
            .chain(&self.lasting_sigma))
        .all(|x| x.is_finite())
            && (self.contacts.iter()).all(|c| finite(&c.wrench) && finite(&c.sigma))
            && self
                .parts
                .iter()
                .all(|p| finite(&p.net) && finite(&p.residual) && finite(&p.residual_sigma))
    }
}
