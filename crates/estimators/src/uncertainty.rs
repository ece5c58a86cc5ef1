//! Variance of a model's torque from the covariance of its parameters.
//!
//! The covariance `P` comes from the fit as a few directions `d_k` with `P = sum_k d_k d_k'`, so that
//! the variance of the torque is `sum_k (d_k' g)²` with the gradient `g` of the torque in the
//! parameters. After a tare the error at the torque where the tare was made is known: the zero of the
//! torsion compensates it, and only the difference of the gradients counts.

/// Directions of the parameters' covariance, and the gradient at the present sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    /// `d_k`, one row after the other.
    directions: Vec<f64>,
    gradient: Vec<f64>,
    tared: Option<Tared>,
    /// `d_k' g` at the present sample and at the tare.
    present: Vec<f64>,
    at_tare: Vec<f64>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Tared {
    /// Slope of the torque in the zero at the tare, and variance of the torque that was known.
    slope: f64,
    variance: f64,
}

impl Uncertainty {
    /// Directions of equal length; others are left out.
    #[must_use]
    pub fn new(directions: &[Vec<f64>], parameters: usize) -> Self {
        let fitting = directions.iter().filter(|d| d.len() == parameters);
        let directions: Vec<f64> = fitting.flatten().copied().collect();
        let count = directions.len() / parameters.max(1);
        Self {
            directions,
            gradient: vec![0.0; parameters],
            tared: None,
            present: vec![0.0; count],
            at_tare: vec![0.0; count],
        }
    }

    /// The gradient, to be filled in parameter by parameter.
    pub fn gradient(&mut self) -> &mut [f64] {
        &mut self.gradient
    }

    /// Variance of the torque at the gradient filled in; `slope` is the torque's slope in the zero.
    pub fn variance(&mut self, slope: f64) -> f64 {
        let rows = self.directions.chunks_exact(self.gradient.len().max(1));
        for (sum, row) in self.present.iter_mut().zip(rows) {
            *sum = row.iter().zip(&self.gradient).map(|(d, g)| d * g).sum();
        }
        let Some(tared) = self.tared else {
            return self.present.iter().map(|x| x * x).sum();
        };
        let share = slope / tared.slope;
        let pairs = self.present.iter().zip(&self.at_tare);
        let spread: f64 = pairs.map(|(x, tare)| (x - share * tare).powi(2)).sum();
        spread + share * share * tared.variance
    }

    /// The torque of the present sample has become known with a variance, (N·m)².
    pub fn tare(&mut self, slope: f64, variance: f64) {
        if slope.is_finite() && slope.abs() > f64::MIN_POSITIVE {
            self.at_tare.copy_from_slice(&self.present);
            self.tared = Some(Tared { slope, variance });
        }
    }

    /// Whether there was a tare.
    #[must_use]
    pub fn tared(&self) -> bool {
        self.tared.is_some()
    }

    /// Forgets the tare.
    pub fn reset(&mut self) {
        self.tared = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variance_is_the_quadratic_form_and_a_tare_removes_what_the_zero_compensates() {
        // tau = k x - k zero: parameters k (sigma 10) and zero (sigma 0.5) at x = 3, k = 100.
        let directions = [vec![10.0, 0.0], vec![0.0, 0.5]];
        let mut uncertainty = Uncertainty::new(&directions, 2);
        let mut at = |x: f64| {
            uncertainty.gradient().copy_from_slice(&[x, -100.0]);
            uncertainty.variance(100.0)
        };
        assert!((at(3.0) - (30.0f64.powi(2) + 50.0f64.powi(2))).abs() < 1e-9);
        uncertainty.tare(100.0, 4.0);
        let mut at = |x: f64| {
            uncertainty.gradient().copy_from_slice(&[x, -100.0]);
            uncertainty.variance(100.0)
        };
        // At the tare only the variance of the known torque is left, elsewhere the stiffness counts.
        assert!((at(3.0) - 4.0).abs() < 1e-9);
        assert!((at(5.0) - (20.0f64.powi(2) + 4.0)).abs() < 1e-9);
    }
}
