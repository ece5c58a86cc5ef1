//! Inspection of a log before any fit: what comes in is a joint's data sheet and a log's rows, what
//! goes out is either every reason why the log cannot be what it claims to be, or what it covers.
//!
//! A fit by least squares accepts anything: angles in degrees, a reversed encoder, a reference
//! that is the current once more. Each of these leaves marks that no gear can make (a torsion of
//! half a radian, a compliance below zero, a friction of nothing), and these marks are looked for.
//! Bounds are wide: they refuse what no harmonic, cycloidal or planetary gear does, not what is unusual.

mod encoders;
mod reference;
mod signals;
mod stamps;

pub use stamps::check_rate;

use crate::excitation::Excitation;
use crate::log::LogRow;
use crate::record::Record;
use joint_file::JointFile;
use problem::{Problem, Problems};
use signals::Signals;

/// Use of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogKind {
    /// An unloaded output turn each way; torque and current are not used.
    NoLoad,
    /// Loaded motion and rest beside a torque reference.
    Training,
    /// The same from a robot's recorded runs, with a reference that F/T sensors, IMU and rigid-body model give: it has
    /// no columns that a user could name.
    Recorded,
}

impl LogKind {
    /// Name of a column towards the user.
    fn name(self, column: &'static str) -> &'static str {
        match (self, column) {
            (Self::Recorded, "theta") => "the motor-side angle",
            (Self::Recorded, "q") => "the link-side angle",
            (Self::Recorded, "i") => "the current",
            (Self::Recorded, "tau_sensor") => "the reference torque",
            (_, "theta") => "`theta`",
            (_, "q") => "`q`",
            (_, "i") => "`i`",
            (_, "tau_sensor") => "`tau_sensor`",
            _ => column,
        }
    }

    /// Where a usable torque reference comes from.
    fn references(self) -> &'static str {
        match self {
            Self::Recorded => "contacts and F/T sensors from which the joint's torque follows",
            Self::NoLoad | Self::Training => {
                "a torque sensor's column, or a reference by `torquectl reference`"
            }
        }
    }
}

/// Coverage of a log, and its oddities that are not wrong.
#[derive(Debug, Clone, PartialEq)]
pub struct Inspection {
    /// Use of the log.
    pub kind: LogKind,
    /// Rows.
    pub rows: usize,
    /// Time from first to last row, s.
    pub duration: f64,
    /// Ranges, and what the log determines; none of a no-load turn.
    pub excitation: Option<Excitation>,
    /// Odd but usable.
    pub notes: Vec<String>,
}

/// Rows and time that any fit needs.
const MIN_ROWS: usize = 50;

/// Inspects a log.
///
/// # Errors
/// Every reason found why the log cannot be fitted to.
pub fn inspect(joint: &JointFile, rows: &[LogRow], kind: LogKind) -> Result<Inspection, Problems> {
    if rows.len() < MIN_ROWS {
        let reason = format!("the log has {} rows", rows.len());
        return Err(Problem::new(reason, format!("at least {MIN_ROWS}")).into());
    }
    let mut notes = Vec::new();
    // Without the right time no rate means anything.
    stamps::check(rows, joint.sample_period(), &mut notes)?;
    let signals = Signals::new(joint, rows);
    let mut problems = Vec::new();
    encoders::check(&signals, joint, kind, &mut problems, &mut notes);
    match kind {
        LogKind::NoLoad => reference::check_unloaded(&signals, joint, &mut problems),
        LogKind::Training | LogKind::Recorded => {
            reference::check(&signals, joint, kind, &mut problems, &mut notes);
        }
    }
    let mut excitation = None;
    if problems.is_empty() && kind != LogKind::NoLoad {
        let record = Record::new(joint, rows)?;
        let found = Excitation::new(&record, joint);
        problems.extend(reference::implausible(&found, joint, kind));
        excitation = Some(found);
    }
    if !problems.is_empty() {
        return Err(Problems(problems));
    }
    let ends = rows.first().zip(rows.last());
    Ok(Inspection {
        kind,
        rows: rows.len(),
        duration: ends.map_or(0.0, |(first, last)| last.t - first.t),
        excitation,
        notes,
    })
}

impl Inspection {
    /// Lines for a report: what the log covers, what it does not determine, what is odd.
    #[must_use]
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!("{} rows in {:.1} s", self.rows, self.duration)];
        if let Some(excitation) = &self.excitation {
            lines.extend(excitation.lines());
        }
        lines.extend(self.notes.iter().map(|note| format!("note: {note}")));
        lines
    }
}
