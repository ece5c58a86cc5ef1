//! A log as columns: CSV with one stamp a row, or MCAP with a stamp for each message.

use super::map::{ColumnName, Map};
use super::resample::Column;
use crate::rows::Rows;
use problem::Problem;
use recording::{Ending, READ_SCHEMAS, Signal};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
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
        match path
            .extension()
            .is_some_and(|extension| extension == "mcap")
        {
            true => Self::read_mcap(path, log),
            false => Self::read_csv(path, map, log),
        }
    }

    fn read_mcap(path: &Path, log: String) -> Result<Self, Problem> {
        let unreadable = |why: &dyn std::fmt::Display| {
            Problem::new(why.to_string(), "a readable MCAP file").at(log.as_str(), 0)
        };
        let file = File::open(path).map_err(|e| unreadable(&format!("cannot be read: {e}")))?;
        let (signals, ending) =
            recording::read_signals(BufReader::new(file)).map_err(|e| unreadable(&e))?;
        if signals.columns.is_empty() {
            let others = signals.others.iter();
            let others: Vec<String> = others
                .map(|(topic, what)| format!("{topic} ({what})"))
                .collect();
            let reason = format!(
                "has no signal that can be read; topics: {}",
                others.join(", ")
            );
            let allowed = format!("{} as cdr", READ_SCHEMAS.join(", "));
            return Err(Problem::new(reason, allowed).at(log.as_str(), 0));
        }
        if signals.passed_over > 0 {
            let count = signals.passed_over;
            eprintln!(
                "warning: {log}: {count} messages that are broken or out of order are left out"
            );
        }
        match ending {
            Ending::Complete => {}
            Ending::Truncated => eprintln!("warning: {log}: the file ends too early"),
            Ending::Damaged(why) => eprintln!("warning: {log}: damaged, read up to there: {why}"),
        }
        let column = |signal: Signal| Column {
            t: signal.t,
            values: signal.values,
        };
        let columns = signals.columns.into_iter();
        Ok(Self {
            log,
            columns: columns
                .map(|(name, signal)| (name, column(signal)))
                .collect(),
        })
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
