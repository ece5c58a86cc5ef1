//! The same mean from fewer points.
//!
//! A smooth mean does not need all the points that it was learned from. In the kernel's own space
//! the mean is a vector m, and its projection P m onto the kernels of some of the points is the
//! nearest to it that these can make. At any input the two differ by at most `|m - P m| sigma_f`.

use super::LocalGpParameters;
use super::factor::Factor;
use nalgebra::DMatrix;

/// Least conditional variance of a point given those chosen, over the signal's variance: below it
/// weights would grow without bound.
const MIN_CONDITIONAL_VARIANCE: f64 = 1e-7;

/// Indices of the points that make the mean to within `error` (N·m) at any input, and their
/// weights; None if it takes all of them. `a` = K + D.
pub(super) fn sparsify(
    p: &LocalGpParameters,
    a: &DMatrix<f64>,
    alpha: &[f64],
    error: f64,
) -> Option<(Vec<usize>, Vec<f64>)> {
    let (n, s) = (alpha.len(), p.signal_variance);
    let kernel = |i: usize, j: usize| if i == j { s } else { a[(i, j)] };
    // Residual of the mean at each point, and each point's variance given those chosen.
    let mut left: Vec<f64> = (0..n)
        .map(|i| (0..n).map(|j| kernel(i, j) * alpha[j]).sum())
        .collect();
    let mut conditional = vec![s; n];
    let mut square: f64 = left.iter().zip(alpha).map(|(l, a)| l * a).sum();
    let (mut chosen, mut made) = (Vec::new(), Vec::new());
    let mut rows: Vec<Vec<f64>> = Vec::new();
    while s * square > error * error {
        // By orthogonal matching pursuit: the point that brings the projection nearest.
        let gain = |i: usize| left[i] * left[i] / conditional[i];
        let free = (0..n).filter(|&i| conditional[i] > MIN_CONDITIONAL_VARIANCE * s);
        let best = free.max_by(|&i, &j| gain(i).total_cmp(&gain(j)))?;
        let root = conditional[best].sqrt();
        let row: Vec<f64> = (0..n)
            .map(|i| {
                let explained: f64 = rows.iter().map(|r| r[i] * r[best]).sum();
                (kernel(i, best) - explained) / root
            })
            .collect();
        let along = left[best] / root;
        for ((left, conditional), r) in left.iter_mut().zip(&mut conditional).zip(&row) {
            *left -= along * r;
            *conditional -= r * r;
        }
        conditional[best] = 0.0;
        square -= along * along;
        made.push(along);
        chosen.push(best);
        rows.push(row);
        if chosen.len() == n {
            return None;
        }
    }
    // The rows at the chosen points are triangular: R weights = made.
    for i in (0..chosen.len()).rev() {
        made[i] /= rows[i][chosen[i]];
        let weight = made[i];
        for (above, row) in made[..i].iter_mut().zip(&rows) {
            *above -= row[chosen[i]] * weight;
        }
    }
    Some((chosen, made))
}

/// The matrix of some of the points, and its factor.
pub(super) fn part(a: &DMatrix<f64>, chosen: &[usize]) -> Option<(DMatrix<f64>, Factor)> {
    let part = a.select_columns(chosen).select_rows(chosen);
    let mut factor = Factor::default();
    for i in 0..chosen.len() {
        let beside: Vec<f64> = (0..i).map(|j| part[(i, j)]).collect();
        if !factor.push(&beside, part[(i, i)]) {
            return None;
        }
    }
    Some((part, factor))
}
