//! A log as columns: CSV with stamps in columns, or MCAP of ROS 2 with a stamp for each message.

use super::formats::{Format, by_rosbags};
use super::map::{ColumnName, Map, Time};
use super::resample::Column;
use crate::rows::{open, warn_of_cut};
use problem::Problem;
use recording::{Ending, READ_SCHEMAS, Signals};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Columns of a log, by name.
pub(super) struct Table {
    log: String,
    columns: Columns,
}

enum Columns {
    /// With a stamp for each value.
    Stamped(BTreeMap<String, Column>),
    /// A table of text: values where cells are not empty, the line of each row, all names of the header.
    Cells {
        values: BTreeMap<String, Vec<Option<f64>>>,
        lines: Vec<usize>,
        names: Vec<String>,
    },
}

impl Table {
    /// Reads a log; what it is follows from how it begins.
    ///
    /// # Errors
    /// A file that cannot be read, with its line; fields that are no numbers; a format that is not
    /// read.
    pub(super) fn read(path: &Path, map: &Map) -> Result<Self, Problem> {
        let log = path.display().to_string();
        let columns = match Format::of(path)? {
            Format::Mcap => Self::read_mcap(path, &log)?,
            Format::Sqlite => stamped(super::bag::read(path)?, &log, path)?,
            Format::Text => Self::read_csv(path, map)?,
        };
        Ok(Self { log, columns })
    }

    /// Line of a row of a column of `count` rows; 0 of a recording, and where columns have rows of their own.
    pub(super) fn line(&self, row: usize, count: usize) -> usize {
        match &self.columns {
            Columns::Cells { lines, .. } if lines.len() == count => {
                lines.get(row).copied().unwrap_or(0)
            }
            _ => 0,
        }
    }

    fn read_mcap(path: &Path, log: &str) -> Result<Columns, Problem> {
        let unreadable = |why: &dyn std::fmt::Display| {
            Problem::new(why.to_string(), "a readable MCAP file").at(log, 0)
        };
        let file = File::open(path).map_err(|e| unreadable(&format!("cannot be read: {e}")))?;
        let (signals, ending) =
            recording::read_signals(BufReader::new(file)).map_err(|e| unreadable(&e))?;
        match ending {
            Ending::Complete => {}
            Ending::Truncated => eprintln!("warning: {log}: the file ends too early"),
            Ending::Damaged(why) => eprintln!("warning: {log}: damaged, read up to there: {why}"),
        }
        stamped(signals, log, path)
    }

    fn read_csv(path: &Path, map: &Map) -> Result<Columns, Problem> {
        if map.time.is_none() {
            let reason = "[time] is missing: CSV has no stamps of its own";
            return Err(Problem::new(reason, "a table [time]").at(map.file.as_str(), 0));
        }
        let mut table = open(path, map.delimiter)?;
        // Columns that the map does not name may hold anything.
        let mut places = Vec::new();
        for name in map.names() {
            places.extend(table.column(name)?.map(|place| (name.to_owned(), place)));
        }
        let mut values = vec![Vec::new(); places.len()];
        let mut lines = Vec::new();
        while table.next_row()? {
            lines.push(table.line());
            for (column, (_, place)) in values.iter_mut().zip(&places) {
                column.push(table.optional(*place)?);
            }
        }
        if lines.len() < 2 {
            let reason = format!("the log has {} rows", lines.len());
            let log = path.display().to_string();
            return Err(Problem::new(reason, "at least two").at(log, 0));
        }
        warn_of_cut(table.is_cut(), path);
        for (name, place) in &places {
            let stated = table.unit(*place).map(|unit| unit.factor);
            if let Some(problem) = stated.and_then(|factor| map.contradicts(name, factor)) {
                return Err(problem);
            }
        }
        let names = places.into_iter().map(|(name, _)| name);
        Ok(Columns::Cells {
            values: names.zip(values).collect(),
            lines,
            names: table.names().to_vec(),
        })
    }

    /// A column by the name that the map gives, in CSV with the stamps of `time` or else of `[time]`.
    ///
    /// # Errors
    /// A name that the log does not have, fewer than two values, stamps that are missing or do not
    /// increase.
    pub(super) fn column(
        &self,
        name: &ColumnName,
        time: Option<&Time>,
        map: &Map,
    ) -> Result<Column, Problem> {
        match &self.columns {
            Columns::Stamped(columns) => {
                let found = columns.get(name.get_ref()).cloned();
                let names = || columns.keys().map(String::as_str);
                found.ok_or_else(|| map.missing(name, &self.log, names()))
            }
            Columns::Cells {
                values,
                lines,
                names,
            } => {
                let cells = |name: &ColumnName| {
                    let names = || names.iter().map(String::as_str);
                    let found = values.get(name.get_ref());
                    found.ok_or_else(|| map.missing(name, &self.log, names()))
                };
                let Some(time) = time.or(map.time.as_ref()) else {
                    return Err(map.missing(name, &self.log, []));
                };
                let parts = time.parts().into_iter();
                let stamps = parts
                    .map(|(column, seconds)| Ok::<_, Problem>((column, cells(column)?, seconds)))
                    .collect::<Result<Vec<_>, Problem>>()?;
                self.joined(name, cells(name)?, &stamps, lines)
            }
        }
    }

