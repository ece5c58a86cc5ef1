//! Kinematic error of the harmonic drive (Z 16-18, S 9): the torsion that shows without torque.

/// Fourier coefficients of the kinematic error (Z 18, Table I), in rad.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KinematicErrorParameters {
    /// a0: constant part, rad.
    pub a0: f64,
    /// w_l: cycles per rad of q times 2 pi, 1 (dimensionless).
    pub w_link: f64,
    /// (a_ln, b_ln) of cos and sin of `n w_l q`, n from 1, rad.
    pub link: Vec<(f64, f64)>,
    /// w_w: as `w_link`, per rad of theta.
    pub w_motor: f64,
    /// (a_wn, b_wn) of cos and sin of `n w_w theta`, n from 1, rad.
    pub motor: Vec<(f64, f64)>,
}

impl KinematicErrorParameters {
    /// err: kinematic error at link-side angle `q` and motor-side angle `theta`, rad.
    #[must_use]
    pub fn error(&self, q: f64, theta: f64) -> f64 {
        //= Z18: err = a0 + a_l1 cos(w_l q) + b_l1 sin(w_l q)
        //=     + a_w1 cos(w_w theta) + b_w1 sin(w_w theta) + a_w2 cos(2 w_w theta) + ...
        let (link, motor) = (self.w_link * q, self.w_motor * theta);
        self.error_of(link.sin_cos(), motor.sin_cos())
    }

    /// [`Self::error`] from sine and cosine of `w_l q` and `w_w theta`.
    pub(crate) fn error_of(&self, link: (f64, f64), motor: (f64, f64)) -> f64 {
        self.a0 + harmonics(link, &self.link) + harmonics(motor, &self.motor)
    }

    /// The largest value that `|error|` can reach, rad.
    #[must_use]
    pub fn bound(&self) -> f64 {
        let amplitudes = self
            .link
            .iter()
            .chain(&self.motor)
            .map(|(a, b)| a.hypot(*b));
        self.a0.abs() + amplitudes.sum::<f64>()
    }
}

/// `sum_n a_n cos(n phase) + b_n sin(n phase)`, n from 1, from the phase's sine and cosine.
fn harmonics((sin, cos): (f64, f64), coefficients: &[(f64, f64)]) -> f64 {
    // The angle-addition theorem spares a sine and a cosine per harmonic.
    let (mut s, mut c, mut sum) = (sin, cos, 0.0);
    for (a, b) in coefficients {
        sum += a * c + b * s;
        (s, c) = (s * cos + c * sin, c * cos - s * sin);
    }
    sum
}
