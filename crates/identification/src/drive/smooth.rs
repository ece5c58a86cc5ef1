//! Means and hysteresis elements along a signal.

/// A centred Gaussian mean.
pub(super) struct Gaussian {
    weights: Vec<f64>,
    /// Samples to either side.
    pub(super) reach: usize,
}

/// Reach of the Gaussian, standard deviations.
const REACH: f64 = 3.0;

impl Gaussian {
    /// Of this standard deviation, s.
    pub(super) fn new(sigma: f64, period: f64) -> Self {
        let samples = sigma / period;
        let reach = (REACH * samples) as usize;
        let weight = |k: usize| (-0.5 * ((k as f64 - reach as f64) / samples).powi(2)).exp();
        let weights: Vec<f64> = (0..=2 * reach).map(weight).collect();
        let sum: f64 = weights.iter().sum();
        Self {
            weights: weights.iter().map(|w| w / sum).collect(),
            reach,
        }
    }

    /// The mean at every sample; near the ends over the samples that are there.
    pub(super) fn of(&self, x: &[f64]) -> Vec<f64> {
        let at = |k: usize| {
            let first = k.saturating_sub(self.reach);
            let skipped = self.reach - (k - first);
            let near = x[first..].iter().zip(&self.weights[skipped..]);
            let (sum, total) =
                near.fold((0.0, 0.0), |(sum, total), (x, w)| (sum + w * x, total + w));
            sum / total
        };
        (0..x.len()).map(at).collect()
    }
}

/// Stop operator: stretch of an element that slips at `radius`, over that, along `x`.
pub(super) fn stop(x: &[f64], radius: f64) -> Vec<f64> {
    //= H Stop: s_j = min(max(s_j + x - x_last, -r_j), r_j)
    let (mut stretch, mut last) = (0.0, x.first().copied().unwrap_or(0.0));
    let next = |x: &f64| {
        stretch = f64::clamp(stretch + x - last, -radius, radius);
        last = *x;
        stretch / radius
    };
    x.iter().map(next).collect()
}
