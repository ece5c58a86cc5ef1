//! Linear least squares (S 15-17, D7).

use nalgebra::{DMatrix, DVector};

/// Rows gathered into normal equations, in constant memory.
#[derive(Debug, Clone)]
pub struct Batch {
    /// A' A, A' b, b' b.
    gram: DMatrix<f64>,
    moment: DVector<f64>,
    square: f64,
    rows: f64,
}

/// Coefficients and how well they are known.
#[derive(Debug, Clone)]
pub struct Solution {
    /// x: coefficients.
    pub x: DVector<f64>,
    /// Standard deviation of each coefficient, for independent errors of the rows.
    pub sigma: DVector<f64>,
    /// Root mean square of `A x - b`.
    pub rms: f64,
}

impl Batch {
    /// No rows yet, of `columns` coefficients.
    #[must_use]
    pub fn new(columns: usize) -> Self {
        Self {
            gram: DMatrix::zeros(columns, columns),
            moment: DVector::zeros(columns),
            square: 0.0,
            rows: 0.0,
        }
    }

    /// Takes one row `a x = b`.
    pub fn add(&mut self, a: &[f64], b: f64) {
        debug_assert_eq!(a.len(), self.moment.len());
        for (j, aj) in a.iter().enumerate() {
            if *aj == 0.0 {
                continue;
            }
            for (i, ai) in a.iter().enumerate().take(j + 1) {
                self.gram[(i, j)] += ai * aj;
            }
            self.moment[j] += aj * b;
        }
        self.square += b * b;
        self.rows += 1.0;
    }

    /// Takes the rows of another batch, each column times a factor of its own.
    pub fn merge(&mut self, other: &Self, factor: impl Fn(usize) -> f64) {
        let n = self.moment.len();
        for j in 0..n {
            for i in 0..=j {
                self.gram[(i, j)] += factor(i) * factor(j) * other.gram[(i, j)];
            }
            self.moment[j] += factor(j) * other.moment[j];
        }
        self.square += other.square;
        self.rows += other.rows;
    }

    /// Rows taken.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows as usize
    }

    /// The x of least squares over the columns for which `keep` holds; others are zero.
    ///
    /// Columns are scaled to unit length first. `ridge`, relative to that, keeps the coefficients
    /// of nearly dependent columns bounded. None if there are no rows or the
    /// columns depend on one another.
    #[must_use]
    pub fn solve_columns(&self, ridge: f64, keep: impl Fn(usize) -> bool) -> Option<Solution> {
        let n = self.moment.len();
        let used: Vec<usize> = (0..n)
            .filter(|&i| keep(i) && self.gram[(i, i)] > 0.0)
            .collect();
        let scale: Vec<f64> = used.iter().map(|&i| self.gram[(i, i)].sqrt()).collect();
        let k = used.len();
        if k == 0 || self.rows == 0.0 {
            return None;
        }
        let scaled = DMatrix::from_fn(k, k, |a, b| {
            let (i, j) = (used[a].min(used[b]), used[a].max(used[b]));
            let own = if a == b { ridge } else { 0.0 };
            self.gram[(i, j)] / (scale[a] * scale[b]) + own
        });
        let right = DVector::from_fn(k, |a, _| self.moment[used[a]] / scale[a]);
        let factor = scaled.clone().cholesky()?;
        //= S17: x = (A' A)^-1 A' b, columns scaled to unit length
        let y = factor.solve(&right);
        let inverse = factor.inverse();
        // |A x - b|² without the ridge's part.
        let fitted = (y.transpose() * (&scaled * &y))[(0, 0)] - ridge * y.norm_squared();
        let rest = (self.square - 2.0 * y.dot(&right) + fitted).max(0.0);
        let variance = rest / (self.rows - k as f64).max(1.0);
        let (mut x, mut sigma) = (DVector::zeros(n), DVector::zeros(n));
        for (a, &i) in used.iter().enumerate() {
            x[i] = y[a] / scale[a];
            sigma[i] = (variance * inverse[(a, a)]).sqrt() / scale[a];
        }
        Some(Solution {
            x,
            sigma,
            rms: (rest / self.rows).sqrt(),
        })
    }

    /// The x of least squares over all columns.
    #[must_use]
    pub fn solve(&self, ridge: f64) -> Option<Solution> {
        self.solve_columns(ridge, |_| true)
    }

    /// The same with the coefficients for which `bounded` holds not below zero: those that come
    /// out negative are left out one by one, the most negative (by its own spread) first.
    #[must_use]
    pub fn solve_bounded(&self, ridge: f64, bounded: impl Fn(usize) -> bool) -> Option<Solution> {
        let mut dropped = vec![false; self.moment.len()];
        loop {
            let solution = self.solve_columns(ridge, |i| !dropped[i])?;
            let significance = |i: &usize| solution.x[*i] / solution.sigma[*i].max(1e-300);
            let worst = (0..dropped.len())
                .filter(|&i| bounded(i) && !dropped[i] && solution.x[i] < 0.0)
                .min_by(|a, b| significance(a).total_cmp(&significance(b)));
            match worst {
                Some(i) => dropped[i] = true,
                None => return Some(solution),
            }
        }
    }
}
