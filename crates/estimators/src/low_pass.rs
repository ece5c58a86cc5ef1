//! First-order low-pass (Z IV-A).

/// `y[i] = p y[i-1] + (1-p)/2 (x[i] + x[i-1])`: the bilinear first-order low-pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowPass {
    pole: f64,
    /// x[i-1] and y[i-1]; none before the first sample.
    last: Option<(f64, f64)>,
}

impl LowPass {
    /// A low-pass with that pole, 0 to below 1; others are clamped.
    #[must_use]
    pub fn new(pole: f64) -> Self {
        debug_assert!((0.0..1.0).contains(&pole), "pole {pole}");
        // Above this the filter would take longer than an hour at 1 kHz to settle.
        Self {
            pole: pole.clamp(0.0, 1.0 - 1e-7),
            last: None,
        }
    }

    /// Takes one sample; the first one is passed on as it is. A sample that is not finite
    /// changes nothing.
    pub fn update(&mut self, x: f64) -> f64 {
        let (x_last, y_last) = self.last.unwrap_or((x, x));
        if !x.is_finite() {
            return if self.last.is_some() { y_last } else { 0.0 };
        }
        //= Z Section IV-A: tau_hat[i] = 0.95 tau_hat[i-1] + 0.025 tau[i] + 0.025 tau[i-1]
        let y = if self.pole > 0.0 {
            self.pole * y_last + 0.5 * (1.0 - self.pole) * (x + x_last)
        } else {
            x
        };
        self.last = Some((x, y));
        y
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        self.last = None;
    }

    /// Group delay at zero frequency, samples.
    #[must_use]
    pub fn delay_samples(&self) -> f64 {
        if self.pole > 0.0 {
            0.5 + self.pole / (1.0 - self.pole)
        } else {
            0.0
        }
    }
}
