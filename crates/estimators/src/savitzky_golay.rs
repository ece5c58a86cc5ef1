//! Savitzky-Golay filters (D 2.1): a polynomial fitted by least squares to the last samples,
//! read with its derivatives at a chosen instant.
//!
//! The fit is linear in the samples, so it is a dot product with coefficients known beforehand.
//! A polynomial of the filter's order passes unchanged but for the delay, which is therefore
//! exact: every signal of one equation filtered with the same window is late by the same time.

use crate::fir::{Kernels, check_period, check_shape};
use problem::Problem;

/// Filter of a signal and its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SavitzkyGolayParameters {
    /// Samples that the fit covers, at least 1; even numbers are fine.
    pub window: usize,
    /// Degree of the polynomial, below `window`.
    pub order: usize,
    /// Derivatives beside the value: 0, 1 or 2. One beyond `order` is that of a polynomial
    /// of its own degree, as far as the window holds samples for one.
    pub derivatives: usize,
    /// Samples before the newest at which the polynomial is read, 0 to `window - 1`; may be
    /// fractional. The window's middle is `(window - 1)/2`.
    pub delay_samples: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
}

impl SavitzkyGolayParameters {
    /// A filter that is read in the middle of its window, where its noise is least.
    #[must_use]
    pub fn centred(window: usize, order: usize, derivatives: usize, sample_period: f64) -> Self {
        let delay_samples = 0.5 * (window.max(1) - 1) as f64;
        Self {
            window,
            order,
            derivatives,
            delay_samples,
            sample_period,
        }
    }

    fn check(&self) -> Result<(), Problem> {
        let Self {
            window,
            order,
            derivatives,
            delay_samples,
            sample_period,
        } = *self;
        check_shape(window, 1, derivatives)?;
        if order >= window {
            let allowed = format!("below the window of {window}");
            return Err(Problem::new(format!("order {order}"), allowed));
        }
        if !(0.0..=(window - 1) as f64).contains(&delay_samples) {
            let reason = format!("evaluation {delay_samples} samples ago");
            return Err(Problem::new(reason, format!("0 to {}", window - 1)));
        }
        check_period(sample_period)
    }

    pub(crate) fn kernels(&self) -> Result<Kernels, Problem> {
        self.check().map_err(|p| p.of("Savitzky-Golay filter"))?;
        let (window, order) = (self.window, self.order);
        let taps = (0..=self.derivatives).map(|d| {
            let rate = self.sample_period.powi(-(d as i32));
            let h = coefficients(window, order.max(d).min(window - 1), d, self.delay_samples);
            h.iter().map(|h| h * rate).collect()
        });
        Ok(Kernels {
            taps: taps.collect(),
            ahead: coefficients(window, order, 0, -1.0),
            delay_s: self.delay_samples * self.sample_period,
        })
    }
}

/// Coefficients of the `derivative`-th derivative of the fit, oldest sample first, per sample^d.
///
/// `delay_samples` before the newest sample is where the polynomial is read.
/// The polynomials that are orthogonal on the samples give them without a matrix inverse:
/// `h_i = sum_j phi_j(t_i) phi_j^(d)(t)`.
#[must_use]
pub fn coefficients(
    window: usize,
    order: usize,
    derivative: usize,
    delay_samples: f64,
) -> Vec<f64> {
    let middle = 0.5 * (window as f64 - 1.0);
    // Time is scaled to -1..1, else high orders over long windows lose digits.
    let scale = middle.max(1.0);
    let nodes: Vec<f64> = (0..window).map(|i| (i as f64 - middle) / scale).collect();
    let read_at = (middle - delay_samples) / scale;
    let mut h = vec![0.0; window];
    let mut last = vec![0.0; window];
    let mut phi = vec![1.0 / (window as f64).sqrt(); window];
    // phi_j and its derivatives up to `derivative` at the instant of reading.
    let mut last_at = vec![0.0; derivative + 1];
    let mut phi_at = vec![0.0; derivative + 1];
    phi_at[0] = phi[0];
    let mut beta = 0.0;
    for j in 0..=order {
        for (h, phi) in h.iter_mut().zip(&phi) {
            *h += phi * phi_at[derivative];
        }
        if j == order {
            break;
        }
        // Stieltjes: gamma phi_{j+1} = (t - alpha) phi_j - beta phi_{j-1}.
        let alpha: f64 = nodes.iter().zip(&phi).map(|(t, p)| t * p * p).sum();
        let next: Vec<f64> = (0..window)
            .map(|i| (nodes[i] - alpha) * phi[i] - beta * last[i])
            .collect();
        let gamma = next.iter().map(|p| p * p).sum::<f64>().sqrt();
        let next_at: Vec<f64> = (0..=derivative)
            .map(|k| {
                let product = if k > 0 { k as f64 * phi_at[k - 1] } else { 0.0 };
                (product + (read_at - alpha) * phi_at[k] - beta * last_at[k]) / gamma
            })
            .collect();
        last = std::mem::replace(&mut phi, next.iter().map(|p| p / gamma).collect());
        last_at = std::mem::replace(&mut phi_at, next_at);
        beta = gamma;
    }
    let per_sample = scale.powi(-(derivative as i32));
    h.iter().map(|h| h * per_sample).collect()
}
