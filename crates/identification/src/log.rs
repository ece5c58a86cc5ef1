//! Recorded logs of one joint: CSV with a header, read line by line in constant memory.

use std::fmt;
use std::io::BufRead;

/// A log that cannot be used: file, line, reason.
#[derive(Debug)]
pub struct LogError {
    file: String,
    line: usize,
    reason: String,
}

impl fmt::Display for LogError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.reason)
    }
}
impl std::error::Error for LogError {}

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
}

/// The columns that a log must have, and the one that it may have.
const COLUMNS: [&str; 5] = ["t", "theta", "q", "i", "tau_sensor"];
/// A line longer than this is not one of numbers.
const LONGEST_LINE: u64 = 64 * 1024;

/// Reads a log line by line.
pub struct LogReader<R> {
    input: R,
    file: String,
    line: usize,
    text: String,
    /// Where each of `COLUMNS` stands; the last may be missing.
    places: [Option<usize>; 5],
    last_t: f64,
}

impl<R: BufRead> LogReader<R> {
    /// Reads the header. `file` is what messages call the log.
    ///
    /// # Errors
    /// An empty log, or a column missing or named twice.
    pub fn new(input: R, file: &str) -> Result<Self, LogError> {
        let mut reader = Self {
            input,
            file: file.to_owned(),
            line: 0,
            text: String::new(),
            places: [None; 5],
            last_t: f64::NEG_INFINITY,
        };
        if !reader.next_line()? {
            reader.line = 1;
            let columns = COLUMNS[..4].join(",");
            return Err(reader.error(format!("the log is empty; allowed: a header `{columns}`")));
        }
        let names: Vec<&str> = reader
            .text
            .trim_start_matches('\u{feff}')
            .split(',')
            .collect();
        let names: Vec<String> = names.iter().map(|n| n.trim().to_owned()).collect();
        for (place, column) in COLUMNS.iter().enumerate() {
            let mut found = names
                .iter()
                .enumerate()
                .filter(|(_, n)| n == column)
                .map(|(i, _)| i);
            reader.places[place] = found.next();
            if found.next().is_some() {
                return Err(reader.error(format!("column `{column}` stands there twice")));
            }
            if place < 4 && reader.places[place].is_none() {
                let names = names.join(",");
                return Err(reader.error(format!(
                    "column `{column}` is missing among `{names}`; allowed: \
                     `t,theta,q,i[,tau_sensor]` and any others"
                )));
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
    pub fn next_row(&mut self) -> Result<Option<LogRow>, LogError> {
        loop {
            if !self.next_line()? {
                return Ok(None);
            }
            if !self.text.trim().is_empty() {
                break;
            }
        }
        let mut values = [f64::NAN; 5];
        for (value, (place, column)) in values.iter_mut().zip(self.places.iter().zip(COLUMNS)) {
            let Some(place) = place else { continue };
            let Some(field) = self.text.split(',').nth(*place) else {
                let needed = place + 1;
                return Err(self.error(format!(
                    "column `{column}` is missing here; allowed: at least {needed} fields"
                )));
            };
            let field = field.trim();
            match field.parse::<f64>() {
                Ok(number) if number.is_finite() => *value = number,
                _ => {
                    let reason = format!("`{column}` is `{field}`; allowed: a finite number");
                    return Err(self.error(reason));
                }
            }
        }
        let [t, theta, q, current, tau_sensor] = values;
        if t <= self.last_t {
            let last = self.last_t;
            return Err(self.error(format!(
                "time {t} s follows {last} s; allowed: time that increases from line to line"
            )));
        }
        self.last_t = t;
        Ok(Some(LogRow {
            t,
            theta,
            q,
            current,
            tau_sensor,
        }))
    }

    /// All rows that are left.
    ///
    /// # Errors
    /// As [`Self::next_row`]; a log without any row.
    pub fn rows(mut self) -> Result<Vec<LogRow>, LogError> {
        let mut rows = Vec::new();
        while let Some(row) = self.next_row()? {
            rows.push(row);
        }
        if rows.is_empty() {
            return Err(self.error("the log has no rows".to_owned()));
        }
        Ok(rows)
    }

    /// An error at the line that was read last.
    #[must_use]
    pub fn error(&self, reason: String) -> LogError {
        LogError {
            file: self.file.clone(),
            line: self.line,
            reason,
        }
    }

    fn next_line(&mut self) -> Result<bool, LogError> {
        self.text.clear();
        self.line += 1;
        let mut limited = std::io::Read::take(&mut self.input, LONGEST_LINE);
        match limited.read_line(&mut self.text) {
            Ok(0) => Ok(false),
            Ok(read) if read as u64 >= LONGEST_LINE && !self.text.ends_with('\n') => {
                Err(self.error(format!("the line is longer than {LONGEST_LINE} bytes")))
            }
            Ok(_) => {
                let kept = self.text.trim_end_matches(['\n', '\r']).len();
                self.text.truncate(kept);
                Ok(true)
            }
            Err(e) => Err(self.error(format!("cannot be read: {e}"))),
        }
    }
}
