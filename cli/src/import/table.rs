//! A log as columns: CSV with one stamp a row.

use super::map::{ColumnName, Map};
use super::resample::Column;
use crate::rows::Rows;
use problem::Problem;
use std::collections::BTreeMap;
use std::path::Path;

/// Columns of a log, by name.
pub(super) struct Table {
    log: String,
    columns: BTreeMap<String, Column>,
}

impl Table {
    /// Reads a log.
    ///
    /// # Errors
    /// A file that cannot be read, with its line; fields that are not finite numbers; time that
    /// does not increase.
    pub(super) fn read(path: &Path, map: &Map) -> Result<Self, Problem> {
        let log = path.display().to_string();
        Self::read_csv(path, map, log)
    }

    /// A column by the name that the map gives.
    ///
    /// # Errors
    /// A name that the log does not have.
    pub(super) fn column(&self, name: &ColumnName, map: &Map) -> Result<Column, Problem> {
        let found = self.columns.get(name.get_ref()).cloned();
        found.ok_or_else(|| map.missing(name, &self.log, self.columns.keys().map(String::as_str)))
    }

    fn read_csv(path: &Path, map: &Map, log: String) -> Result<Self, Problem> {
        let Some(time) = &map.time else {
            let reason = "[time] is missing: CSV has no stamps of its own";
            return Err(Problem::new(reason, "a table [time]").at(map.file.as_str(), 0));
        };
        let delimiter = u8::try_from(map.delimiter).map_err(|_| {
            let reason = format!("delimiter {:?}", map.delimiter);
            Problem::new(reason, "an ASCII character").at(map.file.as_str(), 0)
        })?;
        // Columns that the map does not name may hold anything.
        let read = Rows::read(path, delimiter, time.column.get_ref(), |name| {
            map.names(name)
        })?;
        let t: Vec<f64> = read.t.iter().map(|t| t * time.seconds()).collect();
        let column = |values| Column {
            t: t.clone(),
            values,
        };
        let columns = read
            .columns
            .into_iter()
            .map(|(name, values)| (name, column(values)));
        Ok(Self {
            log,
            columns: columns.collect(),
        })
    }
}
