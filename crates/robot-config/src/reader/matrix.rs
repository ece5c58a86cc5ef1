//! Square matrices.

use super::{Allowed, Section};

impl Section<'_, '_> {
    /// An `N` by `N` matrix of finite numbers, a list of rows; NaN stands for numbers that were
    /// noted as wrong.
    pub(crate) fn matrix_or<const N: usize>(
        &self,
        key: &'static str,
        default: [[f64; N]; N],
    ) -> [[f64; N]; N] {
        if !self.has(key) {
            return default;
        }
        let allowed = format!("a list of {N} rows, each a list of {N} finite numbers");
        let mut matrix = [[f64::NAN; N]; N];
        let rows = self.items(key, N, &allowed).unwrap_or_default();
        for (row, item) in matrix.iter_mut().zip(rows) {
            match item.get_ref().as_array() {
                Some(numbers) if numbers.len() == N => {
                    for (number, item) in row.iter_mut().zip(numbers.iter()) {
                        *number = self.as_number(key, item, Allowed::Finite);
                    }
                }
                _ => self.wrong(key, item, &allowed),
            }
        }
        matrix
    }
}
