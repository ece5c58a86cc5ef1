//! One cycle around `Cycle::step`: SYNC, gather, compute, send.

use can_codec::{Frames, Gather, MAX_FRAMES, Table};
use cycle::{ClientInput, Cycle, Instants, Stamp};
use drives::canopen::heartbeat;
use drives::cia402::MASTER;
use problem::Problem;
use recording::CycleInput;
use robot_config::Robot;
use robot_state::{Event, SharedRecord};

use crate::bus::{Bus, BusCounters};
use crate::cycle_times::{CycleTimes, TimesSender};
use crate::real_time::{WakeReport, monotonic_ns};
use crate::recorder::Tap;

/// The heartbeat that CANopen drives listen for. The loop itself sends it: where the loop ends or
/// hangs, they stop.
struct Heartbeat {
    /// One for each bus that has such drives.
    frames: Frames,
    /// Cycles from one to the next: a third of the shortest time after which a drive stops.
    interval: u32,
    cycles: u32,
}

impl Heartbeat {
    fn new(robot: &Robot) -> Self {
        let mut buses: Vec<u8> = robot.nodes.plans.iter().map(|plan| plan.bus).collect();
        buses.sort_unstable();
        buses.dedup();
        let mut frames = Frames::new(buses.len());
        for bus in buses {
            frames.push(heartbeat(bus, MASTER));
        }
        let cycles = robot.nodes.heartbeat / robot.parameters.timing.sample_period / 3.0;
        Self {
            frames,
            interval: cycles.max(1.0) as u32,
            cycles: 0,
        }
    }

    /// It is due in this cycle.
    fn is_due(&mut self) -> bool {
        let due = self.cycles == 0 && !self.frames.is_empty();
        self.cycles = (self.cycles + 1) % self.interval;
        due
    }
}

/// A robot's loop: the computation and the bus it lives on.
pub struct ControlLoop<B> {
    bus: B,
    cycle: Cycle,
    receive_table: Table,
    gather: Gather,
    gather_deadline_ns: u64,
    sync: Frames,
    heartbeat: Heartbeat,
    rx: Frames,
    tx: Frames,
    record: SharedRecord,
    last_counters: BusCounters,
    tap: Option<Tap>,
    times: Option<TimesSender>,
}

impl<B: Bus> ControlLoop<B> {
    /// The loop of `robot` on `bus`; allocates everything that it will need.
    ///
    /// # Errors
    /// As [`Cycle::new`].
    pub fn new(robot: &Robot, bus: B) -> Result<Self, Problem> {
        let mut sync = Frames::new(robot.sync.len());
        for frame in &robot.sync {
            sync.push(*frame);
        }
        Ok(Self {
            cycle: Cycle::new(robot)?,
            gather: Gather::only(&robot.answers()),
            receive_table: robot.receive.clone(),
            gather_deadline_ns: (robot.parameters.timing.gather_deadline * 1e9) as u64,
            sync,
            heartbeat: Heartbeat::new(robot),
            rx: Frames::new(MAX_FRAMES),
            tx: Frames::new(MAX_FRAMES),
            record: SharedRecord::default(),
            last_counters: bus.counters(),
            tap: None,
            times: None,
            bus,
        })
    }

    /// Starts with a fault that was latched before: to be called before the first cycle.
    pub fn start_with_fault(&mut self, event: Event) {
        self.cycle.start_with_fault(event);
    }

    /// Reports an event of the process around the loop, to be reacted to in the coming cycle.
    pub fn note(&mut self, event: Event) {
        self.report(event, 1);
    }

    /// Hands every cycle to the recorder: to be called before the first one.
    pub fn record_to(&mut self, tap: Tap) {
        self.tap = Some(tap);
    }

    /// Hands every cycle's times over: to be called before the first one.
    pub fn time_by(&mut self, times: TimesSender) {
        self.times = Some(times);
    }

    /// The loop ends because it was asked to.
    pub fn end_as_asked(&self) {
        if let Some(tap) = &self.tap {
            tap.end_as_asked();
        }
    }

