//! Inspection of a log before any fit: what comes in is a joint's data sheet and a log's rows, what
//! goes out is either every reason why the log cannot be what it claims to be, or what it covers.
//!
//! A fit by least squares accepts anything: angles in degrees, a reversed encoder, a reference
//! that is the current once more. Each of these leaves marks that no gear can make (a torsion of
//! half a radian, a compliance below zero, a friction of nothing), and these marks are looked for.
//! Bounds are wide: they refuse what no harmonic, cycloidal or planetary gear does, not what is unusual.

mod contradictions;
mod copies;
mod current;
mod encoders;
mod mend;
mod probes;
mod reference;
mod signals;
mod signs;
mod stamps;
mod zero;

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
    /// Loaded motion beside a torque reference, for what needs no torsion: one encoder is enough.
    Current,
    /// A log that torques are estimated over, with or without a reference that they are compared with.
    Run,
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
            Self::NoLoad | Self::Training | Self::Current | Self::Run => {
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
    /// The log's rows, mended where there is one mending, without those that hold no measurement.
    pub mended: Vec<LogRow>,
}

/// Rows and time that any fit needs.
const MIN_ROWS: usize = 50;

/// Inspects a log.
///
/// # Errors
/// Every reason found why the log cannot be fitted to.
pub fn inspect(joint: &JointFile, rows: &[LogRow], kind: LogKind) -> Result<Inspection, Problems> {
    inspect_rows(joint, rows.to_vec(), kind)
}

/// As [`inspect`], of a log that is not needed otherwise.
///
/// # Errors
/// As [`inspect`].
pub fn inspect_rows(
    joint: &JointFile,
    rows: Vec<LogRow>,
    kind: LogKind,
) -> Result<Inspection, Problems> {
    if rows.len() < MIN_ROWS {
        let reason = format!("the log has {} rows", rows.len());
        return Err(Problem::new(reason, format!("at least {MIN_ROWS}")).into());
    }
    let mut notes = Vec::new();
    // Without the right time no rate means anything.
    stamps::check(&rows, joint.sample_period(), &mut notes)?;
    let mut mended = mend::mend(joint, rows, kind);
    if kind == LogKind::Run {
        mended
            .findings
            .extend(zero::whole_turns(joint, &mut mended.rows));
    }
    let mut problems = Vec::new();
    sort(
        std::mem::take(&mut mended.findings),
        &mut problems,
        &mut notes,
    );
    let rows = &mended.rows[..];
    if rows.len() < MIN_ROWS {
        let reason = format!("{} rows hold measurements of every channel", rows.len());
        problems.push(Problem::new(reason, format!("at least {MIN_ROWS}")));
        return Err(Problems(problems));
    }
    let signals = Signals::new(joint, rows);
    encoders::check(&signals, joint, kind, &mut problems, &mut notes);
    if kind != LogKind::NoLoad {
        problems.extend(current::unit(&signals, joint, kind));
    }
    match kind {
        LogKind::NoLoad => reference::check_unloaded(&signals, joint, &mut problems),
        LogKind::Run => zero::check(&signals, joint, &mut problems),
        LogKind::Training | LogKind::Recorded | LogKind::Current => {
            reference::check(&signals, joint, kind, &mut problems, &mut notes);
        }
    }
    let compared = kind != LogKind::NoLoad && rows.iter().all(|row| row.tau_sensor.is_finite());
    // Signs that change would pass for units otherwise.
    if problems.is_empty() && compared {
        let found = contradictions::signs(&signals, joint, kind);
        sort(found, &mut problems, &mut notes);
    }
    // Of a long log only one of both is in memory.
    drop(signals);
    let mut excitation = None;
    if problems.is_empty()
        && matches!(
            kind,
            LogKind::Training | LogKind::Recorded | LogKind::Current
        )
    {
        let record = Record::new(joint, rows)?;
        let found = Excitation::new(&record, joint);
        problems.extend(reference::implausible(&found, joint, kind));
        excitation = Some(found);
    }
    // Last: channels in other units and directions contradict one another anyhow.
    if problems.is_empty() && compared {
        let signals = Signals::new(joint, rows);
        let found = contradictions::check(&signals, joint, kind);
        sort(found, &mut problems, &mut notes);
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
        mended: mended.rows,
    })
}

/// Findings as refusals or notes. Rows of a table begin on its second line.
fn sort(findings: Vec<inspection::Finding>, problems: &mut Vec<Problem>, notes: &mut Vec<String>) {
    for finding in findings {
        match finding.severity {
            inspection::Severity::Refused => {
                let text = finding
                    .row
                    .map_or(String::new(), |_| format!(" (t = {:.3} s)", finding.t));
                problems.push(Problem::new(finding.text + &text, finding.cure));
            }
            _ => notes.push(finding.to_string()),
        }
    }
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
