//! Error of an estimate against the truth, with its known delay removed.

/// Error of one joint's estimate against the truth.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub(super) struct ErrorStatistics {
    /// Greatest |estimate - truth|, N·m.
    pub(super) max: f64,
    /// Root mean square of estimate - truth, N·m.
    pub(super) rms: f64,
    /// Root mean square of the error over the sigma published with it: 1 where sigma is right.
    pub(super) rms_of_sigma: f64,
}

/// Compares one joint's estimate with the truth at the instant of the estimate.
#[derive(Debug, Clone)]
pub(super) struct DelayedComparison {
    /// The truth of the last cycles, the newest at `newest`.
    truth: Vec<f64>,
    newest: usize,
    seen: usize,
    largest_truth: f64,
    max: f64,
    sum_of_squares: f64,
    /// The same of the error over its sigma.
    sum_of_ratios: f64,
    count: usize,
}

impl DelayedComparison {
    /// A comparison for delays of up to `longest_delay` cycles.
    #[must_use]
    pub(super) fn new(longest_delay: usize) -> Self {
        Self {
            truth: vec![0.0; longest_delay + 2],
            newest: 0,
            seen: 0,
            largest_truth: 0.0,
            max: 0.0,
            sum_of_squares: 0.0,
            sum_of_ratios: 0.0,
            count: 0,
        }
    }

    /// Takes this cycle's truth and, if it may be used, the estimate with its sigma that is `delay`
    /// cycles late.
    pub(super) fn push(&mut self, truth: f64, estimate: Option<(f64, f64)>, delay: f64) {
        self.newest = (self.newest + 1) % self.truth.len();
        self.truth[self.newest] = truth;
        self.seen += 1;
        self.largest_truth = self.largest_truth.max(truth.abs());
        if let Some((estimate, sigma)) = estimate
            && let Some(truth) = self.truth_ago(delay)
        {
            let error = estimate - truth;
            self.max = self.max.max(error.abs());
            self.sum_of_squares += error * error;
            self.sum_of_ratios += (error / sigma.max(f64::MIN_POSITIVE)).powi(2);
            self.count += 1;
        }
    }

    /// The truth `delay` cycles ago, linear between samples; none if that is too long ago.
    fn truth_ago(&self, delay: f64) -> Option<f64> {
        let whole = delay.floor().max(0.0) as usize;
        if whole + 1 >= self.truth.len() || whole + 2 > self.seen {
            return None;
        }
        let at = |ago: usize| self.truth[(self.newest + self.truth.len() - ago) % self.truth.len()];
        let fraction = delay - whole as f64;
        Some((1.0 - fraction) * at(whole) + fraction * at(whole + 1))
    }

    /// The statistics so far; none if nothing could be compared.
    #[must_use]
    pub(super) fn statistics(&self) -> Option<ErrorStatistics> {
        (self.count > 0).then(|| ErrorStatistics {
            max: self.max,
            rms: (self.sum_of_squares / self.count as f64).sqrt(),
            rms_of_sigma: (self.sum_of_ratios / self.count as f64).sqrt(),
        })
    }

    /// Largest |truth|, N·m.
    #[must_use]
    pub(super) fn largest_truth(&self) -> f64 {
        self.largest_truth
    }
}

#[cfg(test)]
mod tests {
    use super::DelayedComparison;

    fn truth(cycle: f64) -> f64 {
        0.5 * cycle - 3.0
    }

    #[test]
    fn a_late_but_true_estimate_has_no_error() {
        for delay in [0.0, 1.0, 19.0, 39.5] {
            let mut comparison = DelayedComparison::new(40);
            for cycle in 0..200 {
                let estimate = truth(f64::from(cycle) - delay);
                comparison.push(truth(f64::from(cycle)), Some((estimate, 0.1)), delay);
            }
            let statistics = comparison.statistics().unwrap();
            assert!(statistics.max < 1e-12, "delay {delay}: {statistics:?}");
        }
    }

    #[test]
    fn a_wrong_delay_shows() {
        let mut comparison = DelayedComparison::new(40);
        for cycle in 0..200 {
            comparison.push(
                truth(f64::from(cycle)),
                Some((truth(f64::from(cycle) - 10.0), 0.5)),
                12.0,
            );
        }
        let statistics = comparison.statistics().unwrap();
        assert!((statistics.rms - 1.0).abs() < 1e-12);
        assert!((statistics.rms_of_sigma - 2.0).abs() < 1e-12);
        assert!((comparison.largest_truth() - truth(199.0)).abs() < 1e-12);
    }

    #[test]
    fn nothing_is_compared_before_the_delay_has_passed_or_when_it_is_too_long() {
        let mut comparison = DelayedComparison::new(10);
        for _ in 0..100 {
            comparison.push(1.0, Some((1.0, 1.0)), 11.0);
        }
        assert!(comparison.statistics().is_none());
    }
}
