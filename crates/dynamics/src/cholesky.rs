//! Factorisation of the mass matrix that keeps the zeros of a kinematic tree, and its use.
//!
//! `M = L^T D L` with unit lower-triangular `L` (Featherstone, Rigid Body Dynamics Algorithms, 6.5):
//! row `i` of `L` is non-zero only at the ancestors of `i`.

use crate::data::Data;
use crate::model::Model;
use nalgebra::DMatrix;

/// Velocity components that support component `i`, from nearest to farthest.
fn ancestors(model: &Model, i: usize) -> impl Iterator<Item = usize> + '_ {
    let up = |i: usize| model.dof_parent.get(i).copied().flatten();
    std::iter::successors(up(i), move |&k| up(k))
}

/// Factorises `M`, after `crba`, into `data`; false if it is not positive definite.
pub fn cholesky_decompose(model: &Model, data: &mut Data) -> bool {
    let n = model.nv();
    data.factor.copy_from(&data.mass_matrix);
    let h: &mut DMatrix<f64> = &mut data.factor;
    let mut positive = true;
    for k in (0..n).rev() {
        let d = h[(k, k)];
        positive &= d > 0.0 && d.is_finite();
        for i in ancestors(model, k) {
            let a = h[(k, i)] / d;
            let mut j = Some(i);
            while let Some(c) = j {
                h[(i, c)] -= a * h[(k, c)];
                j = model.dof_parent[c];
            }
            h[(k, i)] = a;
        }
    }
    positive
}

/// Solves `M x = b` in place, after `cholesky_decompose`.
pub fn cholesky_solve(model: &Model, data: &Data, x: &mut [f64]) {
    let n = model.nv().min(x.len());
    debug_assert_eq!(n, model.nv());
    let h = &data.factor;
    for i in (0..n).rev() {
        for j in ancestors(model, i) {
            x[j] -= h[(i, j)] * x[i];
        }
    }
    for (i, x) in x.iter_mut().enumerate().take(n) {
        *x /= h[(i, i)];
    }
    for i in 0..n {
        for j in ancestors(model, i) {
            x[i] -= h[(i, j)] * x[j];
        }
    }
}
