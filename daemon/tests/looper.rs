//! The loop's thread from its start to its controlled end, in front of a simulated robot.

use crate::common;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use can_codec::{Frames, Gather, Table};
use common::{RunDir, plant, robot, sim};
use plant::CanRobot;
use problem::Problem;
use robot_config::Robot;
use robot_state::{CycleRecord, Description, Event, Name, RobotState};
use torqued::bus::in_process::{VirtualClock, VirtualDeadline};
use torqued::bus::{Bus, BusCounters, LockStep};
use torqued::control_loop::ControlLoop;
use torqued::loop_monitor::LoopMonitor;
use torqued::looper::{Looper, Outcome};
use torqued::real_time::{Pace, WakeReport};
use torqued::request_server::RequestServer;
use torqued::shared_memory;
use torqued::summary::Timing;

fn leg() -> Robot {
    let mut leg = robot("leg");
    // The virtual clock is faster than the publisher thread.
    leg.parameters.safety.publisher_timeout = 10.0;
    leg
}

fn lock_step(robot: &Robot, clock: &VirtualClock) -> LockStep<CanRobot> {
    LockStep::new(plant(robot, &sim("leg")), clock)
}

/// A bus with something wrong from some cycle on.
struct Spoilt {
    bus: LockStep<CanRobot>,
    from_ns: u64,
    trouble: Trouble,
    counters: BusCounters,
}

#[derive(Debug, Clone, Copy)]
enum Trouble {
    BusOff,
    LinkDown,
    QueueFull,
}

impl Spoilt {
    fn is_spoilt(&self) -> bool {
        self.bus.now_ns() >= self.from_ns
    }
}

impl Bus for Spoilt {
    fn send(&mut self, frames: &Frames) -> usize {
        let refused = frames.len() as u64;
        match self.trouble {
            _ if !self.is_spoilt() => return self.bus.send(frames),
            Trouble::BusOff => self.counters.bus_off = 1,
            Trouble::LinkDown => self.counters.link_down += refused,
            Trouble::QueueFull => {}
        }
        self.counters.send_failed += refused;
        0
    }

    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64) {
        self.bus.receive(rx, gather, table, until_ns);
    }

    fn counters(&self) -> BusCounters {
        BusCounters {
            bus_off: self.counters.bus_off,
            link_down: self.counters.link_down,
            send_failed: self.counters.send_failed,
            ..self.bus.counters()
        }
    }

    fn now_ns(&self) -> u64 {
        self.bus.now_ns()
    }
}

/// Cycle starts on a virtual clock; `act` is called before each, with its number.
struct Script<'a> {
    pace: VirtualDeadline,
    cycle: u64,
    act: &'a mut dyn FnMut(u64),
}

impl Pace for Script<'_> {
    fn wait(&mut self) -> WakeReport {
        self.cycle += 1;
        (self.act)(self.cycle);
        self.pace.wait()
    }
}

/// One run of the leg's loop on a bus that `wrap` makes of the simulated robot.
struct Run {
    outcome: Outcome,
    cycles: u64,
}

fn run<B: Bus>(
    cycles: Option<u64>,
    start_with: Option<Event>,
    wrap: impl FnOnce(LockStep<CanRobot>) -> B,
    act: impl Fn(u64, &AtomicBool),
) -> (Run, Looper<B>) {
    let directory = RunDir::new();
    let robot = leg();
    let clock = VirtualClock::new();
    clock.advance_to(1_000_000_000);
    let bus = wrap(lock_step(&robot, &clock));
    let mut control_loop = ControlLoop::new(&robot, bus).expect("a loop");
    if let Some(event) = start_with {
        control_loop.start_with_fault(event);
    }
    let server = RequestServer::new(&robot, Err(Problem::new("no state directory", "")))
        .expect("a request server");
    let description = Description {
        robot: Name::new("leg"),
        joint_count: 6,
        ..Description::default()
    };
    let ends = shared_memory::start_at(
        &directory.location,
        &description,
        server,
        supervisor::Commanders::new(0.04),
    )
    .expect("shared memory");
    let stop = Arc::new(AtomicBool::new(false));
    let mut looper = Looper::new(&robot, control_loop, ends, &stop, cycles);
    let mut act = |cycle: u64| {
        assert!(cycle < 20_000, "the loop does not end");
        act(cycle, &stop);
    };
    let mut pace = Script {
        pace: VirtualDeadline::new(&clock, 1_000_000),
        cycle: 0,
        act: &mut act,
    };
    let outcome = looper.run(&mut pace, &mut Timing::new());
    let cycles = outcome.record.timing.cycles;
    (Run { outcome, cycles }, looper)
}

