//! A gear's kinematic error.

/// A kinematic error: harmonics of the link angle and of the motor angle.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct KinematicError {
    /// Constant part, rad.
    pub constant: f64,
    /// cos and sin of harmonic 1, 2, … of `link_frequency q`, rad.
    pub link: Vec<[f64; 2]>,
    /// Periods per turn of the link's first harmonic.
    pub link_frequency: f64,
    /// cos and sin of harmonic 1, 2, … of `motor_frequency theta`, rad.
    pub motor: Vec<[f64; 2]>,
    /// Periods per turn of the motor's first harmonic.
    pub motor_frequency: f64,
}

impl KinematicError {
    /// The error at `q` and `theta`, rad.
    #[must_use]
    pub fn at(&self, q: f64, theta: f64) -> f64 {
        self.constant
            + harmonics(&self.link, self.link_frequency * q)
            + harmonics(&self.motor, self.motor_frequency * theta)
    }
}

/// Sum of `a_n cos(n x) + b_n sin(n x)`, n from 1.
fn harmonics(coefficients: &[[f64; 2]], x: f64) -> f64 {
    if coefficients.is_empty() {
        return 0.0;
    }
    let (s1, c1) = x.sin_cos();
    let (mut s, mut c, mut sum) = (s1, c1, 0.0);
    for [a, b] in coefficients {
        sum += a * c + b * s;
        (s, c) = (s * c1 + c * s1, c * c1 - s * s1);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::harmonics;

    #[test]
    fn harmonics_sum_by_recurrence() {
        let c = [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]];
        let x: f64 = 0.7;
        let direct: f64 = (c.iter().zip(1..))
            .map(|([a, b], n)| a * (x * f64::from(n)).cos() + b * (x * f64::from(n)).sin())
            .sum();
        assert!((harmonics(&c, x) - direct).abs() < 1e-12);
    }
}
