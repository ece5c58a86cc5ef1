//! Matched filters: value, first and second derivative of signals, all through one smoothing.
//!
//! The equations of motion hold at every instant between force, acceleration and angle. After
//! filters they hold only if all signals have passed the same smoothing: force and accelerometer through a smoothing `h`,
//! gyro through `h` and `h'`, angles through `h`, `h'` and `h''`. Savitzky-Golay filters do not:
//! the second derivative of a second-order one and the value of a first-order one pass different
//! bands, and the difference is an error of the torque.
//!
//! The second derivative of a second-order Savitzky-Golay filter has the least noise of all that
//! are exact for a parabola. Summed twice, its coefficients are a smooth bell (the biweight,
//! `(1 - x^2)^2`): this is `h`, spread by `(1, 10, 1)/12` as in Numerov's method, which makes the
//! second difference a second derivative to the sixth power of frequency. Central differences of
//! the bell are `h'`.

use crate::fir::{Kernels, check_period, check_shape};
use crate::savitzky_golay::coefficients;
use problem::Problem;

/// Filter of all signals that enter one equation, which must have the same window. Outputs are those
/// of the window's middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchedFilterParameters {
    /// Samples that the filter covers, at least 3; even numbers are fine.
    pub window: usize,
    /// Derivatives beside the value: 0, 1 or 2.
    pub derivatives: usize,
    /// T: time between samples, s.
    pub sample_period: f64,
}

impl MatchedFilterParameters {
    fn check(&self) -> Result<(), Problem> {
        check_shape(self.window, 3, self.derivatives)?;
        check_period(self.sample_period)
    }

    pub(crate) fn kernels(&self) -> Result<Kernels, Problem> {
        self.check().map_err(|p| p.of("matched filter"))?;
        let (window, period) = (self.window, self.sample_period);
        let middle = 0.5 * (window - 1) as f64;
        let second = coefficients(window, 2, 2, middle);
        let bell = bell(&second);
        let at = |i: usize, by: isize| -> f64 {
            (i.checked_add_signed(by)).map_or(0.0, |i| bell.get(i).copied().unwrap_or(0.0))
        };
        let value = (0..window).map(|i| (at(i, -1) + 10.0 * at(i, 0) + at(i, 1)) / 12.0);
        // Oldest sample first: the newer one counts positive.
        let first = (0..window).map(|i| (at(i, -1) - at(i, 1)) / (2.0 * period));
        let mut taps = vec![
            value.collect(),
            first.collect(),
            second.iter().map(|c| c / (period * period)).collect(),
        ];
        taps.truncate(self.derivatives + 1);
        // A missed sample is extrapolated by a parabola where curvature is estimated, else by a line.
        let order = self.derivatives.max(1);
        Ok(Kernels {
            taps,
            ahead: coefficients(window, order, 0, -1.0),
            delay_s: middle * period,
        })
    }
}

/// The sequence whose second difference is `c`: `b[i - 1] - 2 b[i] + b[i + 1] = c[i]`, zero at both ends.
fn bell(c: &[f64]) -> Vec<f64> {
    let (mut slope, mut height) = (0.0, 0.0);
    let mut bell = vec![0.0; c.len()];
    for (next, c) in bell.iter_mut().skip(1).zip(c) {
        slope += c;
        height += slope;
        *next = height;
    }
    // Zero but for rounding.
    if let Some(last) = bell.last_mut() {
        *last = 0.0;
    }
    bell
}