/// Cycles after which the leg holds.
const HOLDING: u64 = 600;

#[test]
fn asked_to_end_the_loop_stops_and_disables_the_robot() {
    let (run, _) = run(
        None,
        None,
        |bus| bus,
        |cycle, stop| stop.store(cycle >= HOLDING, Ordering::Relaxed),
    );
    let record = &run.outcome.record.cycle;
    assert_eq!(record.state, RobotState::Ready.number(), "drives are off");
    assert_eq!(
        (record.requests, record.refusal),
        (2, 0),
        "stop and disable"
    );
    assert!(
        (HOLDING + 50..HOLDING + 2200).contains(&run.cycles),
        "{} cycles",
        run.cycles
    );
}

#[test]
fn the_time_given_includes_the_controlled_end() {
    let (run, _) = run(Some(900), None, |bus| bus, |_, _| {});
    assert_eq!(run.cycles, 900);
    let record = &run.outcome.record.cycle;
    assert_eq!(record.state, RobotState::Ready.number());
}

#[test]
fn a_fault_of_an_earlier_run_is_latched_until_the_end() {
    let stored = Some(Event::JointStale);
    let (run, looper) = run(Some(900), stored, |bus| bus, |_, _| {});
    let record = &run.outcome.record;
    assert_eq!(record.cycle.fault, Event::JointStale.number());
    // The leg's two buses carry one SYNC each in a cycle, and every 100 cycles the control words that
    // keep the drives off: no set-points.
    let cycles = record.timing.cycles;
    assert_eq!(
        looper.bus().counters().sent,
        2 * (cycles + cycles.div_ceil(100))
    );
}

#[test]
fn buses_that_fail_are_faults_and_do_not_prevent_the_end() {
    for (trouble, fault) in [
        (Trouble::BusOff, Event::BusDown),
        (Trouble::LinkDown, Event::BusDown),
        (Trouble::QueueFull, Event::SendFailing),
    ] {
        let spoil = |bus| Spoilt {
            bus,
            from_ns: 1_000_000_000 + HOLDING * 1_000_000,
            trouble,
            counters: BusCounters::default(),
        };
        let stop_at = HOLDING + 100;
        let (run, _) = run(None, None, spoil, |cycle, stop| {
            stop.store(cycle >= stop_at, Ordering::Relaxed);
        });
        let record = &run.outcome.record.cycle;
        let (index, number) = (fault.index(), fault.number());
        assert!(record.events[index] > 0, "{trouble:?}");
        // A queue that is full for longer than joints may be silent is both.
        let stale = Event::JointStale.number();
        assert!([number, stale].contains(&record.fault), "{trouble:?}");
        assert_eq!(record.state, RobotState::Fault.number());
        assert!(run.cycles < stop_at + 2200, "{} cycles", run.cycles);
    }
}

#[test]
fn cycles_that_stay_late_are_a_fault() {
    struct Late(VirtualDeadline, VirtualClock);
    impl Pace for Late {
        fn wait(&mut self) -> WakeReport {
            self.1.advance_to(self.1.now_ns() + 1_500_000);
            self.0.wait()
        }
    }
    let clock = VirtualClock::new();
    let mut late = Late(VirtualDeadline::new(&clock, 1_000_000), clock);
    let mut robot = leg();
    robot.parameters.safety.late_share = 0.5;
    let mut monitor = LoopMonitor::new(&robot, BusCounters::default());
    let last = CycleRecord {
        state: RobotState::Active.number(),
        ..CycleRecord::default()
    };
    let found = (1..1000).find_map(|heartbeat| {
        let wake = late.wait();
        let mut faults = monitor.faults(&wake, BusCounters::default(), heartbeat, &last);
        faults.next()
    });
    assert_eq!(found, Some(Event::LatenessLasts));
}
