//! Recorded logs of one joint: CSV with a header (delimiter `,`, `;` or tab), read line by line in constant memory.

use estimators::front_end::FrontEnd;
use estimators::joint::JointSample;
use problem::{Allowed, Problem};
use std::io::BufRead;

/// One line of a log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogRow {
    /// t: time, s.
    pub t: f64,
    /// theta: motor-side angle, rad, unwrapped.
    pub theta: f64,
    /// q: link-side angle, rad.
    pub q: f64,
    /// i: motor current, A.
    pub current: f64,
    /// tau_sensor: torque, N·m; NaN where the log has no such column.
    pub tau_sensor: f64,
    /// tau_feedforward: torque that a controller or a rigid-body model expects, N·m; NaN where the log has no
    /// such column.
    pub feed_forward: f64,
}

impl LogRow {
    /// The row as the estimators take it.
    pub fn sample(&self, front_end: &mut FrontEnd) -> JointSample {
        JointSample {
            feed_forward: Some(self.feed_forward).filter(|tau| tau.is_finite()),
            ..front_end.update(self.theta, self.q, self.current)
        }
    }
}

/// The columns that a log must have, and those that it may have.
const COLUMNS: [&str; 6] = ["t", "theta", "q", "i", "tau_sensor", "tau_feedforward"];
/// A line longer than this is not one of numbers.
const LONGEST_LINE: u64 = 64 * 1024;

/// Reads a log line by line.
pub struct LogReader<R> {
    input: R,
    file: String,
    line: usize,
    text: String,
    delimiter: char,
    /// Place of each of `COLUMNS`; the last two may be missing.
    places: [Option<usize>; 6],
    last_t: f64,
}

impl<R: BufRead> LogReader<R> {
    /// Reads the header. `file` is what messages call the log.
    ///
    /// # Errors
    /// An empty log, or a column missing or named twice.
    pub fn new(input: R, file: &str) -> Result<Self, Problem> {
        let mut reader = Self {
            input,
            file: file.to_owned(),
            line: 0,
            text: String::new(),
            delimiter: ',',
            places: [None; 6],
            last_t: f64::NEG_INFINITY,
        };
        if !reader.next_line()? {
            reader.line = 1;
            let allowed = format!("a header `{}`", COLUMNS[..4].join(","));
            return Err(reader.problem("the log is empty", allowed));
        }
        let header = reader.text.trim_start_matches('\u{feff}');
        let count = |delimiter: &char| header.matches(*delimiter).count();
        // Of equal counts the last: a header of one column has none, and is one with commas.
        let delimiter = [';', '\t', ','].into_iter().max_by_key(count);
        reader.delimiter = delimiter.unwrap_or(',');
        let names: Vec<String> = header
            .split(reader.delimiter)
            .map(|name| name.trim().trim_matches('"').to_owned())
            .collect();
        for (place, column) in COLUMNS.iter().enumerate() {
            let mut found = names
                .iter()
                .enumerate()
                .filter(|(_, n)| n == column)
                .map(|(i, _)| i);
            reader.places[place] = found.next();
            if found.next().is_some() {
                let reason = format!("column `{column}` is named twice");
                return Err(reader.problem(reason, "each column once"));
            }
            if place < 4 && reader.places[place].is_none() {
                let names = names.join(",");
                let reason = format!("column `{column}` is missing among `{names}`");
                let allowed = "`t,theta,q,i[,tau_sensor][,tau_feedforward]` and any others";
                return Err(reader.problem(reason, allowed));
            }
        }
        Ok(reader)
    }

    /// Whether the log has a `tau_sensor` column.
    #[must_use]
    pub fn has_torque(&self) -> bool {
        self.places[4].is_some()
    }

    /// The next row; none at the end.
    ///
    /// # Errors
    /// A line with too few fields, a field that is not a finite number, or time that does not
    /// advance.
    pub fn next_row(&mut self) -> Result<Option<LogRow>, Problem> {
        loop {
            if !self.next_line()? {
                return Ok(None);
            }
            if !self.text.trim().is_empty() {
                break;
            }
        }
        let mut values = [f64::NAN; 6];
        for (value, (place, column)) in values.iter_mut().zip(self.places.iter().zip(COLUMNS)) {
            let Some(place) = place else { continue };
            let Some(field) = self.text.split(self.delimiter).nth(*place) else {
                let reason = format!("the field of column `{column}` is missing");
                return Err(self.problem(reason, format!("at least {} fields", place + 1)));
            };
            let field = field.trim();
            match field.parse::<f64>() {
                Ok(number) if number.is_finite() => *value = number,
                _ => {
                    let reason = format!("`{column}` is `{field}`");
                    return Err(self.problem(reason, Allowed::Finite.to_string()));
                }
            }
        }
        let [t, theta, q, current, tau_sensor, feed_forward] = values;
        if t <= self.last_t {
            let last = self.last_t;
            let reason = format!("time {t} s follows {last} s");
            return Err(self.problem(reason, "time that increases from line to line"));
        }
        self.last_t = t;
        Ok(Some(LogRow {
            t,
            theta,
            q,
            current,
            tau_sensor,
            feed_forward,
        }))
    }

    /// All rows that are left.
    ///
    /// # Errors
    /// As [`Self::next_row`]; a log without any row.
    pub fn rows(mut self) -> Result<Vec<LogRow>, Problem> {
        let mut rows = Vec::new();
        while let Some(row) = self.next_row()? {
            rows.push(row);
        }
        if rows.is_empty() {
            return Err(self.problem("the log has no rows", "at least one"));
        }
        Ok(rows)
    }

    /// A problem at the line that was read last.
    #[must_use]
    pub fn problem(&self, reason: impl Into<String>, allowed: impl Into<String>) -> Problem {
        Problem::new(reason, allowed).at(self.file.as_str(), self.line)
    }

    fn next_line(&mut self) -> Result<bool, Problem> {
        self.text.clear();
        self.line += 1;
        let mut limited = std::io::Read::take(&mut self.input, LONGEST_LINE);
        match limited.read_line(&mut self.text) {
            Ok(0) => Ok(false),
            Ok(read) if read as u64 >= LONGEST_LINE && !self.text.ends_with('\n') => {
                let allowed = format!("at most {LONGEST_LINE} bytes");
                Err(self.problem("the line is too long", allowed))
            }
            Ok(_) => {
                let kept = self.text.trim_end_matches(['\n', '\r']).len();
                self.text.truncate(kept);
                Ok(true)
            }
            Err(e) => Err(self.problem(format!("cannot be read: {e}"), "")),
        }
    }
}
