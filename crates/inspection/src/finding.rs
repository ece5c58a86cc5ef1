//! What an inspection has found.

use core::fmt;
use problem::Problem;

/// Consequence of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Mended without loss.
    Note,
    /// Usable, but rows are lost or results are doubtful.
    Warning,
    /// The log is not what it claims to be.
    Refused,
}

/// Kind of a defect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Defect {
    /// Values continue at the other end of their range.
    Wrapped,
    /// Single samples, or a few in a row, that no neighbour confirms.
    Spikes,
    /// One value repeated while the signal went on.
    Frozen,
    /// The zero changes between two rows.
    Stepped,
    /// A channel is late against others.
    Late,
    /// A channel's zero drifts.
    Drifts,
    /// Readings end at a bound, at once or softly.
    Saturated,
    /// A channel is computed from another one.
    Computed,
    /// The log runs backwards in time.
    Reversed,
    /// The sign of a channel changes, or is missing.
    Sign,
}

/// A defect of a channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Its kind.
    pub defect: Defect,
    /// Its consequence.
    pub severity: Severity,
    /// Name of the channel.
    pub channel: String,
    /// First row, from 0; none where the whole channel is meant.
    pub row: Option<usize>,
    /// Stamp of that row, s.
    pub t: f64,
    /// Rows that are concerned.
    pub rows: usize,
    /// What was found.
    pub text: String,
    /// What cures it.
    pub cure: String,
}

impl Finding {
    /// The finding as a refusal. `line`: line of a row in the file.
    #[must_use]
    pub fn problem(&self, file: &str, line: impl Fn(usize) -> usize) -> Problem {
        let reason = match self.row {
            Some(_) => format!("{} (t = {:.3} s)", self.text, self.t),
            None => self.text.clone(),
        };
        Problem::new(reason, self.cure.clone()).at(file, self.row.map_or(0, line))
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)?;
        if self.row.is_some() {
            write!(f, ", first at t = {:.3} s", self.t)?;
        }
        if self.cure.is_empty() {
            Ok(())
        } else {
            write!(f, "; {}", self.cure)
        }
    }
}
