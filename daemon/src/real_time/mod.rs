//! Measures for a punctual loop thread: a real-time scheduler, locked memory, a CPU of its own, and
//! sleep until absolute times.
//!
//! Each measure is either granted or denied with a reason and a way to mend it; config
//! `loop.real_time` determines if a denial is a warning (`"try"`) or the end (`"require"`).

mod deadline;
mod measures;

pub(crate) use deadline::realtime_ns;
pub use deadline::{Deadline, Pace, Schedule, WakeReport, monotonic_ns, sleep_until};
pub(crate) use measures::{keep_off_cpu, run_as_ordinary_thread, run_before_ordinary_threads};

use std::fmt;
use std::fs::File;

/// Real-time settings of `[loop]` in the config.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Settings {
    /// `real_time = "require"`: a denied measure is an error.
    pub require: bool,
    /// `priority`: of SCHED_FIFO, 1 to 99.
    pub priority: u8,
    /// `cpu`: the only CPU the thread may use.
    pub cpu: Option<usize>,
}

/// One measure and its outcome.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Measure {
    /// The measure, e.g. "scheduler SCHED_FIFO 80".
    pub name: String,
    /// Without it `"require"` refuses to start.
    pub essential: bool,
    /// Granted, or why not.
    pub outcome: Result<(), Denial>,
}

/// Why a measure was denied, and how that is mended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Denial {
    /// The system's answer.
    pub why: String,
    /// The remedy.
    pub mend: String,
}

impl fmt::Display for Measure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.outcome {
            Ok(()) => write!(f, "{}: granted", self.name),
            Err(denial) => write!(
                f,
                "{}: denied: {}; to mend: {}",
                self.name, denial.why, denial.mend
            ),
        }
    }
}

/// Every measure that was tried, in order.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Report {
    /// The measures.
    pub measures: Vec<Measure>,
}

impl Report {
    /// The measures that were denied.
    pub fn denied(&self) -> impl Iterator<Item = &Measure> {
        self.measures.iter().filter(|m| m.outcome.is_err())
    }

    /// The report, unless an essential measure was denied and `require` is set.
    pub fn judge(self, require: bool) -> Result<Self, RealTimeError> {
        if require && self.denied().any(|m| m.essential) {
            return Err(RealTimeError { report: self });
        }
        Ok(self)
    }
}

/// `real_time = "require"` and an essential measure was denied.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "loop.real_time = \"require\", but the system denies:{}\nallowed: mend the above, or \
     loop.real_time = \"try\" to start without it",
    self.denied()
)]
pub struct RealTimeError {
    /// All measures, granted and denied.
    pub report: Report,
}

impl RealTimeError {
    /// The essential measures that were denied, one a line.
    fn denied(&self) -> String {
        let denied = self.report.denied().filter(|m| m.essential);
        denied.map(|measure| format!("\n  {measure}")).collect()
    }
}

/// The granted measures; dropping them closes the files that they hold open.
#[derive(Debug)]
pub struct RealTime {
    /// Every measure with its outcome.
    pub report: Report,
    /// The kernel keeps the CPUs out of deep sleep for as long as this file is open.
    _cpu_dma_latency: Option<File>,
}

/// Makes the calling thread the loop's: call it in that thread, after everything the loop uses
/// has been allocated. Under `"try"` the caller prints `report.denied()` once.
pub fn enter(settings: &Settings) -> Result<RealTime, RealTimeError> {
    let mut measures = Vec::new();
    if let Some(cpu) = settings.cpu {
        measures.push(measures::pin_to_cpu(cpu));
    }
    measures.push(measures::lock_memory());
    measures::prefault_stack();
    let (measure, cpu_dma_latency) = measures::hold_cpus_awake();
    measures.push(measure);
    // Last: as soon as it is granted, the thread can starve what the others still need.
    measures.push(measures::schedule_fifo(settings.priority));
    let report = Report { measures }.judge(settings.require)?;
    Ok(RealTime {
        report,
        _cpu_dma_latency: cpu_dma_latency,
    })
}
