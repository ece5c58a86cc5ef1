//! A Cholesky factor that grows by one point at a time.

/// L with `A = L L'`, A symmetric and positive definite, row by row.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Factor {
    size: usize,
    /// Rows of the lower triangle, one after the other: row i has i + 1 entries.
    rows: Vec<f64>,
}

impl Factor {
    /// Row i of L.
    fn row(&self, i: usize) -> &[f64] {
        let start = i * (i + 1) / 2;
        &self.rows[start..start + i + 1]
    }

    /// Appends a row and column: `column` has the entries beside the old ones, `diagonal` the last.
    /// Gives false, and changes nothing, if the matrix would not be positive definite.
    pub(super) fn push(&mut self, column: &[f64], diagonal: f64) -> bool {
        debug_assert_eq!(column.len(), self.size);
        let start = self.rows.len();
        self.rows.extend_from_slice(column);
        let (old, new) = self.rows.split_at_mut(start);
        solve_lower(old, new);
        let pivot = diagonal - new.iter().map(|x| x * x).sum::<f64>();
        if pivot > 0.0 && pivot.is_finite() {
            self.rows.push(pivot.sqrt());
            self.size += 1;
            true
        } else {
            self.rows.truncate(start);
            false
        }
    }

    /// L^-1 b, in place.
    pub(super) fn solve_lower(&self, b: &mut [f64]) {
        debug_assert_eq!(b.len(), self.size);
        solve_lower(&self.rows, b);
    }

    /// A^-1 b, in place.
    pub(super) fn solve(&self, b: &mut [f64]) {
        self.solve_lower(b);
        for i in (0..self.size).rev() {
            let row = self.row(i);
            let x = b[i] / row[i];
            b[i] = x;
            for (b, l) in b[..i].iter_mut().zip(row) {
                *b -= l * x;
            }
        }
    }
}

/// Solves `L x = b` in place for as many rows as b has entries.
fn solve_lower(rows: &[f64], b: &mut [f64]) {
    let mut rows = rows;
    for i in 0..b.len() {
        let (row, rest) = rows.split_at(i + 1);
        rows = rest;
        let (known, unknown) = b.split_at_mut(i);
        let sum: f64 = row.iter().zip(known.iter()).map(|(l, x)| l * x).sum();
        unknown[0] = (unknown[0] - sum) / row[i];
    }
}

#[cfg(test)]
mod tests {
    use super::Factor;

    #[test]
    fn a_point_that_cannot_be_factored_changes_nothing() {
        let mut factor = Factor::default();
        assert!(factor.push(&[], 4.0) && factor.push(&[2.0], 5.0));
        let before = factor.clone();
        assert!(!factor.push(&[2.0, 5.0], 5.0), "a copy of the last row");
        assert!(!factor.push(&[f64::NAN, 0.0], 5.0));
        assert_eq!(factor, before);
        assert_eq!(
            (factor.row(0), factor.row(1)),
            (&[2.0][..], &[1.0, 2.0][..])
        );
        let mut x = [8.0, 14.0];
        factor.solve(&mut x);
        assert_eq!(x, [0.75, 2.5]);
    }
}
