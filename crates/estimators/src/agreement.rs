//! How much better two sources agree since a tare than their variances expect.
//!
//! In: innovations of torsion and current with their variances. Out: both variances, lowered where the innovations
//! are smaller than expected: covariance matching (R. K. Mehra, On the identification of variances and adaptive
//! Kalman filtering, IEEE Trans. Automatic Control 15(2), 1970), with a prior, and one innovation for each change of
//! the state, as errors last while nothing changes. It never raises them: the innovation test does. Without a tare
//! both sources follow the reference of one training, whose errors they share, so that agreement shows less there
//! (family of joints, 2026-11: sigmas too small after long trainings).
//!
//! Out as well: the most that the variance can be, as a tare makes the error known and what has not changed since
//! cannot be wrong.

/// Change of the torque after which an innovation counts as another, of the rated torque.
const TORQUE_STEP: f64 = 0.1;
/// The same of the motor's angle, rad.
const ANGLE_STEP: f64 = 1.0;
/// Innovations that the prior is worth, whose mean square over their variance is 1.
const PRIOR: f64 = 4.0;
/// Innovations that count, at most: earlier ones fade.
const MOST: f64 = 30.0;
/// Largest square of an innovation over its variance that counts.
const LARGEST: f64 = 9.0;
/// Least factor of a variance.
const LEAST: f64 = 0.1;
/// Standard deviation of the fused torque since a tare, of the larger change that a source shows: that of the stiffness
/// of a gear of which nothing is known.
const OF_CHANGE: f64 = 0.5;
/// The same, of the difference of both sources.
const OF_DIFFERENCE: f64 = 0.3;
/// What a tare leaves open beside the error of its torque, of the rated torque.
const LEFT_OPEN: f64 = 0.0025;

/// Innovations since a tare.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Agreement {
    /// Torque, N·m, and motor angle, rad, at the last innovation that counted.
    last: Option<[f64; 2]>,
    /// Innovations, and the sum of their squares over their variances.
    count: f64,
    sum: f64,
    /// Torques of both sources just after the tare, N·m, and the variance of the torque that was known, (N·m)².
    begin: Option<[f64; 2]>,
    known: f64,
}

impl Agreement {
    /// None yet, since a tare at a torque that is known with a standard deviation, N·m.
    pub(crate) fn since(sigma: f64) -> Self {
        Self {
            known: sigma * sigma,
            ..Self::default()
        }
    }

    /// Takes an innovation, `chi`: its square over its variance, at torque `tau`, N·m, and motor angle `theta`, rad.
    pub(crate) fn update(&mut self, chi: f64, [tau, theta]: [f64; 2], rated_torque: f64) {
        if !(chi.is_finite() && tau.is_finite() && theta.is_finite()) {
            return;
        }
        // The tare itself is no agreement: it has made both equal.
        let [last_tau, last_theta] = *self.last.get_or_insert([tau, theta]);
        let changed = (tau - last_tau).abs() > TORQUE_STEP * rated_torque;
        if !(changed || (theta - last_theta).abs() > ANGLE_STEP) {
            return;
        }
        self.last = Some([tau, theta]);
        self.count += 1.0;
        self.sum += chi.min(LARGEST);
        let kept = (MOST / self.count).min(1.0);
        (self.count, self.sum) = (kept * self.count, kept * self.sum);
    }

    /// The variances `a` and `b` of two sources, (N·m)², lowered by what the innovations show of each.
    pub(crate) fn lowered(&self, a: f64, b: f64) -> [f64; 2] {
        //= T Agreement: s = (n_0 + sum_k chi_k²) / (n_0 + n)
        let scale = ((PRIOR + self.sum) / (PRIOR + self.count)).min(1.0);
        // Best linear estimate of both from that of their sum, which they share by the squares of their sizes.
        //= T Share: var_a -> var_a (1 + (s - 1) var_a (var_a + var_b) / (var_a² + var_b²))
        let share = (a + b) / (a * a + b * b).max(f64::MIN_POSITIVE);
        [a, b].map(|v| v * (1.0 + (scale - 1.0) * v * share).max(LEAST))
    }

