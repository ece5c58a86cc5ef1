//! Contact of a joint: its external torque beyond a threshold that grows with speed and acceleration.
//!
//! Two torques are judged, each with a threshold of its own: the *lasting* one, of a momentum
//! observer behind long filters, which sees a slow, gentle pressure; and the *change*, behind short
//! filters, which sees a blow within milliseconds and forgets what lasts, so that errors of model and
//! gear which change slowly do not count.
//!
//! ```text
//! threshold = n hypot(sigma_tau, sigma_model) + T (c + c_v |dq|/dq_max + c_a |ddq|/ddq_max) + c_t |dtau|
//! ```
//!
//! T is the joint's torque limit, `dtau` how far the joint's own torque is from where it was lately: a gear's
//! stiffness, windup and hysteresis are wrong by a share of what has changed. Speed, acceleration and change
//! are the greatest of the last tenth of a second, since errors that they make reach the torques by
//! filters.

/// Standard deviations and shares of one joint's threshold; see the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactThresholds {
    /// n: standard deviations, 1.
    pub sigmas: f64,
    /// T c of the change and of the lasting torque, N·m.
    pub at_rest: [f64; 2],
    /// T c_v / dq_max, N·m·s/rad.
    pub per_velocity: f64,
    /// T c_a / ddq_max, N·m·s²/rad.
    pub per_acceleration: f64,
    /// c_t: of the change of the joint's torque, 1.
    pub per_torque: f64,
}

/// Parameters of a [`ContactDetector`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactDetectorParameters {
    /// T: time between updates, s.
    pub sample_period: f64,
    /// The lower thresholds.
    pub thresholds: ContactThresholds,
    /// Upper threshold over the lower one, 1.
    pub upper_ratio: f64,
    /// Time for which a threshold must be exceeded, s.
    pub hold: f64,
    /// Time below two thirds of the lower threshold after which the contact is over, s.
    pub release: f64,
}

/// One external torque and what it is judged by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExternalTorque {
    /// N·m.
    pub tau: f64,
    /// Standard deviation of both torques that it is the difference of, N·m.
    pub sigma: [f64; 2],
}

/// Contact state of a joint by its torques.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ContactState {
    /// The greatest torque over its lower threshold, 1.
    pub ratio: f64,
    /// In contact: the lower threshold was exceeded.
    pub contact: bool,
    /// The upper threshold was exceeded, and the contact is not over.
    pub upper: bool,
}

/// Time constant with which the greatest speed and acceleration are forgotten, s.
const FORGETTING_TIME: f64 = 0.1;
/// Share of the lower threshold below which a contact ends, so that noise does not toggle it.
const RELEASE_SHARE: f64 = 2.0 / 3.0;

/// The contact of one joint.
#[derive(Debug, Clone)]
pub struct ContactDetector {
    parameters: ContactDetectorParameters,
    /// Greatest recent |dq|, rad/s, |ddq|, rad/s², and |dtau|, N·m.
    motion: [f64; 3],
    /// Time for which lower and upper threshold have been exceeded, s.
    exceeded: [f64; 2],
    /// Time for which the torques have been small, s.
    small: f64,
    state: ContactState,
}

