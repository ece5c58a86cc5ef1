//! Least squares: accelerations that come near to wanted ones and fulfil equations, each as exactly as it is soft.
//!
//! ```text
//! least  sum w_i (a_i - a0_i)^2 + sum (G a - g)_k^2 / s_k
//! a = a0 + W^-1 G^T y      (G W^-1 G^T + S) y = g - G a0
//! ```
//!
//! An equation with `s = 0` is a constraint, one with more gives way where others speak against it. Above nothing,
//! `s` damps what is singular: a leg that is stretched out. The matrix has a row for each equation, not for each joint.

/// Most feet on which a robot stands.
pub const MAX_FEET: usize = 4;
/// Equations: six for each foot, two for the centre of mass, three for the base's orientation.
const MAX_ROWS: usize = 6 * MAX_FEET + 5;

/// The equations of a cycle.
#[derive(Debug, Clone)]
pub(super) struct LeastSquares {
    /// 1 / w of each acceleration.
    pub(super) inverse_weights: Vec<f64>,
    /// Rows of G, one after the other.
    rows: Vec<f64>,
    wanted: [f64; MAX_ROWS],
    softness: [f64; MAX_ROWS],
    count: usize,
    factor: Box<[[f64; MAX_ROWS]; MAX_ROWS]>,
}

impl LeastSquares {
    pub(super) fn new(unknowns: usize) -> Self {
        Self {
            inverse_weights: vec![1.0; unknowns],
            rows: vec![0.0; MAX_ROWS * unknowns],
            wanted: [0.0; MAX_ROWS],
            softness: [0.0; MAX_ROWS],
            count: 0,
            factor: Box::new([[0.0; MAX_ROWS]; MAX_ROWS]),
        }
    }

    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds an equation; its row of G is to be written, and is zero. Beyond the most there is no room: an empty row.
    pub(super) fn equation(&mut self, wanted: f64, softness: f64) -> &mut [f64] {
        let n = self.inverse_weights.len();
        let k = self.count;
        if k >= MAX_ROWS {
            return &mut [];
        }
        self.count += 1;
        (self.wanted[k], self.softness[k]) = (wanted, softness);
        let row = self.rows.get_mut(k * n..(k + 1) * n).unwrap_or_default();
        row.fill(0.0);
        row
    }

    /// Leads `a` from the wanted accelerations to those that come nearest to all. False where there is no solution: `a`
    /// is as it was.
    pub(super) fn solve(&mut self, a: &mut [f64]) -> bool {
        let (n, count) = (self.inverse_weights.len().max(1), self.count);
        let row = |k: usize| self.rows.get(k * n..(k + 1) * n).unwrap_or_default();
        let mut y = [0.0; MAX_ROWS];
        for k in 0..count {
            for m in 0..=k {
                let products = row(k).iter().zip(row(m)).zip(&self.inverse_weights);
                let product: f64 = products.map(|((x, y), w)| x * y * w).sum();
                self.factor[k][m] = product + if k == m { self.softness[k] } else { 0.0 };
            }
            let now: f64 = row(k).iter().zip(a.iter()).map(|(g, a)| g * a).sum();
            y[k] = self.wanted[k] - now;
        }
        if !solve_in_place(&mut self.factor, &mut y[..count]) {
            return false;
        }
        for (k, y) in y.iter().enumerate().take(count) {
            let row = self.rows.get(k * n..(k + 1) * n).unwrap_or_default();
            for ((a, g), w) in a.iter_mut().zip(row).zip(&self.inverse_weights) {
                *a += w * g * y;
            }
        }
        true
    }
}

