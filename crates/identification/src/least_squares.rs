//! Linear least squares: all at once (S 15-17, D7), and row by row (S 20-25).

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

    /// Rows taken.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows as usize
    }

    /// The x of least squares over the columns for which `keep` holds; others are zero.
    ///
    /// Columns are scaled to unit length first. `ridge`, relative to that, keeps columns that the
    /// data do not tell apart from growing without bound. None if there are no rows or the
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

/// Recursive least squares with a covariance that stays positive definite.
///
/// The same updates as S 20-25 (Sherman-Morrison), but on the factors of `P = U D U'` (Bierman):
/// subtracting `P a a' P / (1 + a' P a)` from P itself loses symmetry and sign to rounding within
/// some 10^5 rows, the factors cannot.
#[derive(Debug, Clone)]
pub struct Recursive {
    x: DVector<f64>,
    /// Unit upper triangle, and D on the diagonal.
    factors: DMatrix<f64>,
    forgetting: f64,
    /// Largest D: with forgetting, what is not excited would grow without bound.
    largest: f64,
    gain: DVector<f64>,
}

impl Recursive {
    /// Starts from `x` with standard deviations `sigma`, for rows whose error has a standard
    /// deviation of 1; `forgetting` is 1 (none) or a little less.
    #[must_use]
    pub fn new(x: &[f64], sigma: &[f64], forgetting: f64) -> Self {
        debug_assert!(x.len() == sigma.len() && forgetting > 0.0 && forgetting <= 1.0);
        let variances = DVector::from_iterator(x.len(), sigma.iter().map(|s| s * s));
        Self {
            x: DVector::from_column_slice(x),
            largest: variances.max(),
            factors: DMatrix::from_diagonal(&variances),
            forgetting,
            gain: DVector::zeros(x.len()),
        }
    }

    /// Takes one row `a x = b`; what it changes.
    pub fn update(&mut self, a: &[f64], b: f64) {
        let n = self.x.len();
        if a.len() != n || !b.is_finite() || a.iter().any(|x| !x.is_finite()) {
            return;
        }
        let error = b - self.x.iter().zip(a).map(|(x, a)| x * a).sum::<f64>();
        // Bierman's update: column by column of U, with f = U' a and v = D f.
        let u = &mut self.factors;
        let mut alpha = self.forgetting;
        for j in 0..n {
            let f = a[j] + (0..j).map(|i| u[(i, j)] * a[i]).sum::<f64>();
            let v = u[(j, j)] * f;
            let next = alpha + v * f;
            u[(j, j)] = (u[(j, j)] * alpha / (next * self.forgetting)).min(self.largest);
            self.gain[j] = v;
            let p = -f / alpha;
            for i in 0..j {
                let old = u[(i, j)];
                u[(i, j)] = old + self.gain[i] * p;
                self.gain[i] += v * old;
            }
            alpha = next;
        }
        for (x, gain) in self.x.iter_mut().zip(self.gain.iter()) {
            *x += gain * error / alpha;
        }
    }

    /// x: coefficients.
    #[must_use]
    pub fn coefficients(&self) -> &[f64] {
        self.x.as_slice()
    }

    /// P: covariance of the coefficients.
    #[must_use]
    pub fn covariance(&self) -> DMatrix<f64> {
        let n = self.x.len();
        let d = DMatrix::from_diagonal(&self.factors.diagonal());
        let u = DMatrix::from_fn(n, n, |i, j| match i.cmp(&j) {
            std::cmp::Ordering::Less => self.factors[(i, j)],
            std::cmp::Ordering::Equal => 1.0,
            std::cmp::Ordering::Greater => 0.0,
        });
        &u * d * u.transpose()
    }
}