    /// Runs the cycle that begins with `wake`.
    pub fn run_cycle(&mut self, wake: &WakeReport, input: &ClientInput<'_>) -> &SharedRecord {
        let started = monotonic_ns();
        self.rx.clear();
        self.tx.clear();
        // Frames that came too late for the last cycle must not pass for answers to this SYNC.
        self.receive_until(0);
        self.gather.begin();
        // Before it is sent: the first answer may be stamped before `send` returns.
        let sync = Stamp(self.bus.now_ns());
        let synced = self.bus.send(&self.sync);
        self.receive_until(sync.0 + self.gather_deadline_ns);

        let gathered = monotonic_ns();
        let at = Instants {
            sync,
            now: Stamp(self.bus.now_ns()),
        };
        self.note_events(wake, self.sync.len().saturating_sub(synced));
        let mut times = CycleTimes::default();
        let mut stage_began = monotonic_ns();
        let record = (self.cycle).step_watched(at, &self.rx, input, &mut self.tx, |stage| {
            let now = monotonic_ns();
            times.stages_ns[stage] = now - stage_began;
            stage_began = now;
        });
        self.record.cycle = *record;
        let computed = monotonic_ns();

        if self.heartbeat.is_due() {
            // A lost one is made good by the next; three in a row stop the drives.
            self.bus.send(&self.heartbeat.frames);
        }
        let accepted = self.bus.send(&self.tx);
        // Counted by the cycle, so it appears in the next record.
        let refused = self.tx.len().saturating_sub(accepted) as u64;
        self.time(wake, [started, gathered, computed, monotonic_ns()]);
        self.hand_over(wake, times);
        if let Some(tap) = &mut self.tap {
            let client = *input;
            let rx = &self.rx;
            tap.take(&CycleInput { at, rx, client }, &self.record, &self.tx);
        }
        self.report(Event::SendFailed, refused);
        &self.record
    }

    /// The bus.
    pub fn bus(&self) -> &B {
        &self.bus
    }

    /// The bus, mutable.
    pub fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    /// Waits at most so long for answers to the last SYNC that had not come in time; returns the
    /// number of frames received since the start.
    pub fn receive_late(&mut self, longest_ns: u64) -> u64 {
        self.rx.clear();
        self.receive_until(self.bus.now_ns() + longest_ns);
        self.bus.counters().received
    }

    fn receive_until(&mut self, until_ns: u64) {
        self.bus.receive(
            &mut self.rx,
            &mut self.gather,
            &self.receive_table,
            until_ns,
        );
    }

    fn note_events(&mut self, wake: &WakeReport, unsent: usize) {
        let counters = self.bus.counters();
        let dropped = counters.dropped - self.last_counters.dropped;
        let refused = counters.refused_datagrams - self.last_counters.refused_datagrams;
        self.last_counters = counters;
        // The cycle itself counts what found no room in `rx`; the rest was lost before.
        let lost_before = dropped.saturating_sub(self.rx.overflow());
        self.report(Event::ReceiveOverflow, lost_before);
        self.report(Event::DatagramRefused, refused);
        self.report(Event::SendFailed, unsent as u64);
        self.report(Event::LateCycle, u64::from(wake.late));
        self.report(Event::SkippedCycle, wake.skipped);
    }

    /// Every event goes through here: it is a part of what the coming cycle is given.
    fn report(&mut self, event: Event, times: u64) {
        if let Some(tap) = &mut self.tap {
            tap.note(event, times);
        }
        self.cycle.note(event, times);
    }

    /// Hands this cycle's times to whoever keeps them.
    fn hand_over(&mut self, wake: &WakeReport, mut times: CycleTimes) {
        let Some(sender) = &mut self.times else {
            return;
        };
        let timing = &self.record.timing;
        times.cycle = timing.cycles;
        times.wake_ns = timing.wake_late_ns;
        times.gather_ns = timing.gather_ns;
        times.send_ns = timing.send_ns;
        (times.after_late, times.skipped) = (wake.late, wake.skipped);
        let last = self.rx.as_slice().last();
        let last = last.and_then(|frame| self.receive_table.classify(frame));
        times.messages(last, self.gather.missing().next());
        sender.send(times);
    }

    fn time(&mut self, wake: &WakeReport, [started, gathered, computed, sent]: [u64; 4]) {
        let counters = self.bus.counters();
        let timing = &mut self.record.timing;
        timing.cycles += 1;
        timing.late_cycles += u64::from(wake.late);
        timing.skipped_cycles += wake.skipped;
        timing.wake_late_ns = wake.wake_late_ns();
        timing.gather_ns = gathered - started;
        timing.compute_ns = computed - gathered;
        timing.send_ns = sent - computed;
        timing.frames_received = counters.received;
        timing.frames_sent = counters.sent;
    }
}
