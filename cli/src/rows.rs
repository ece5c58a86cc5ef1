//! Columns of numbers from CSV with a header and stamps.

use problem::{Allowed, Problem, listed};
use std::collections::BTreeMap;
use std::path::Path;

/// Stamps and columns of a log.
pub(crate) struct Rows {
    /// Stamps in the file's unit, increasing.
    pub(crate) t: Vec<f64>,
    /// Line of each row.
    pub(crate) lines: Vec<usize>,
    /// Columns by name.
    pub(crate) columns: BTreeMap<String, Vec<f64>>,
}

impl Rows {
    /// Reads the column of stamps and those for which `used` holds.
    ///
    /// # Errors
    /// A file that cannot be read, fields that are not finite numbers, stamps that do not
    /// increase, each with its line.
    pub(crate) fn read(
        path: &Path,
        delimiter: u8,
        time: &str,
        used: impl Fn(&str) -> bool,
    ) -> Result<Self, Problem> {
        let rows = Self::read_in_order_of_rows(path, delimiter, &[time], used)?;
        let backwards = rows.t.windows(2).position(|w| w[1] <= w[0]);
        if let Some(row) = backwards {
            let reason = format!("`{time}` is {} after {}", rows.t[row + 1], rows.t[row]);
            let place = rows.lines.get(row + 1).copied().unwrap_or(0);
            return Err(
                Problem::new(reason, "stamps that increase").at(path.display().to_string(), place)
            );
        }
        Ok(rows)
    }

    /// Reads the column of stamps, of one of these names and which need not increase, and those for
    /// which `used` holds.
    ///
    /// # Errors
    /// A file that cannot be read, fields that are not finite numbers, each with its line.
    pub(crate) fn read_in_order_of_rows(
        path: &Path,
        delimiter: u8,
        times: &[&str],
        used: impl Fn(&str) -> bool,
    ) -> Result<Self, Problem> {
        let log = path.display().to_string();
        let of_csv = |e: csv::Error| {
            let line = e.position().map_or(0, |p| p.line() as usize);
            Problem::new(format!("cannot be read: {e}"), "").at(log.as_str(), line)
        };
        let mut reader = csv::ReaderBuilder::new()
            .delimiter(delimiter)
            .trim(csv::Trim::All)
            .from_path(path)
            .map_err(of_csv)?;
        let header = reader.headers().map_err(of_csv)?;
        let names: Vec<String> = header
            .iter()
            .map(|n| n.trim_start_matches('\u{feff}').to_owned())
            .collect();
        let time = |n: &String| times.contains(&n.as_str());
        let at = names.iter().position(time).ok_or_else(|| {
            let reason = format!("column `{}` is missing", times.first().unwrap_or(&""));
            Problem::new(reason, listed(names.iter().map(String::as_str))).at(log.as_str(), 1)
        })?;
        let used: Vec<usize> = (0..names.len())
            .filter(|&i| i != at && used(&names[i]))
            .collect();
        let (mut t, mut lines): (Vec<f64>, Vec<usize>) = (Vec::new(), Vec::new());
        let mut values = vec![Vec::new(); used.len()];
        let mut record = csv::StringRecord::new();
        while reader.read_record(&mut record).map_err(of_csv)? {
            let line = record.position().map_or(0, |p| p.line() as usize);
            let number = |i: usize| {
                let field = record.get(i).unwrap_or("");
                let number = field.parse::<f64>().ok().filter(|x| x.is_finite());
                number.ok_or_else(|| {
                    let reason = format!("`{}` is `{field}`", names[i]);
                    Problem::new(reason, Allowed::Finite.to_string()).at(log.as_str(), line)
                })
            };
            t.push(number(at)?);
            lines.push(line);
            for (column, &i) in values.iter_mut().zip(&used) {
                column.push(number(i)?);
            }
        }
        if t.len() < 2 {
            let reason = format!("the log has {} rows", t.len());
            return Err(Problem::new(reason, "at least two").at(log, 0));
        }
        let columns = used.iter().map(|&i| names[i].clone()).zip(values).collect();
        Ok(Self { t, lines, columns })
    }
}
