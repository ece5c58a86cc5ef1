//! A joint that slides, estimated as one that turns: its way is the arc of a radius, its force that radius' tangential
//! one.
//!
//! Fits, bounds and widths of the estimators are those of gears of joints that turn. With q = way / r, tau = r force,
//! N = r motor angle / way and K = r^2 stiffness the equations of both are the same.

use robot_state::TorqueEstimate;

use crate::joint::{AnyEstimator, JointSample, JointTorqueEstimator};
use crate::kinematic_error::KinematicErrorParameters;

/// Estimators of a joint that turns, of a joint that slides: samples in m and m/s, torques in N.
pub struct AtRadius {
    turning: AnyEstimator,
    /// r, m.
    radius: f64,
}

impl AtRadius {
    /// With a radius in m.
    #[must_use]
    pub fn new(turning: AnyEstimator, radius: f64) -> Self {
        Self { turning, radius }
    }
}

impl JointTorqueEstimator for AtRadius {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        let estimate = self.turning.update(&JointSample {
            q: sample.q / self.radius,
            dq: sample.dq / self.radius,
            feed_forward: sample.feed_forward.map(|force| force * self.radius),
            ..*sample
        });
        TorqueEstimate {
            tau: estimate.tau / self.radius,
            sigma: estimate.sigma / self.radius,
            ..estimate
        }
    }

    fn undelayed(&self) -> Option<f64> {
        self.turning.undelayed().map(|tau| tau / self.radius)
    }

    fn reset(&mut self) {
        self.turning.reset();
    }

    fn tare(&mut self, sigma: f64) {
        self.turning.tare(sigma * self.radius);
    }

    fn tare_to(&mut self, tau: f64, sigma: f64) {
        self.turning.tare_to(tau * self.radius, sigma * self.radius);
    }

    fn show(&mut self, tau: f64, sigma: f64) -> f64 {
        self.turning.show(tau * self.radius, sigma * self.radius) / self.radius
    }

    fn past(&self) -> f64 {
        self.turning.past() / self.radius
    }

    fn disagrees(&self) -> bool {
        self.turning.disagrees()
    }
}

impl KinematicErrorParameters {
    /// The same error along the arc of a radius, m: in m, of a way in m.
    #[must_use]
    pub fn at_radius(&self, radius: f64) -> Self {
        let along = |list: &[(f64, f64)]| {
            let pairs = list.iter();
            pairs.map(|(a, b)| (a * radius, b * radius)).collect()
        };
        Self {
            a0: self.a0 * radius,
            w_link: self.w_link / radius,
            link: along(&self.link),
            w_motor: self.w_motor,
            motor: along(&self.motor),
        }
    }
}
