//! What a black box shows: the fault, its first cause, the time line, the joints at the fault.

use crate::recorded;
use problem::Problem;
use recording::{Ending, Happening, Header, Span, Timeline, cause_of};
use std::path::Path;
use torqued_client::robot_state::{CycleRecord, Event, measured_flags};

/// Samples with one of these are not good.
const BAD: u32 = measured_flags::MISSED
    | measured_flags::STALE
    | measured_flags::JUMP
    | measured_flags::NEVER
    | measured_flags::IMPLAUSIBLE;

/// A black box, read.
pub(crate) struct BlackBox {
    pub(crate) header: Header,
    pub(crate) ending: Ending,
    pub(crate) event: Event,
    /// Instant of the fault, and its cycle.
    pub(crate) fault_ns: u64,
    pub(crate) cycle: u64,
    /// What came first.
    pub(crate) cause: Option<Span>,
    pub(crate) spans: Vec<Span>,
    /// The record of the cycle that latched the fault.
    pub(crate) record: Box<CycleRecord>,
    /// Instant of each joint's last good sample up to the fault.
    pub(crate) good_ns: Vec<Option<u64>>,
    /// First and last cycle's instants.
    pub(crate) range_ns: [u64; 2],
}

impl BlackBox {
    pub(crate) fn read(path: &Path) -> Result<Self, Problem> {
        let mut run = recorded::open(path)?;
        let header = run.header().clone();
        let mut timeline = Timeline::default();
        let mut seen: Option<Seen> = None;
        let ending = recorded::read_all(path, &mut run, |header, message| {
            timeline.observe(message);
            let record = &message.record.cycle;
            let seen = seen.get_or_insert_with(|| Seen::new(header, record));
            seen.take(record);
            Ok(())
        })?;
        let spans = timeline.finish();
        let Some(seen) = seen else {
            let problem = Problem::new("holds no cycle", "a black box");
            return Err(problem.at(path.display().to_string(), 0));
        };
        let fault = spans
            .iter()
            .find(|span| matches!(span.what, Happening::Fault(_)));
        let cause = fault.and_then(|fault| cause_of(&spans, fault)).cloned();
        let event = match fault.map(|fault| fault.what) {
            Some(Happening::Fault(number)) => Event::from_number(number),
            _ => Event::from_number(seen.record.fault),
        };
        Ok(Self {
            header,
            ending,
            // Without a fault in it, it was written because the loop ended by a defect.
            event: event.unwrap_or(Event::LoopEnded),
            fault_ns: fault.map_or(seen.record.stamp_ns, |fault| fault.begin_ns),
            cycle: fault.map_or(seen.record.sequence, |fault| fault.cycle),
            cause,
            spans,
            record: seen.record,
            good_ns: seen.good_ns,
            range_ns: [seen.begin_ns, seen.end_ns],
        })
    }
}

/// What is kept of the cycles up to the fault.
struct Seen {
    record: Box<CycleRecord>,
    good_ns: Vec<Option<u64>>,
    first_fault: u32,
    latched: bool,
    begin_ns: u64,
    end_ns: u64,
}

impl Seen {
    fn new(header: &Header, record: &CycleRecord) -> Self {
        Self {
            record: Box::new(*record),
            good_ns: vec![None; header.joints.len()],
            first_fault: record.fault,
            latched: false,
            begin_ns: record.stamp_ns,
            end_ns: record.stamp_ns,
        }
    }

    fn take(&mut self, record: &CycleRecord) {
        self.end_ns = record.stamp_ns;
        if self.latched {
            return;
        }
        *self.record = *record;
        for (good_ns, joint) in self.good_ns.iter_mut().zip(&record.measured.joints) {
            if joint.flags & BAD == 0 {
                let age_ns = (joint.age_s.max(0.0) * 1e9) as u64;
                *good_ns = Some(record.stamp_ns.saturating_sub(age_ns));
            }
        }
        self.latched = record.fault != 0 && record.fault != self.first_fault;
    }
}
