//! Recorded logs of one joint: a [`Table`] with columns of fixed names, read line by line in constant memory.

use estimators::front_end::FrontEnd;
use estimators::joint::JointSample;
use problem::Problem;
use std::io::BufRead;
use table::Table;

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

/// Reads a log line by line.
pub struct LogReader<R> {
    table: Table<R>,
    /// Place of each of `COLUMNS`; the last two may be missing.
    places: [Option<usize>; 6],
    last_t: f64,
}

impl<R: BufRead> LogReader<R> {
    /// Reads the header. `file` is what messages call the log.
    ///
    /// # Errors
    /// As [`Table::new`]; a column missing or named twice.
    pub fn new(input: R, file: &str) -> Result<Self, Problem> {
        let table = Table::new(input, file, None)?;
        let mut places = [None; 6];
        for (i, (place, column)) in places.iter_mut().zip(COLUMNS).enumerate() {
            *place = table.column(column)?;
            if i < 4 && place.is_none() {
                let names = table.names().join(",");
                let reason = format!("column `{column}` is missing among `{names}`");
                let allowed = "`t,theta,q,i[,tau_sensor][,tau_feedforward]` and any others; `torquectl import` makes such logs";
                return Err(table.problem(reason, allowed));
            }
            place.map_or(Ok(()), |place| table.require_si(place))?;
        }
        Ok(Self {
            table,
            places,
            last_t: f64::NEG_INFINITY,
        })
    }

    /// Whether the log has a `tau_sensor` column.
    #[must_use]
    pub fn has_torque(&self) -> bool {
        self.places[4].is_some()
    }

    /// The next row; none at the end.
    ///
    /// # Errors
    /// As [`Table::next_row`]; a field that is not a finite number, or time that does not advance.
    pub fn next_row(&mut self) -> Result<Option<LogRow>, Problem> {
        if !self.table.next_row()? {
            return Ok(None);
        }
        let mut values = [f64::NAN; 6];
        for (value, place) in values.iter_mut().zip(self.places) {
            if let Some(place) = place {
                *value = self.table.number(place)?;
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
    pub fn rows(&mut self) -> Result<Vec<LogRow>, Problem> {
        let mut rows = Vec::new();
        while let Some(row) = self.next_row()? {
            rows.push(row);
        }
        if rows.is_empty() {
            return Err(self.problem("the log has no rows", "at least one"));
        }
        Ok(rows)
    }

    /// The file ends within its last row, which is left out; see [`Table::is_cut`]. Known at the end.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.table.is_cut()
    }

    /// A problem at the line that was read last.
    #[must_use]
    pub fn problem(&self, reason: impl Into<String>, allowed: impl Into<String>) -> Problem {
        self.table.problem(reason, allowed)
    }
}
