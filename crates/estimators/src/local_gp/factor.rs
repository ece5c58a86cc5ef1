//! A Cholesky factor that grows and shrinks by one point at a time.

/// L with `A = L L'`, A symmetric and positive definite, row by row.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Factor {
    size: usize,
    /// Rows of the lower triangle, one after the other: row i has i + 1 entries.
    rows: Vec<f64>,
}

impl Factor {
    /// A's size.
    #[must_use]
    pub fn size(&self) -> usize {
        self.size
    }

    /// Row i of L.
    #[must_use]
    pub fn row(&self, i: usize) -> &[f64] {
        let start = i * (i + 1) / 2;
        &self.rows[start..start + i + 1]
    }

    /// Appends a row and column: `column` has the entries beside the old ones, `diagonal` the last.
    /// Gives false, and changes nothing, if the matrix would not be positive definite.
    pub fn push(&mut self, column: &[f64], diagonal: f64) -> bool {
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

    /// Takes row and column i out: the rows below take the removed column in by a rank-one update,
    /// which only adds, so that rounding cannot spoil it.
    pub fn remove(&mut self, i: usize) {
        debug_assert!(i < self.size);
        let mut taken = Vec::with_capacity(self.size - i - 1);
        let mut rows = Vec::with_capacity(self.rows.len());
        for k in 0..self.size {
            let row = self.row(k);
            if k < i {
                rows.extend_from_slice(row);
            } else if k > i {
                taken.push(row[i]);
                rows.extend_from_slice(&row[..i]);
                rows.extend_from_slice(&row[i + 1..]);
            }
        }
        self.rows = rows;
        self.size -= 1;
        self.update_from(i, &mut taken);
    }

    /// The factor of `A + x x'`, x being zero before `first`.
    fn update_from(&mut self, first: usize, x: &mut [f64]) {
        for k in 0..x.len() {
            let column = first + k;
            let at = |row: usize| row * (row + 1) / 2 + column;
            let pivot = self.rows[at(column)];
            let grown = pivot.hypot(x[k]);
            let (c, s) = (pivot / grown, x[k] / grown);
            self.rows[at(column)] = grown;
            for (below, x) in x.iter_mut().enumerate().skip(k + 1) {
                let entry = &mut self.rows[at(first + below)];
                let (l, old) = (*entry, *x);
                *entry = c * l + s * old;
                *x = c * old - s * l;
            }
        }
    }

    /// L^-1 b, in place.
    pub fn solve_lower(&self, b: &mut [f64]) {
        debug_assert_eq!(b.len(), self.size);
        solve_lower(&self.rows, b);
    }

    /// A^-1 b, in place.
    pub fn solve(&self, b: &mut [f64]) {
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
