//! Noise in rows, by what changes from row to row faster than motion does: systematic errors follow the motion, of
//! which the filter's band is eight times the frequency.

use super::equations::{Grams, Weights};
use super::rows::{BLOCKS, Rows, Sampling};
use nalgebra::DVector;

/// Deviation of a normal variable over its median absolute value.
const OF_MEDIAN: f64 = 1.4826;

/// Sum of squares, each over its sigma, that white noise alone leaves in rows: by the median second difference of
/// residuals, which friction's steps do not enter.
#[must_use]
pub fn squares(
    rows: &Rows,
    sampling: &Sampling,
    x: &DVector<f64>,
    grams: &Grams,
    weights: &Weights,
) -> f64 {
    let all: Vec<usize> = (0..BLOCKS).collect();
    let share = sampling.second_difference().max(1e-3);
    let of = |(joint, own): (usize, &super::rows::JointRows)| {
        let residual = |k: usize| own.tau[k] - own.torque(k, x);
        let second = |k: usize| residual(k) - 2.0 * residual(k + 1) + residual(k + 2);
        let mut sizes: Vec<f64> = (0..rows.len().saturating_sub(2))
            .map(|k| second(k).abs())
            .collect();
        let middle = sizes.len() / 2;
        if sizes.is_empty() {
            return 0.0;
        }
        let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
        let square = (OF_MEDIAN * *median).powi(2) / (6.0 * share);
        grams.count(joint, &all) * square / weights.sigma[joint].powi(2)
    };
    rows.of.iter().enumerate().map(of).sum()
}
