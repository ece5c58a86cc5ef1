//! Summary of a run, printed at its end for people or for programs.

use std::fmt;

use hdrhistogram::Histogram;
use robot_state::{Event, LoopRecord, SharedRecord};
use serde::Serialize;

/// Longest time that a histogram distinguishes, ns.
const LONGEST_NS: u64 = 10_000_000_000;

/// Collects timing while a loop runs; allocates only when made.
pub struct Timing {
    compute: Histogram<u64>,
    wake_late: Histogram<u64>,
    gather: Histogram<u64>,
}

/// Quantiles of a time, ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Quantiles {
    /// Median.
    pub p50: u64,
    /// 99 of 100 were shorter.
    pub p99: u64,
    /// The longest.
    pub max: u64,
}

impl Timing {
    /// Empty histograms.
    ///
    /// # Panics
    /// Never: the bounds are constants that the histogram accepts.
    #[must_use]
    pub fn new() -> Self {
        let histogram =
            || Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("constant bounds are in order");
        Self {
            compute: histogram(),
            wake_late: histogram(),
            gather: histogram(),
        }
    }

    /// Adds one cycle's timing.
    pub fn take(&mut self, record: &LoopRecord) {
        self.compute.saturating_record(record.compute_ns);
        self.wake_late.saturating_record(record.wake_late_ns);
        self.gather.saturating_record(record.gather_ns);
    }

    /// Quantiles of the computing time.
    #[must_use]
    pub fn compute(&self) -> Quantiles {
        quantiles(&self.compute)
    }
}

impl Default for Timing {
    fn default() -> Self {
        Self::new()
    }
}

fn quantiles(histogram: &Histogram<u64>) -> Quantiles {
    Quantiles {
        p50: histogram.value_at_quantile(0.5),
        p99: histogram.value_at_quantile(0.99),
        max: histogram.max(),
    }
}

/// Page faults of the loop's thread while it looped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct PageFaults {
    /// Faults served without a disk.
    pub minor: u64,
    /// Faults that needed a disk.
    pub major: u64,
}

/// A run's summary.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// The robot's name.
    pub robot: String,
    /// Cycles run.
    pub cycles: u64,
    /// Cycles that ended after the next one should have begun.
    pub late_cycles: u64,
    /// Skipped starts of cycles.
    pub skipped_cycles: u64,
    /// Frames received.
    pub frames_received: u64,
    /// Frames sent.
    pub frames_sent: u64,
    /// Number of the latched fault, or 0.
    pub fault: u32,
    /// Computing time of a cycle.
    pub compute_ns: Quantiles,
    /// Delay of the thread's wake-up.
    pub wake_late_ns: Quantiles,
    /// Time from SYNC until all answers had arrived.
    pub gather_ns: Quantiles,
    /// Page faults of the loop's thread.
    pub page_faults: PageFaults,
    /// Records lost on the way to the clients: no room.
    pub records_dropped: u64,
    /// Number of occurrences of each event that occurred.
    pub events: std::collections::BTreeMap<&'static str, u64>,
}

impl Summary {
    /// The summary after the last record.
    #[must_use]
    pub fn new(
        robot: &str,
        last: &SharedRecord,
        timing: &Timing,
        page_faults: PageFaults,
        records_dropped: u64,
    ) -> Self {
        let counted = Event::ALL.iter().zip(last.cycle.events);
        Self {
            robot: robot.to_owned(),
            cycles: last.timing.cycles,
            late_cycles: last.timing.late_cycles,
            skipped_cycles: last.timing.skipped_cycles,
            frames_received: last.timing.frames_received,
            frames_sent: last.timing.frames_sent,
            fault: last.cycle.fault,
            compute_ns: quantiles(&timing.compute),
            wake_late_ns: quantiles(&timing.wake_late),
            gather_ns: quantiles(&timing.gather),
            page_faults,
            records_dropped,
            events: counted
                .filter(|(_, count)| *count > 0)
                .map(|(event, count)| (event.name(), count))
                .collect(),
        }
    }
}

impl fmt::Display for Quantiles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let us = |ns: u64| ns as f64 * 1e-3;
        write!(
            f,
            "p50 {:.1} us, p99 {:.1} us, max {:.1} us",
            us(self.p50),
            us(self.p99),
            us(self.max)
        )
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "cycles     {} run, {} late, {} skipped",
            self.cycles, self.late_cycles, self.skipped_cycles
        )?;
        writeln!(f, "computing  {}", self.compute_ns)?;
        writeln!(f, "gathering  {}", self.gather_ns)?;
        writeln!(f, "wake-up    {}", self.wake_late_ns)?;
        writeln!(
            f,
            "frames     {} received, {} sent; page faults {} minor, {} major",
            self.frames_received, self.frames_sent, self.page_faults.minor, self.page_faults.major
        )?;
        if self.records_dropped > 0 {
            writeln!(
                f,
                "clients    {} records found no room",
                self.records_dropped
            )?;
        }
        for (name, count) in &self.events {
            writeln!(f, "event      {name}: {count}")?;
        }
        if let Some(fault) = Event::from_number(self.fault) {
            writeln!(
                f,
                "FAULT      {} {}: {} Config key: {}",
                fault.number(),
                fault.name(),
                fault.cause(),
                fault.config_key()
            )?;
        }
        Ok(())
    }
}
