//! Placeholder: kinematic error of the harmonic drive (Z 18).

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