impl ContactDetector {
    /// No contact.
    #[must_use]
    pub fn new(parameters: ContactDetectorParameters) -> Self {
        Self {
            parameters,
            motion: [0.0; 3],
            exceeded: [0.0; 2],
            small: 0.0,
            state: ContactState::default(),
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        *self = Self::new(self.parameters);
    }

    /// The last state.
    #[must_use]
    pub fn state(&self) -> ContactState {
        self.state
    }

    /// Lower thresholds of the change and of the lasting torque at the last speed and acceleration,
    /// N·m, with these standard deviations of each.
    #[must_use]
    pub fn thresholds(&self, sigmas: [[f64; 2]; 2]) -> [f64; 2] {
        let t = &self.parameters.thresholds;
        let [velocity, acceleration, torque] = self.motion;
        let moving =
            t.per_velocity * velocity + t.per_acceleration * acceleration + t.per_torque * torque;
        let at = |i: usize| {
            let [[a, b], at_rest] = [sigmas[i], [t.at_rest[i]; 2]];
            // Neither is near the ends of the numbers' range, which `hypot` costs its time for.
            t.sigmas * (a * a + b * b).sqrt() + at_rest[0] + moving
        };
        [at(0), at(1)]
    }

    /// Takes |dq| in rad/s, |ddq| in rad/s² and |dtau| in N·m of this cycle, the change and the lasting torque; of one
    /// that is not known for now the state stays as it is. What is not finite counts as not known.
    pub fn update(
        &mut self,
        motion: [f64; 3],
        torques: [Option<ExternalTorque>; 2],
    ) -> ContactState {
        let p = self.parameters;
        let kept = 1.0 - (p.sample_period / FORGETTING_TIME).min(1.0);
        for (greatest, x) in self.motion.iter_mut().zip(motion) {
            // max ignores a NaN.
            *greatest = (*greatest * kept).max(x.abs().min(f64::MAX));
        }
        let thresholds = self.thresholds(torques.map(|t| t.map_or([0.0; 2], |t| t.sigma)));
        let mut ratio: Option<f64> = None;
        for (torque, threshold) in torques.iter().zip(thresholds) {
            let share = torque.map(|t| t.tau.abs() / threshold.max(f64::MIN_POSITIVE));
            if let Some(share) = share.filter(|share| share.is_finite()) {
                ratio = Some(ratio.map_or(share, |ratio| ratio.max(share)));
            }
        }
        let Some(ratio) = ratio else {
            return self.state;
        };
        let dt = p.sample_period;
        let longer = |time: f64, holds: bool| if holds { time + dt } else { 0.0 };
        let [lower, upper] = self.exceeded;
        self.exceeded = [
            longer(lower, ratio > 1.0),
            longer(upper, ratio > p.upper_ratio),
        ];
        self.small = longer(self.small, ratio < RELEASE_SHARE);
        // Half a period for rounding: a time of two periods has passed with the second one.
        let over = |time: f64, limit: f64| time + 0.5 * dt > limit && time > 0.0;
        let state = &mut self.state;
        state.ratio = ratio;
        state.contact |= over(self.exceeded[0], p.hold);
        state.upper |= over(self.exceeded[1], p.hold);
        if over(self.small, p.release) {
            (state.contact, state.upper) = (false, false);
        }
        self.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1e-3;

    fn detector() -> ContactDetector {
        ContactDetector::new(ContactDetectorParameters {
            sample_period: DT,
            thresholds: ContactThresholds {
                sigmas: 3.0,
                at_rest: [2.0, 5.0],
                per_velocity: 1.0,
                per_acceleration: 0.1,
                per_torque: 0.2,
            },
            upper_ratio: 2.0,
            hold: 0.003,
            release: 0.01,
        })
    }

    fn change(tau: f64) -> [Option<ExternalTorque>; 2] {
        let sigma = [0.6, 0.8];
        [Some(ExternalTorque { tau, sigma }), None]
    }

    /// The threshold at rest is 3 · 1 + 2 = 5 N·m; two thirds of it end the contact after a time.
    #[test]
    fn a_contact_begins_and_ends_with_hysteresis() {
        let mut d = detector();
        let run = |d: &mut ContactDetector, tau: f64, cycles: usize| {
            (0..cycles).for_each(|_| _ = d.update([0.0; 3], change(tau)));
            (d.state().contact, d.state().upper)
        };
        assert_eq!(run(&mut d, 4.9, 100), (false, false));
        assert_eq!(run(&mut d, -5.1, 2), (false, false));
        assert_eq!(run(&mut d, 4.9, 1), (false, false));
        assert_eq!(run(&mut d, -5.1, 3), (true, false));
        assert_eq!(run(&mut d, 3.5, 1000), (true, false));
        assert_eq!(run(&mut d, 10.1, 3), (true, true));
        assert_eq!(run(&mut d, 3.2, 9), (true, true));
        assert_eq!(run(&mut d, 3.2, 1), (false, false));
    }

    #[test]
    fn thresholds_grow_with_motion_and_shrink_after_it() {
        let mut d = detector();
        // 5 + 2 + 0.1 · 20 + 0.2 · 5 = 10 N·m
        for _ in 0..10 {
            assert!(!d.update([-2.0, 20.0, -5.0], change(9.9)).contact);
        }
        let [now, lasting] = d.thresholds([[0.6, 0.8], [0.0; 2]]);
        assert!((now - 10.0).abs() < 1e-12 && (lasting - 10.0).abs() < 1e-12);
        for k in 0..600 {
            let state = d.update([0.0; 3], change(5.1));
            assert!(k > 300 || !state.contact, "{k}");
        }
        assert!(d.state().contact);
    }

    #[test]
    fn unknown_torques_change_nothing() {
        let mut d = detector();
        (0..10).for_each(|_| _ = d.update([0.0; 3], change(6.0)));
        let before = d.state();
        assert!(before.contact);
        for _ in 0..1000 {
            assert_eq!(
                d.update([f64::NAN, f64::INFINITY, f64::NAN], change(f64::NAN)),
                before
            );
        }
    }
}