/// Solves `S x = y` in place, by a Cholesky factor that takes the place of the lower half of `S`. False if `S` is not
/// positive definite, or the result not finite.
fn solve_in_place(s: &mut [[f64; MAX_ROWS]; MAX_ROWS], y: &mut [f64]) -> bool {
    for k in 0..y.len() {
        for m in 0..=k {
            let products = s[k].iter().zip(&s[m]).take(m);
            let rest = s[k][m] - products.map(|(x, y)| x * y).sum::<f64>();
            if m < k {
                s[k][m] = rest / s[m][m];
            } else if rest > f64::MIN_POSITIVE {
                s[k][k] = rest.sqrt();
            } else {
                return false;
            }
        }
        let before: f64 = s[k].iter().zip(y.iter()).take(k).map(|(l, y)| l * y).sum();
        y[k] = (y[k] - before) / s[k][k];
    }
    for k in (0..y.len()).rev() {
        let after: f64 = (k + 1..y.len()).map(|m| s[m][k] * y[m]).sum();
        y[k] = (y[k] - after) / s[k][k];
    }
    y.iter().all(|y| y.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use test_support::Random;

    /// Equations among 36 accelerations, and the same as one dense system for a QR of nalgebra: rows of weights and of
    /// equations, each divided by the root of its softness.
    fn drawn(random: &mut Random, softness: &[f64]) -> (LeastSquares, DMatrix<f64>, DVector<f64>) {
        let n = 36;
        let mut own = LeastSquares::new(n);
        let rows = n + softness.len();
        let mut a = DMatrix::zeros(rows, n);
        let mut b = DVector::zeros(rows);
        for i in 0..n {
            let weight = 0.1 + 10.0 * random.unit();
            own.inverse_weights[i] = 1.0 / weight;
            a[(i, i)] = weight.sqrt();
        }
        for (k, softness) in softness.iter().enumerate() {
            let wanted = 5.0 * random.symmetric();
            let row = own.equation(wanted, *softness);
            for (i, x) in row.iter_mut().enumerate() {
                *x = random.symmetric();
                a[(n + k, i)] = *x / softness.sqrt();
            }
            b[n + k] = wanted / softness.sqrt();
        }
        (own, a, b)
    }

    #[test]
    fn it_is_what_a_dense_qr_finds() {
        let mut random = Random::new(7);
        for _ in 0..20 {
            let (mut own, a, b) = drawn(&mut random, &[1e-3, 0.1, 1.0, 1e-2, 0.5, 1e-4, 2.0]);
            let wanted: Vec<f64> = (0..36).map(|_| 3.0 * random.symmetric()).collect();
            let mut all = b.clone();
            for (i, wanted) in wanted.iter().enumerate() {
                all[i] = a[(i, i)] * wanted;
            }
            let dense = a.clone().qr();
            let right = dense.q().transpose() * all;
            let solution = dense.r().solve_upper_triangular(&right).unwrap();
            let mut found = wanted;
            assert!(own.solve(&mut found));
            for (found, solution) in found.iter().zip(solution.iter()) {
                assert!((found - solution).abs() < 1e-8, "{found} {solution}");
            }
        }
    }

    #[test]
    fn an_equation_without_softness_is_a_constraint() {
        let mut random = Random::new(8);
        let (mut own, _, _) = drawn(&mut random, &[1.0; 12]);
        own.softness = [0.0; MAX_ROWS];
        let mut a = vec![1.0; 36];
        assert!(own.solve(&mut a));
        for k in 0..12 {
            let row = &own.rows[36 * k..36 * (k + 1)];
            let is: f64 = row.iter().zip(&a).map(|(g, a)| g * a).sum();
            assert!((is - own.wanted[k]).abs() < 1e-9);
        }
    }

    #[test]
    fn what_contradicts_itself_is_refused_without_softness_and_shared_with_it() {
        let mut own = LeastSquares::new(3);
        own.equation(1.0, 0.0)[0] = 1.0;
        own.equation(3.0, 0.0)[0] = 1.0;
        let mut a = [0.0; 3];
        assert!(!own.solve(&mut a));
        assert_eq!(a, [0.0; 3]);
        own.softness = [1e-9; MAX_ROWS];
        assert!(own.solve(&mut a));
        assert!((a[0] - 2.0).abs() < 1e-6, "{a:?}");
    }

    #[test]
    fn there_is_no_room_beyond_the_most() {
        let mut own = LeastSquares::new(2);
        for _ in 0..MAX_ROWS {
            assert_eq!(own.equation(0.0, 1.0).len(), 2);
        }
        assert!(own.equation(0.0, 1.0).is_empty());
        assert!(own.solve(&mut [1.0, 2.0]));
    }
}
