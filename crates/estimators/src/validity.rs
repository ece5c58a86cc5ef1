//! Ranges that a fit's data covered, and how an error grows outside of them.

/// Growth of the error per torque beyond the range that was covered.
const PER_TORQUE: f64 = 0.15;
/// Growth of the current's error with the rate of the load beyond the covered one, s: lag between current
/// and torque that the data could not show.
const PER_LOADING: f64 = 3e-3;

/// Ranges that the data covered; one that is not known has no bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Validity {
    /// Least and largest torque, N·m.
    pub torque: [f64; 2],
    /// Least and largest q, rad.
    pub angle: [f64; 2],
    /// Largest |dq|, rad/s.
    pub speed: f64,
    /// Largest |d tau/dt|, N·m/s.
    pub loading: f64,
    /// Error that the speed causes at the largest covered one, N·m: beyond, it grows in proportion.
    pub speed_error: f64,
}

impl Default for Validity {
    fn default() -> Self {
        Self {
            torque: [f64::NEG_INFINITY, f64::INFINITY],
            angle: [f64::NEG_INFINITY, f64::INFINITY],
            speed: f64::INFINITY,
            loading: f64::INFINITY,
            speed_error: 0.0,
        }
    }
}

impl Validity {
    /// Standard deviation to add for a torque outside of the covered range, N·m.
    #[must_use]
    pub fn torque_error(&self, tau: f64) -> f64 {
        PER_TORQUE * self.beyond(tau)
    }

    /// How far a torque lies outside of the covered range, N·m.
    #[must_use]
    pub fn beyond(&self, tau: f64) -> f64 {
        let [low, high] = self.torque;
        (tau - high).max(low - tau).max(0.0)
    }

    /// Error that a torque beyond the covered range adds to that of a gear, N·m, for torques below it and above it:
    /// each the model's slope that is off by one standard deviation there, which a tare within knows in part. The law
    /// of a gear is odd, so that a torque covers its mirror image as well.
    #[must_use]
    pub fn torque_errors(&self, tau: f64) -> [f64; 2] {
        let [low, high] = self.torque;
        let (low, high) = (low.min(-high), high.max(-low));
        [(tau - low).min(0.0), (tau - high).max(0.0)].map(|beyond| PER_TORQUE * beyond)
    }

    /// Standard deviation to add for a speed beyond the covered one, N·m.
    #[must_use]
    pub fn velocity_error(&self, dq: f64) -> f64 {
        let beyond = (dq.abs() / self.speed.max(1e-6) - 1.0).clamp(0.0, 10.0);
        if self.speed.is_finite() {
            self.speed_error * beyond
        } else {
            0.0
        }
    }

    /// Standard deviation to add to the current's torque for a load that changes faster, N·m.
    #[must_use]
    pub fn loading_error(&self, rate: f64) -> f64 {
        PER_LOADING * (rate.abs() - self.loading).max(0.0)
    }

    /// Whether torque, angle and speed lie within what was covered.
    #[must_use]
    pub fn covers(&self, tau: f64, q: f64, dq: f64) -> bool {
        let within = |[low, high]: [f64; 2], x: f64| low <= x && x <= high;
        within(self.torque, tau) && within(self.angle, q) && dq.abs() <= self.speed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gear_s_torques_cover_their_mirror_image_others_do_not() {
        let validity = Validity {
            torque: [40.0, 90.0],
            ..Validity::default()
        };
        assert_eq!(validity.torque_errors(-80.0), [0.0, 0.0]);
        assert_eq!(validity.torque_errors(10.0), [0.0, 0.0]);
        let [below, above] = validity.torque_errors(-100.0);
        assert!((below + 1.5).abs() < 1e-9 && above == 0.0);
        assert!((validity.torque_error(-80.0) - 18.0).abs() < 1e-9);
    }
}