    /// The most that the variance of the fused torque is while both sources show these torques, N·m: an error since the
    /// tare is one of the change.
    pub(crate) fn most(&mut self, [a, b]: [f64; 2], rated_torque: f64) -> f64 {
        if !(a.is_finite() && b.is_finite()) {
            return f64::INFINITY;
        }
        let [first_a, first_b] = *self.begin.get_or_insert([a, b]);
        let change = (a - first_a).abs().max((b - first_b).abs());
        //= T Change: var <= var_0 + (0.5 max_k |tau_k - tau_k(0)|)² + (0.3 (tau_a - tau_b))²
        self.known
            + (LEFT_OPEN * rated_torque).powi(2)
            + (OF_CHANGE * change).powi(2)
            + (OF_DIFFERENCE * (a - b)).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_support::Random;

    /// Errors of two sources, each its own at every level of the torque, `scale` times their standard deviations.
    fn after(scale: f64, levels: u32, sigmas: [f64; 2], seed: u64) -> [f64; 2] {
        let mut random = Random::new(seed);
        let mut agreement = Agreement::default();
        let variances = sigmas.map(|s| s * s);
        for level in 0..=levels {
            let error: f64 = sigmas.iter().map(|s| scale * s * random.normal()).sum();
            let chi = error * error / variances.iter().sum::<f64>();
            for _ in 0..1000 {
                agreement.update(chi, [2.0 * f64::from(level % 2), 0.0], 10.0);
            }
        }
        agreement.lowered(variances[0], variances[1])
    }

    fn mean(scale: f64, levels: u32, sigmas: [f64; 2]) -> [f64; 2] {
        let of = |k: usize| {
            let all = (0..300).map(|seed| after(scale, levels, sigmas, seed)[k]);
            all.sum::<f64>() / 300.0
        };
        [of(0), of(1)]
    }

    #[test]
    fn variances_follow_errors_that_are_smaller_and_not_those_that_are_as_expected() {
        let [a, b] = mean(0.4, 60, [1.0, 1.0]);
        assert!((0.2..0.35).contains(&a) && (a - b).abs() < 1e-9, "{a}, {b}");
        // As expected: only what chance does, which never raises.
        let [a, _] = mean(1.0, 60, [1.0, 1.0]);
        assert!((0.8..=1.0).contains(&a), "{a}");
        assert_eq!(after(3.0, 60, [1.0, 1.0], 1), [1.0, 1.0]);
    }

    #[test]
    fn nothing_is_learned_while_nothing_changes_nor_about_the_source_that_hardly_counts() {
        assert_eq!(after(0.1, 0, [1.0, 1.0], 1), [1.0, 1.0]);
        let [a, b] = mean(0.3, 60, [1.0, 0.1]);
        assert!(a < 0.3, "{a}");
        assert!((0.0098..=0.01).contains(&b), "{b}");
    }

    #[test]
    fn what_has_hardly_changed_since_a_tare_is_hardly_wrong() {
        let mut agreement = Agreement::since(0.1);
        let mut most = |a, b| agreement.most([a, b], 40.0).sqrt();
        // Nothing but the torque of the tare and what it leaves open, at whatever torque it was.
        assert!((most(30.0, 30.0) - f64::hypot(0.1, 0.1)).abs() < 1e-9);
        // Half of the larger change, whichever source shows it, and either way.
        for (a, b) in [(38.0, 30.0), (30.0, 22.0), (30.0, 38.0)] {
            assert!((most(a, b) - (0.02f64 + 4.0 * 4.0 + 2.4 * 2.4).sqrt()).abs() < 1e-9);
        }
        // It is over when both have come back, and covers both where they contradict each other.
        assert!(most(30.0, 30.0) < 0.15);
        assert!(most(40.0, 20.0) > 0.5 * 10.0);
        assert!(most(f64::NAN, 30.0).is_infinite());
    }

    #[test]
    fn readings_that_are_not_numbers_change_nothing() {
        let mut agreement = Agreement::default();
        agreement.update(f64::NAN, [1.0, 1.0], 10.0);
        agreement.update(0.0, [f64::NAN, 1.0], 10.0);
        assert_eq!(agreement, Agreement::default());
        assert!(agreement.lowered(0.0, 0.0).iter().all(|v| *v == 0.0));
    }
}