    /// The values of a column's cells, with the stamps of their rows.
    fn joined(
        &self,
        name: &ColumnName,
        cells: &[Option<f64>],
        stamps: &[(&ColumnName, &Vec<Option<f64>>, f64)],
        lines: &[usize],
    ) -> Result<Column, Problem> {
        let refuse = |row: usize, reason: String, allowed: &str| {
            Err(Problem::new(reason, allowed).at(self.log.as_str(), lines[row]))
        };
        let mut column = Column {
            t: Vec::new(),
            values: Vec::new(),
        };
        let (mut before, mut repeated) = (0, 0);
        for (row, value) in cells.iter().enumerate() {
            let Some(value) = value else { continue };
            let mut t = 0.0;
            for (stamp, cells, seconds) in stamps {
                let Some(part) = cells[row] else {
                    let (stamp, name) = (stamp.get_ref(), name.get_ref());
                    let reason = format!("`{stamp}` is empty where `{name}` is {value}");
                    return refuse(row, reason, "a stamp in each row that has a value");
                };
                t += part * seconds;
            }
            if column.t.last() == Some(&t) && column.values.last() == Some(value) {
                repeated += 1;
                continue;
            }
            if column.t.last().is_some_and(|last| t <= *last) {
                let shown = |row: usize| {
                    let parts = stamps.iter().filter_map(|(_, cells, _)| cells[row]);
                    parts
                        .map(|part| part.to_string())
                        .collect::<Vec<_>>()
                        .join(" and ")
                };
                let stamp = stamps.iter().map(|(stamp, ..)| stamp.get_ref().as_str());
                let stamp = stamp.collect::<Vec<_>>().join("` and `");
                let reason = format!("`{stamp}` is {} after {}", shown(row), shown(before));
                return refuse(
                    row,
                    reason,
                    "stamps that increase; rows that are repeated whole are left out",
                );
            }
            before = row;
            column.t.push(t);
            column.values.push(*value);
        }
        self.refuse_short_parts(stamps)?;
        if repeated > 0 {
            let (log, name) = (&self.log, name.get_ref());
            eprintln!(
                "warning: {log}: `{name}`: {repeated} values repeat stamp and value of the row before and are left out"
            );
        }
        if column.t.len() < 2 {
            let reason = format!("`{}` has {} values", name.get_ref(), column.t.len());
            return Err(Problem::new(reason, "at least two").at(self.log.as_str(), 0));
        }
        Ok(column)
    }
}

impl Table {
    /// Refuses a part of a stamp that never comes near a unit of the part before it, which counts on: its unit is
    /// another one.
    fn refuse_short_parts(
        &self,
        stamps: &[(&ColumnName, &Vec<Option<f64>>, f64)],
    ) -> Result<(), Problem> {
        for pair in stamps.windows(2) {
            let [(whole, wholes, unit), (part, parts, seconds)] = pair else {
                continue;
            };
            let known = || wholes.iter().flatten();
            let counted = known().copied().fold(f64::MIN, f64::max)
                - known().copied().fold(f64::MAX, f64::min);
            let most = parts.iter().flatten().copied().fold(f64::MIN, f64::max) * seconds;
            let rows = parts.iter().flatten().count() as f64;
            if counted >= 2.0 && rows > PARTS_PER_UNIT * counted && most < LEAST_PART * unit {
                let reason = format!(
                    "`{}` stays below {most:.6} s where `{}` counts on by {counted}: another unit?",
                    part.get_ref(),
                    whole.get_ref()
                );
                let allowed =
                    "parts of a stamp in the map's units, the later ones up to one of the first";
                return Err(Problem::new(reason, allowed).at(self.log.as_str(), 0));
            }
        }
        Ok(())
    }
}

/// Rows in a unit of a stamp's first part from which its second part comes near that unit.
const PARTS_PER_UNIT: f64 = 10.0;
/// Share of that unit.
const LEAST_PART: f64 = 0.5;

/// The columns of a recording; what is wrong with it is printed.
///
/// # Errors
/// A recording without any signal that is read.
fn stamped(signals: Signals, log: &str, path: &Path) -> Result<Columns, Problem> {
    if signals.compressed > 0 {
        let count = signals.compressed;
        let reason = format!("{count} messages are compressed one by one");
        return Err(Problem::new(reason, by_rosbags(path)).at(log, 0));
    }
    if let Some((topic, joint)) = &signals.twice {
        let reason = format!("messages of {topic} name `{joint}` twice");
        return Err(Problem::new(reason, "each joint once in a message").at(log, 0));
    }
    if signals.columns.is_empty() {
        let others = signals.others.iter();
        let mut others: Vec<String> = others
            .map(|(topic, what)| format!("{topic} ({what})"))
            .collect();
        if signals.broken > 0 {
            let count = signals.broken;
            others.push(format!("{count} messages are not what their schema says"));
        }
        if others.is_empty() {
            others.push("none".to_owned());
        }
        let reason = format!(
            "has no signal that can be read; topics: {}",
            others.join(", ")
        );
        let allowed = format!("{} as cdr", READ_SCHEMAS.join(", "));
        return Err(Problem::new(reason, allowed).at(log, 0));
    }
    for (count, what) in [
        (
            signals.broken,
            "messages are not what their schema says and are left out",
        ),
        (
            signals.late,
            "messages came after later ones and are put in order",
        ),
        (
            signals.repeated,
            "values repeat the stamp of another and are left out",
        ),
        (signals.not_finite, "values are not finite and are left out"),
    ] {
        if count > 0 {
            eprintln!("warning: {log}: {count} {what}");
        }
    }
    let columns = signals.columns.into_iter().map(|(name, signal)| {
        let column = Column {
            t: signal.t,
            values: signal.values,
        };
        (name, column)
    });
    Ok(Columns::Stamped(columns.collect()))
}
