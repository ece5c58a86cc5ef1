//! The loop's thread: cycle after cycle until the end, and its exchange with clients and the main
//! thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

use cycle::{ClientInput, OperatorRequest};
use nix::sys::resource::{UsageWho, getrusage};
use robot_config::Robot;
use robot_state::{JointMeasured, SharedRecord, measured_flags};

use crate::bus::Bus;
use crate::control_loop::ControlLoop;
use crate::ending::Ending;
use crate::loop_monitor::LoopMonitor;
use crate::real_time::Pace;
use crate::shared_memory::LoopEnds;
use crate::summary::{PageFaults, Timing};

/// State of the loop that the main thread reads while it runs.
#[derive(Debug, Default)]
pub struct Status {
    /// Cycles run.
    pub cycles: AtomicU64,
    /// A bit for each joint that has never answered.
    pub silent: AtomicU64,
    /// The latched fault's number, or 0.
    pub fault: AtomicU32,
    /// Number of the robot's state.
    pub state: AtomicU32,
    /// Stops that were asked for without shared memory, and begun.
    pub signalled_stops: AtomicU32,
}

impl Status {
    fn show(&self, record: &SharedRecord) {
        let joints = record
            .cycle
            .measured
            .joints
            .iter()
            .take(record.cycle.joint_count as usize);
        let never = |joint: &JointMeasured| joint.flags & measured_flags::NEVER != 0;
        let silent = joints.enumerate().filter(|(_, joint)| never(joint));
        let silent = silent.fold(0, |bits, (j, _)| bits | 1u64 << j);
        self.silent.store(silent, Ordering::Relaxed);
        self.fault.store(record.cycle.fault, Ordering::Relaxed);
        self.state.store(record.cycle.state, Ordering::Relaxed);
        self.cycles.store(record.timing.cycles, Ordering::Release);
    }
}

/// Longest wait, after the last cycle, for answers that are still on their way, ns.
const LATE_ANSWERS_NS: u64 = 20_000_000;

/// Results of a loop that has ended.
#[derive(Debug)]
pub struct Outcome {
    /// The last record.
    pub record: SharedRecord,
    /// Page faults of the thread while it looped.
    pub page_faults: PageFaults,
    /// Records that were dropped before they reached clients.
    pub dropped: u64,
}

/// The loop of one robot, between bus and clients.
pub struct Looper<B> {
    control_loop: ControlLoop<B>,
    clients: LoopEnds,
    monitor: LoopMonitor,
    ending: Ending,
    status: Arc<Status>,
    stop: Arc<AtomicBool>,
    stop_and_hold: Arc<AtomicBool>,
    cycles: u64,
}

impl<B: Bus> Looper<B> {
    /// A loop that begins its controlled end when `stop` is set, or early enough to be over once
    /// `cycles` have begun or been skipped.
    pub fn new(
        robot: &Robot,
        control_loop: ControlLoop<B>,
        clients: LoopEnds,
        stop: &Arc<AtomicBool>,
        cycles: Option<u64>,
    ) -> Self {
        let parameters = &robot.parameters;
        let (limit, period) = (
            parameters.safety.time_limit,
            parameters.timing.sample_period,
        );
        let rest = parameters.joints.iter().map(|joint| joint.limits.rest);
        Self {
            monitor: LoopMonitor::new(robot, control_loop.bus().counters()),
            control_loop,
            clients,
            ending: Ending::new(limit, period, rest.collect()),
            status: Arc::default(),
            stop: Arc::clone(stop),
            stop_and_hold: Arc::default(),
            cycles: cycles.unwrap_or(u64::MAX),
        }
    }

    /// Brings the robot to rest and holds it whenever this flag is set; the loop takes it back. This
    /// way needs neither shared memory nor another thread.
    pub fn stop_and_hold_when(&mut self, asked: &Arc<AtomicBool>) {
        self.stop_and_hold = Arc::clone(asked);
    }

    /// The loop's state, for another thread to read.
    #[must_use]
    pub fn status(&self) -> Arc<Status> {
        Arc::clone(&self.status)
    }

    /// Runs cycles until the end; neither allocates nor waits for another thread.
    pub fn run(&mut self, pace: &mut impl Pace, timing: &mut Timing) -> Outcome {
        let mut last = SharedRecord::default();
        let before = page_faults();
        // Skipped starts count too: `--seconds` means time.
        let mut starts = 0;
        let last_start = self.cycles.saturating_sub(self.ending.least_cycles());
        loop {
            let wake = pace.wait();
            let begun = 1 + wake.skipped;
            let asked = starts >= last_start || self.stop.load(Ordering::Relaxed);
            starts += begun;
            let was_running = self.ending.is_running();
            let heartbeat = self.clients.records.heartbeat();
            let counters = self.control_loop.bus().counters();
            let faults = (self.monitor).faults(&wake, counters, heartbeat, &last.cycle);
            faults.for_each(|event| self.control_loop.note(event));
            let request = self.ending.advance(asked, begun, &last.cycle);
            let operator = self.signalled_stop();
            let operator = operator.or_else(|| self.clients.operator.next_request());
            if self.ending.is_over() {
                self.control_loop.end_as_asked();
                break;
            }
            let commanders = self.clients.references.next_command(wake.woke_ns);
            let input = ClientInput {
                reference: commanders.reference().filter(|_| was_running),
                age_s: commanders.age_s(wake.woke_ns),
                commander: commanders.record(),
                settings: Some(self.clients.settings.latest()),
                request: request.or(operator.filter(|_| was_running)),
            };
            let record = self.control_loop.run_cycle(&wake, &input);
            self.clients.records.send(record);
            timing.take(&record.timing);
            self.status.show(record);
            last = *record;
        }
        let after = page_faults();
        last.timing.frames_received = self.control_loop.receive_late(LATE_ANSWERS_NS);
        Outcome {
            record: last,
            page_faults: PageFaults {
                minor: after.minor - before.minor,
                major: after.major - before.major,
            },
            dropped: self.clients.records.overflow(),
        }
    }

    /// The stop that was asked for by the flag of [`stop_and_hold_when`](Self::stop_and_hold_when).
    fn signalled_stop(&self) -> Option<OperatorRequest> {
        let asked = self.stop_and_hold.swap(false, Ordering::Relaxed);
        asked.then(|| {
            self.status.signalled_stops.fetch_add(1, Ordering::Relaxed);
            OperatorRequest::Stop
        })
    }

    /// The bus.
    pub fn bus(&self) -> &B {
        self.control_loop.bus()
    }
}

/// Page faults of the calling thread so far.
fn page_faults() -> PageFaults {
    getrusage(UsageWho::RUSAGE_THREAD).map_or(PageFaults::default(), |usage| PageFaults {
        minor: usage.minor_page_faults().unsigned_abs(),
        major: usage.major_page_faults().unsigned_abs(),
    })
}
