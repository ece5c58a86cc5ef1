//! Columns of numbers with stamps, complete in every row.

use problem::{Problem, listed};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use table::Table;

/// Stamps and columns of a log.
pub(crate) struct Rows {
    /// Stamps in the file's unit, increasing.
    pub(crate) t: Vec<f64>,
    /// Columns by name.
    pub(crate) columns: BTreeMap<String, Vec<f64>>,
}

/// A log's table; without a `delimiter` its header shows it.
///
/// # Errors
/// As [`Table::new`].
pub(crate) fn open(
    path: &Path,
    delimiter: Option<char>,
) -> Result<Table<BufReader<File>>, Problem> {
    let log = path.display().to_string();
    let file = File::open(path).map_err(|e| Problem::unreadable(&log, &e))?;
    Table::new(BufReader::new(file), &log, delimiter)
}

/// Prints that a log ends within its last row.
pub(crate) fn warn_of_cut(is_cut: bool, path: &Path) {
    if is_cut {
        let log = path.display();
        eprintln!("warning: {log}: the file ends within its last row, which is left out");
    }
}

impl Rows {
    /// Reads the column of stamps and those for which `used` holds.
    ///
    /// # Errors
    /// A file that cannot be read, fields that are not finite numbers, stamps that do not
    /// increase, each with its line.
    pub(crate) fn read(
        path: &Path,
        time: &str,
        used: impl Fn(&str) -> bool,
    ) -> Result<Self, Problem> {
        Self::read_each(path, &[time], used, |table, t, last| {
            if t > last {
                return Ok(());
            }
            let reason = format!("`{time}` is {t} after {last}");
            Err(table.problem(reason, "stamps that increase"))
        })
    }

    /// Reads the column of stamps, of one of these names and which need not increase, and those for
    /// which `used` holds.
    ///
    /// # Errors
    /// A file that cannot be read, fields that are not finite numbers, each with its line.
    pub(crate) fn read_in_order_of_rows(
        path: &Path,
        times: &[&str],
        used: impl Fn(&str) -> bool,
    ) -> Result<Self, Problem> {
        Self::read_each(path, times, used, |_, _, _| Ok(()))
    }

    fn read_each(
        path: &Path,
        times: &[&str],
        used: impl Fn(&str) -> bool,
        check: impl Fn(&Table<BufReader<File>>, f64, f64) -> Result<(), Problem>,
    ) -> Result<Self, Problem> {
        let mut table = open(path, None)?;
        let names = table.names();
        let Some(time) = names.iter().find(|name| times.contains(&name.as_str())) else {
            let wanted = times.first().unwrap_or(&"");
            let reason = format!("column `{wanted}` is missing among `{}`", names.join(","));
            let allowed = format!("stamps in a column named {}", listed(times.iter().copied()));
            return Err(table.problem(reason, allowed));
        };
        let mut places = vec![table.column(time)?.unwrap_or(0)];
        let chosen: Vec<String> = (names.iter())
            .filter(|name| *name != time && !name.is_empty() && used(name))
            .cloned()
            .collect();
        for name in &chosen {
            places.extend(table.column(name)?);
        }
        places
            .iter()
            .try_for_each(|place| table.require_si(*place))?;
        let mut values = vec![Vec::new(); places.len()];
        while table.next_row()? {
            for (column, place) in values.iter_mut().zip(&places) {
                column.push(table.number(*place)?);
            }
            if let [.., last, t] = values[0][..] {
                check(&table, t, last)?;
            }
        }
        warn_of_cut(table.is_cut(), path);
        let t = values.remove(0);
        if t.len() < 2 {
            let reason = format!("the log has {} rows", t.len());
            let log = path.display().to_string();
            return Err(Problem::new(reason, "at least two").at(log, 0));
        }
        let columns = chosen.into_iter().zip(values).collect();
        Ok(Self { t, columns })
    }
}
