//! Summary of a recorded run.

use crate::recorded;
use problem::Problem;
use recording::{CycleMessage, Ending, Happening, Header, Span, Timeline};
use std::collections::BTreeSet;
use std::path::Path;
use torqued_client::robot_state::{Event, command_flags, measured_flags};

/// A recorded run, summed up.
pub(crate) struct RunSummary {
    pub(crate) header: Header,
    pub(crate) ending: Ending,
    pub(crate) cycles: u64,
    pub(crate) first_cycle: u64,
    /// Cycles that are missing between the first and the last.
    pub(crate) missing: u64,
    pub(crate) late: u64,
    pub(crate) skipped: u64,
    pub(crate) received: u64,
    pub(crate) sent: u64,
    pub(crate) begin_ns: u64,
    pub(crate) end_ns: u64,
    pub(crate) joints: Vec<JointSummary>,
    /// Events that occurred within the run.
    pub(crate) events: Vec<(Event, u64)>,
    pub(crate) spans: Vec<Span>,
    first_events: Vec<u64>,
    last_cycle: u64,
    first_late: [u64; 2],
}

/// One joint, summed up.
#[derive(Debug, Clone)]
pub(crate) struct JointSummary {
    pub(crate) q_min: f64,
    pub(crate) q_max: f64,
    pub(crate) dq_max: f64,
    pub(crate) tau_max: f64,
    sigma_sum: f64,
    cycles: u64,
    pub(crate) missed: u64,
    pub(crate) limited: u64,
}

impl Default for JointSummary {
    fn default() -> Self {
        Self {
            q_min: f64::INFINITY,
            q_max: f64::NEG_INFINITY,
            dq_max: 0.0,
            tau_max: 0.0,
            sigma_sum: 0.0,
            cycles: 0,
            missed: 0,
            limited: 0,
        }
    }
}

impl JointSummary {
    /// Mean standard deviation of tau_hat, N·m.
    pub(crate) fn mean_sigma(&self) -> f64 {
        self.sigma_sum / self.cycles.max(1) as f64
    }
}

impl RunSummary {
    pub(crate) fn read(path: &Path) -> Result<Self, Problem> {
        let mut run = recorded::open(path)?;
        let mut summary = Self::new(run.header().clone());
        let mut timeline = Timeline::default();
        summary.ending = recorded::read_all(path, &mut run, |_, message| {
            summary.take(message);
            timeline.observe(message);
            Ok(())
        })?;
        summary.spans = timeline.finish();
        Ok(summary)
    }

    /// The joints that an event was about, in config order.
    pub(crate) fn joints_of(&self, event: Event) -> Vec<&str> {
        let what = Happening::Event(event.number());
        let spans = self.spans.iter().filter(|span| span.what == what);
        let subjects: BTreeSet<usize> = spans.flat_map(|s| s.subjects.iter().copied()).collect();
        let names = subjects.iter().filter_map(|&j| self.header.joints.get(j));
        names.map(String::as_str).collect()
    }

    fn new(header: Header) -> Self {
        Self {
            joints: vec![JointSummary::default(); header.joints.len()],
            header,
            ending: Ending::Complete,
            cycles: 0,
            first_cycle: 0,
            missing: 0,
            late: 0,
            skipped: 0,
            received: 0,
            sent: 0,
            begin_ns: 0,
            end_ns: 0,
            events: Vec::new(),
            spans: Vec::new(),
            first_events: Vec::new(),
            last_cycle: 0,
            first_late: [0; 2],
        }
    }

    fn take(&mut self, message: &CycleMessage) {
        let (record, timing) = (&message.record.cycle, &message.record.timing);
        if self.cycles == 0 {
            self.first_cycle = record.sequence;
            self.last_cycle = record.sequence.saturating_sub(1);
            self.begin_ns = record.stamp_ns;
            // The counts of the first cycle are not known but at the daemon's start.
            let known = record.sequence == 1;
            let before = |count: u64| if known { 0 } else { count };
            self.first_events = record.events.iter().map(|&count| before(count)).collect();
            self.first_late = [before(timing.late_cycles), before(timing.skipped_cycles)];
        }
        self.cycles += 1;
        self.missing += record.sequence.saturating_sub(self.last_cycle + 1);
        self.last_cycle = record.sequence;
        self.end_ns = record.stamp_ns;
        self.late = timing.late_cycles.saturating_sub(self.first_late[0]);
        self.skipped = timing.skipped_cycles.saturating_sub(self.first_late[1]);
        self.received += message.rx.len() as u64;
        self.sent += message.tx.len() as u64;
        let counts = Event::ALL
            .iter()
            .zip(record.events.iter().zip(&self.first_events));
        let counts = counts.map(|(event, (now, first))| (*event, now.saturating_sub(*first)));
        self.events = counts.filter(|(_, times)| *times > 0).collect();
        let joints = record.measured.joints.iter().zip(&record.estimated.joints);
        let joints = joints.zip(&record.commanded.joints).zip(&mut self.joints);
        for (((measured, estimated), commanded), joint) in joints {
            joint.q_min = joint.q_min.min(measured.q);
            joint.q_max = joint.q_max.max(measured.q);
            joint.dq_max = joint.dq_max.max(measured.dq.abs());
            joint.tau_max = joint.tau_max.max(estimated.tau_hat.tau.abs());
            joint.sigma_sum += estimated.tau_hat.sigma;
            joint.cycles += 1;
            joint.missed += u64::from(measured.flags & measured_flags::MISSED != 0);
            joint.limited += u64::from(commanded.flags & !command_flags::ENGAGED != 0);
        }
    }
}
