//! Least squares of six equations with up to six unknowns, on the stack.

/// A column of the equations, or a row of the inverse.
pub(crate) type Six = [f64; 6];

/// Columns whose remainder is shorter than this share of their length depend on the others.
const DEPENDENT: f64 = 1e-7;

pub(crate) fn dot(a: &Six, b: &Six) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn add_scaled(a: &mut Six, k: f64, b: &Six) {
    for (x, y) in a.iter_mut().zip(b) {
        *x += k * y;
    }
}

/// Rows of the pseudo-inverse of the matrix with the first `n` of `columns`; how many of the
/// columns are independent. With fewer than `n` the rows are undefined.
///
/// Gram and Schmidt, each column twice (which makes it as good as Householder's), longest
/// remainder first.
pub(crate) fn pseudo_inverse(columns: &[Six; 6], n: usize, rows: &mut [Six; 6]) -> usize {
    let n = n.min(6);
    let mut q = *columns;
    let mut r = [[0.0; 6]; 6];
    let mut order = [0, 1, 2, 3, 4, 5];
    let length: Six = std::array::from_fn(|k| dot(&columns[k], &columns[k]).sqrt());
    for k in 0..n {
        let share = |c: usize| dot(&q[c], &q[c]).sqrt() / length[c].max(f64::MIN_POSITIVE);
        let mut best = k;
        for other in k + 1..n {
            if share(order[other]) > share(order[best]) {
                best = other;
            }
        }
        order.swap(k, best);
        let c = order[k];
        let mut column = q[c];
        for &done in &order[..k] {
            let rest = dot(&q[done], &column);
            add_scaled(&mut column, -rest, &q[done]);
            r[done][c] += rest;
        }
        let norm = dot(&column, &column).sqrt();
        if norm.is_nan() || norm <= DEPENDENT * length[c] {
            return k;
        }
        column.iter_mut().for_each(|x| *x /= norm);
        q[c] = column;
        r[c][c] = norm;
        for &later in &order[k + 1..n] {
            let along = dot(&column, &q[later]);
            let remainder = &mut q[later];
            add_scaled(remainder, -along, &column);
            r[c][later] = along;
        }
    }
    // R x = Q^T b, from the last column back.
    for k in (0..n).rev() {
        let c = order[k];
        let mut row = q[c];
        for &later in &order[k + 1..n] {
            add_scaled(&mut row, -r[c][later], &rows[later]);
        }
        row.iter_mut().for_each(|x| *x /= r[c][c]);
        rows[c] = row;
    }
    n
}

/// A covariance whose component given those before has less than this share of its variance is
/// singular: the rest is rounding.
const SINGULAR: f64 = 1e-12;

/// `L^-1` of a symmetric positive definite matrix `L L^T`, by rows; false if it is not.
pub(crate) fn whitening(covariance: &[Six; 6], inverse: &mut [Six; 6]) -> bool {
    let mut l = [[0.0; 6]; 6];
    for i in 0..6 {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            let rest = covariance[i][j] - sum;
            if i == j {
                if rest.is_nan() || rest <= SINGULAR * covariance[i][i] {
                    return false;
                }
                l[i][i] = rest.sqrt();
            } else {
                l[i][j] = rest / l[j][j];
            }
        }
    }
    for i in 0..6 {
        let mut row = [0.0; 6];
        row[i] = 1.0;
        for (factor, above) in l[i][..i].iter().zip(&inverse[..i]) {
            add_scaled(&mut row, -factor, above);
        }
        inverse[i] = row.map(|x| x / l[i][i]);
    }
    true
}

/// `x^T S x` for a symmetric matrix.
pub(crate) fn quadratic(s: &[Six; 6], x: &Six) -> f64 {
    (0..6).map(|i| x[i] * dot(&s[i], x)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A few numbers without any order in them.
    fn numbers(seed: f64) -> [Six; 6] {
        std::array::from_fn(|i| {
            std::array::from_fn(|j| ((seed + 7.3 * i as f64 + 3.1 * j as f64).sin() * 43.7).fract())
        })
    }

    #[test]
    fn normal_equations_hold() {
        for n in 1..=6 {
            for seed in 0..20 {
                let a = numbers(f64::from(seed));
                let mut rows = [[0.0; 6]; 6];
                assert_eq!(pseudo_inverse(&a, n, &mut rows), n);
                let b = numbers(-1.0 - f64::from(seed))[0];
                let x: Vec<f64> = rows[..n].iter().map(|row| dot(row, &b)).collect();
                let mut rest = b;
                for (k, x) in x.iter().enumerate() {
                    add_scaled(&mut rest, -x, &a[k]);
                }
                // The remainder is perpendicular to every column.
                for column in &a[..n] {
                    assert!(dot(column, &rest).abs() < 1e-11, "{n} {seed}");
                }
            }
        }
    }

    #[test]
    fn dependent_columns_are_counted() {
        let mut a = numbers(3.0);
        a[2] = std::array::from_fn(|k| a[0][k] - 2.0 * a[1][k]);
        assert_eq!(pseudo_inverse(&a, 3, &mut [[0.0; 6]; 6]), 2);
        assert_eq!(pseudo_inverse(&a, 6, &mut [[0.0; 6]; 6]), 5);
    }

    #[test]
    fn whitening_whitens() {
        let a = numbers(9.0);
        let s: [Six; 6] = std::array::from_fn(|i| std::array::from_fn(|j| dot(&a[i], &a[j])));
        let mut w = [[0.0; 6]; 6];
        assert!(whitening(&s, &mut w));
        for (i, row) in w.iter().enumerate() {
            assert!((quadratic(&s, row) - 1.0).abs() < 1e-9, "{i}");
        }
        assert!(!whitening(&[[1.0; 6]; 6], &mut w));
    }
}
