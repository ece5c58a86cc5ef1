//! Widths, signal and noise by the likelihood of the data (G 9; Rasmussen and Williams 5.4).

use crate::quasi_newton::minimise;
use estimators::features::MAX_FEATURES;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

/// Constants of a Gaussian process with a Gaussian kernel.
#[derive(Debug, Clone, PartialEq)]
pub struct HyperParameters {
    /// Per input: its mean, and the kernel's width (ARD).
    pub inputs: Vec<(f64, f64)>,
    /// sigma_f², (N·m)².
    pub signal_variance: f64,
    /// sigma_n², (N·m)².
    pub noise_variance: f64,
}

impl HyperParameters {
    /// Inputs less their means, in widths; zero beyond the inputs that there are.
    #[must_use]
    pub fn scaled(&self, raw: &[f64; MAX_FEATURES]) -> [f64; MAX_FEATURES] {
        let mut x = [0.0; MAX_FEATURES];
        for ((x, raw), (mean, width)) in x.iter_mut().zip(raw).zip(&self.inputs) {
            *x = (raw - mean) / width;
        }
        x
    }
}

/// Logarithms of widths (in standard deviations of the input) and of variances (in variances of the
/// output) are bounded by these: an irrelevant input would drive its width to infinity.
const MAX_LOG: f64 = 5.0;
const MIN_LOG_WIDTH: f64 = -3.0;
/// Quasi-Newton steps at most.
const STEPS: usize = 80;

/// Logarithm of the marginal likelihood of outputs `y` at points `x` (rows), and its gradient by
/// the logarithms of the widths, of sigma_f² and of sigma_n². None if K cannot be factored.
#[must_use]
pub fn log_marginal_likelihood(
    x: &DMatrix<f64>,
    y: &DVector<f64>,
    widths: &[f64],
    signal_variance: f64,
    noise_variance: f64,
) -> Option<(f64, Vec<f64>)> {
    let (n, d) = x.shape();
    // Points in columns: kernels run over neighbours in memory.
    let scaled = DMatrix::from_fn(d, n, |c, i| x[(i, c)] / widths[c]);
    let square = |i: usize, j: usize| (scaled.column(i) - scaled.column(j)).norm_squared();
    //= G9: k(x_p, x_q) = sigma_f^2 exp(-1/2 (x_p - x_q)' W (x_p - x_q))
    let mut kernel = DMatrix::zeros(n, n);
    for j in 0..n {
        for i in j..n {
            let k = signal_variance * (-0.5 * square(i, j)).exp();
            (kernel[(i, j)], kernel[(j, i)]) = (k, k);
        }
    }
    let mut with_noise = kernel.clone();
    for i in 0..n {
        with_noise[(i, i)] += noise_variance;
    }
    let factor = with_noise.cholesky()?;
    let alpha = factor.solve(y);
    let log_determinant: f64 = (0..n).map(|i| factor.l_dirty()[(i, i)].ln()).sum();
    let value = -0.5 * y.dot(&alpha) - log_determinant - 0.5 * n as f64 * TAU.ln();
    // d/dp = 1/2 trace((alpha alpha' - K^-1) dK/dp)
    let inverse = factor.inverse();
    let mut gradient = vec![0.0; d + 2];
    for j in 0..n {
        for i in 0..=j {
            // Both halves at once; the diagonal counts once.
            let twice = if i == j { 0.5 } else { 1.0 };
            let w = twice * (alpha[i] * alpha[j] - inverse[(i, j)]);
            let wk = w * kernel[(i, j)];
            for ((g, a), b) in gradient
                .iter_mut()
                .zip(scaled.column(i).iter())
                .zip(scaled.column(j).iter())
            {
                *g += wk * (a - b) * (a - b);
            }
            gradient[d] += wk;
            if i == j {
                gradient[d + 1] += w * noise_variance;
            }
        }
    }
    Some((value, gradient))
}

/// The most likely constants.
pub(super) fn fit(
    inputs: &[[f64; MAX_FEATURES]],
    outputs: &[f64],
    dimensions: usize,
    progress: &mut dyn FnMut(f64),
) -> HyperParameters {
    let n = inputs.len();
    let moments = |values: &dyn Fn(usize) -> f64| {
        let mean = (0..n).map(values).sum::<f64>() / n as f64;
        let square = (0..n).map(|i| (values(i) - mean).powi(2)).sum::<f64>();
        (mean, (square / n as f64).sqrt().max(1e-9))
    };
    let scales: Vec<(f64, f64)> = (0..dimensions)
        .map(|c| moments(&|i| inputs[i][c]))
        .collect();
    let square = outputs.iter().map(|y| y * y).sum::<f64>() / n as f64;
    let spread = square.sqrt().max(1e-9);
    let x = DMatrix::from_fn(n, dimensions, |i, c| {
        (inputs[i][c] - scales[c].0) / scales[c].1
    });
    // Zero prior mean: far from data the model is not corrected.
    let y = DVector::from_fn(n, |i, _| outputs[i] / spread);
    // Widths of some standard deviations, a tenth of noise.
    let mut logs = vec![1.0; dimensions];
    logs.extend([0.0, 0.1f64.ln()]);
    let bound = |log: f64, c: usize| {
        let narrowest = if c < dimensions {
            MIN_LOG_WIDTH
        } else {
            -2.0 * MAX_LOG
        };
        log.clamp(narrowest, MAX_LOG)
    };
    let bounded =
        |logs: &[f64]| -> Vec<f64> { (0..logs.len()).map(|c| bound(logs[c], c)).collect() };
    minimise(
        &mut logs,
        STEPS,
        1e-3 * n as f64,
        |logs, gradient| {
            let inside = bounded(logs);
            let widths: Vec<f64> = inside[..dimensions].iter().map(|l| l.exp()).collect();
            let variances = [inside[dimensions].exp(), inside[dimensions + 1].exp()];
            let likelihood = log_marginal_likelihood(&x, &y, &widths, variances[0], variances[1]);
            let Some((value, slope)) = likelihood else {
                gradient.fill(0.0);
                return f64::INFINITY;
            };
            for (c, gradient) in gradient.iter_mut().enumerate() {
                *gradient = if inside[c] == logs[c] { -slope[c] } else { 0.0 };
            }
            -value
        },
        |step, _, _| {
            progress(step as f64 / STEPS as f64);
            true
        },
    );
    let logs = bounded(&logs);
    HyperParameters {
        inputs: (scales.iter().zip(&logs))
            .map(|((mean, sd), log)| (*mean, sd * log.exp()))
            .collect(),
        signal_variance: square.max(1e-18) * logs[dimensions].exp(),
        noise_variance: square.max(1e-18) * logs[dimensions + 1].exp(),
    }
}
