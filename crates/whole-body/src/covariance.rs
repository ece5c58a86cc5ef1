//! Covariance of a part's net wrench.

use crate::least_squares::Six;
use dynamics::{Force, Se3};
use nalgebra::{Matrix3, Vector3};

/// A symmetric matrix, by rows.
pub(crate) type Six6 = [Six; 6];

/// Sum of covariances of a wrench.
#[derive(Default)]
pub(crate) struct Covariance {
    force: Matrix3<f64>,
    /// Torque by force.
    mixed: Matrix3<f64>,
    torque: Matrix3<f64>,
}

impl Covariance {
    /// Of `variance` along a wrench.
    pub(crate) fn add(&mut self, variance: f64, f: &Force) {
        if variance > 0.0 {
            let (linear, angular) = (f.linear * variance, f.angular * variance);
            self.force += linear * f.linear.transpose();
            self.mixed += angular * f.linear.transpose();
            self.torque += angular * f.angular.transpose();
        }
    }
    /// Of a force at `p`, of equal variance in all directions.
    pub(crate) fn add_force(&mut self, variance: f64, p: &Vector3<f64>) {
        let arm = p.cross_matrix();
        self.force += Matrix3::from_diagonal_element(variance);
        self.mixed += arm * variance;
        // [p][p]^T = (p·p) 1 - p p^T
        self.torque += (Matrix3::from_diagonal_element(p.dot(p)) - p * p.transpose()) * variance;
    }
    /// Of a torque, of equal variance in all directions.
    pub(crate) fn add_torque(&mut self, variance: f64) {
        self.torque += Matrix3::from_diagonal_element(variance);
    }
    pub(crate) fn whole(&self) -> Six6 {
        std::array::from_fn(|i| {
            std::array::from_fn(|j| match (i < 3, j < 3) {
                (true, true) => self.force[(i, j)],
                (true, false) => self.mixed[(j - 3, i)],
                (false, true) => self.mixed[(i - 3, j)],
                (false, false) => self.torque[(i - 3, j - 3)],
            })
        })
    }
}

/// Rows that take a part's `b` (about its origin, root's axes) to a contact's wrench at its frame.
pub(crate) fn contact_rows(
    frame: &Se3,
    origin: &Vector3<f64>,
    residual_free: bool,
    rows: &[Six],
) -> [Six; 6] {
    let mut out = [[0.0; 6]; 6];
    if !residual_free {
        for (out, row) in out.iter_mut().zip(rows) {
            *out = *row;
        }
        return out;
    }
    // b about the contact's point, in the contact's axes.
    let p = frame.translation - origin;
    for k in 0..3 {
        let e = frame.rotation.column(k).into_owned();
        out[k] = Force::new(e, Vector3::zeros()).to_array();
        // e · (n - p × f) = n · e - f · (e × p)
        out[3 + k] = Force::new(-e.cross(&p), e).to_array();
    }
    out
}
