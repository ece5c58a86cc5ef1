//! Analysis of a black box, or of any other recorded run: the fault, its first cause, the time line, the joints at the
//! fault.

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

/// The fault of a recorded run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// Latched within it.
    Latched(Event),
    /// Latched already when it began.
    Before(Event),
    /// The loop ended by a defect: what it was written for, and no cycle shows.
    LoopEnded,
    /// An ordinary recording.
    None,
}

impl Fault {
    /// Its event.
    pub(crate) fn event(self) -> Option<Event> {
        match self {
            Self::Latched(event) | Self::Before(event) => Some(event),
            Self::LoopEnded => Some(Event::LoopEnded),
            Self::None => None,
        }
    }
}

/// A black box, read.
pub(crate) struct BlackBox {
    pub(crate) header: Header,
    pub(crate) ending: Ending,
    pub(crate) fault: Fault,
    /// Time zero, and its cycle: of the fault, of the run's begin where the fault is older or there is none.
    pub(crate) zero_ns: u64,
    pub(crate) cycle: u64,
    /// The first cause.
    pub(crate) cause: Option<Span>,
    pub(crate) spans: Vec<Span>,
    /// The record of the cycle that latched the fault; the last one where none did.
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
        let latched = fault.and_then(|fault| match fault.what {
            Happening::Fault(number) => Event::from_number(number),
            _ => None,
        });
        let before = Event::from_number(seen.first_fault);
        let what = match (latched, before, header.black_box) {
            (Some(event), ..) => Fault::Latched(event),
            (None, _, Some(Event::LoopEnded)) => Fault::LoopEnded,
            (None, Some(event), _) => Fault::Before(event),
            (None, None, _) => Fault::None,
        };
        let (zero_ns, cycle) = match (fault, what) {
            (Some(fault), _) => (fault.begin_ns, fault.cycle),
            (None, Fault::LoopEnded) => (seen.record.stamp_ns, seen.record.sequence),
            (None, _) => (seen.begin_ns, seen.first_cycle),
        };
        Ok(Self {
            header,
            ending,
            fault: what,
            zero_ns,
            cycle,
            cause,
            spans,
            record: seen.record,
            good_ns: seen.good_ns,
            range_ns: [seen.begin_ns, seen.end_ns],
        })
    }
}

/// Kept cycles up to the fault.
struct Seen {
    record: Box<CycleRecord>,
    good_ns: Vec<Option<u64>>,
    first_fault: u32,
    first_cycle: u64,
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
            first_cycle: record.sequence,
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
