//! Columns of text.

use std::fmt;

/// Rows of cells, shown in aligned columns; the first row is the heading. A column is aligned to
/// the right where every cell below its heading begins like a number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextTable(pub Vec<Vec<String>>);

impl fmt::Display for TextTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let columns = self.0.iter().map(Vec::len).max().unwrap_or(0);
        let column = |i: usize| self.0.iter().filter_map(move |row| row.get(i));
        let layout: Vec<(usize, bool)> = (0..columns)
            .map(|i| {
                let width = column(i).map(|cell| cell.chars().count()).max();
                let numeric = column(i).skip(1).all(|cell| is_numeric(cell));
                (width.unwrap_or(0), numeric)
            })
            .collect();
        for row in &self.0 {
            let mut line = String::new();
            for (cell, &(width, numeric)) in row.iter().zip(&layout) {
                let cell = if numeric {
                    format!("{cell:>width$}")
                } else {
                    format!("{cell:<width$}")
                };
                line.push_str("  ");
                line.push_str(&cell);
            }
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

fn is_numeric(cell: &str) -> bool {
    cell == "-" || cell.starts_with(|c: char| c.is_ascii_digit() || c == '-' || c == '±')
}
