//! An eventful run of the humanoid in front of the daemon's loop: a client that moves it and is
//! killed now and then, tares, changes of contacts, lost frames, a joint that falls silent, an
//! operator who acknowledges and enables, cycles left out. All of it follows from the cycle's number.

use std::path::Path;
use std::time::Instant;

use can_codec::{Frames, Gather, Table};
use cycle::{ClientInput, OperatorRequest};
use plant::CanRobot;
use recording::{AttachedFile, Header, Start};
use robot_config::Robot;
use robot_state::{CycleRecord, Mode, Reference, RobotState, Settings};
use torqued::bus::in_process::{VirtualClock, VirtualDeadline};
use torqued::bus::{Bus, BusCounters, FaultInjector, Faults, LockStep};
use torqued::control_loop::ControlLoop;
use torqued::real_time::Pace;
use torqued::recorder::{self, Contents, RecordingRequest};

use super::{plant, sim};

/// Cycles after which everything comes again.
const ROUND: u64 = 8000;
/// Within a round: the client is killed, and another one begins.
const KILLED: std::ops::Range<u64> = 2500..2800;
/// Within a round: the joint is silent, for longer than allowed.
const SILENT: std::ops::Range<u64> = 5000..5060;
/// Within a round: so many cycles are left out here.
const SKIP_AT: u64 = 3700;

/// A bus on which one joint falls silent.
struct Silencing<B> {
    bus: B,
    muted: Vec<(u8, u32)>,
    silent: bool,
    kept: Frames,
}

impl<B: Bus> Bus for Silencing<B> {
    fn send(&mut self, frames: &Frames) -> usize {
        self.bus.send(frames)
    }

    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64) {
        self.kept.clear();
        self.bus.receive(&mut self.kept, gather, table, until_ns);
        for frame in &self.kept {
            if !(self.silent && self.muted.contains(&(frame.bus, frame.id))) {
                rx.push(*frame);
            }
        }
    }

    fn counters(&self) -> BusCounters {
        self.bus.counters()
    }

    fn now_ns(&self) -> u64 {
        self.bus.now_ns()
    }
}

/// Events that must have happened, for the run to be worth replaying.
#[derive(Debug, Default)]
pub(crate) struct Happened {
    pub(crate) faults: u64,
    pub(crate) active: u64,
    pub(crate) contact_changes: u64,
    pub(crate) skipped: u64,
    /// Cycles that the recorder did not get.
    pub(crate) lost: u64,
    /// Cycles that were recorded.
    pub(crate) cycles: u64,
}

/// Runs it for so many cycles, recorded into `path` from the first one on.
pub(crate) fn record(
    robot: &Robot,
    files: Vec<AttachedFile>,
    cycles: u64,
    path: &Path,
    contents: Contents,
) -> Happened {
    let clock = VirtualClock::new();
    clock.advance_to(1_000_000_000);
    let mut control_loop = ControlLoop::new(robot, bus(robot, &clock)).expect("a loop");
    let mut ends = recorder::create(robot, Header::new(robot, files, Start::default()), None);
    control_loop.record_to(ends.tap);
    ends.handle.ask(RecordingRequest::Begin {
        path: path.to_owned(),
        seconds: None,
        last_s: 0.0,
        contents,
        overwrite: false,
        unattended: true,
    });
    let mut pace = VirtualDeadline::new(&clock, 1_000_000);
    let mut client = Client::new(robot);
    let mut happened = Happened::default();
    let mut last = CycleRecord::default();
    for cycle in 1..=cycles {
        ends.recorder.poll(Instant::now());
        let place = cycle % ROUND;
        if place == SKIP_AT {
            clock.advance_to(clock.now_ns() + 3_200_000);
        }
        control_loop.bus_mut().silent = SILENT.contains(&place);
        let wake = pace.wait();
        happened.skipped += wake.skipped;
        client.prepare(place, cycle, &last);
        let record = control_loop.run_cycle(&wake, &client.input());
        happened.faults += u64::from(record.cycle.fault != 0 && last.fault == 0);
        happened.active += u64::from(record.cycle.state == RobotState::Active.number());
        let sets = [
            record.cycle.estimated.contact_set,
            last.estimated.contact_set,
        ];
        happened.contact_changes += u64::from(sets[0] != sets[1]);
        last = record.cycle;
    }
    control_loop.end_as_asked();
    drop(control_loop);
    while !ends.recorder.is_over() {
        ends.recorder.poll(Instant::now());
    }
    let status = ends.handle.status_from_start();
    assert_eq!((status.failed, status.refused), (None, None));
    happened.lost = status.lost;
    happened.cycles = status.cycles;
    happened
}

fn bus(robot: &Robot, clock: &VirtualClock) -> Silencing<FaultInjector<LockStep<CanRobot>>> {
    let faults = Faults {
        drop: 2e-4,
        duplicate: 1e-4,
        delay: 1e-4,
        corrupt_length: 1e-4,
        unknown_id: 1e-4,
        error_frame: 1e-4,
    };
    let slot = robot_config::slots::link_angle(2);
    let messages = 0..robot.receive.message_count();
    let muted = messages.filter(|&m| robot.receive.slots(m).any(|s| s == slot));
    let muted = muted.filter_map(|m| robot.receive.message(m));
    Silencing {
        muted: muted.map(|message| (message.bus, message.id)).collect(),
        bus: FaultInjector::new(
            LockStep::new(plant(robot, &sim("humanoid")), clock),
            &robot.receive,
            faults,
            11,
        ),
        silent: false,
        kept: Frames::default(),
    }
}

/// Client, operator and tares.
struct Client {
    reference: Reference,
    settings: Settings,
    age_s: f64,
    request: Option<OperatorRequest>,
    start: Option<Vec<f64>>,
    /// Of the motion, rad; in every other round the other way, as each one begins where the last one
    /// was interrupted.
    amplitude: f64,
    /// Cycle of the last interruption: the client asks for hold before it moves on.
    interrupted: u64,
}

impl Client {
    fn new(robot: &Robot) -> Self {
        Self {
            reference: Reference {
                joint_count: robot.parameters.joints.len() as u32,
                ..Reference::default()
            },
            settings: Settings::default(),
            age_s: 0.0,
            request: None,
            start: None,
            amplitude: 0.0,
            interrupted: 0,
        }
    }

    fn prepare(&mut self, place: u64, cycle: u64, last: &CycleRecord) {
        let n = self.reference.joint_count as usize;
        let holding = last.state == RobotState::Holding.number();
        let moving = holding || last.state == RobotState::Active.number();
        self.request = match RobotState::from_number(last.state) {
            Some(RobotState::Fault) if cycle.is_multiple_of(200) => {
                Some(OperatorRequest::Acknowledge(last.fault))
            }
            Some(RobotState::Ready) if cycle % 200 == 100 => Some(OperatorRequest::Enable),
            _ => None,
        };
        if KILLED.contains(&place) || !moving {
            self.interrupted = cycle;
            self.start = None;
            self.age_s += 0.001;
            return;
        }
        self.age_s = 0.0005;
        let since = cycle - self.interrupted;
        if holding && self.start.is_none() {
            let joints = last.measured.joints.iter().take(n);
            self.start = Some(joints.map(|joint| joint.q).collect());
            self.amplitude = if (cycle / ROUND).is_multiple_of(2) {
                0.01
            } else {
                -0.01
            };
        }
        self.reference.sequence += 1;
        self.reference.mode = match since {
            0..300 => Mode::Hold.number(),
            _ => Mode::InverseDynamics.number(),
        };
        let t = since.saturating_sub(300) as f64 * 0.001;
        let start = self.start.iter().flatten();
        for (j, (joint, start)) in self.reference.joints.iter_mut().zip(start).enumerate() {
            let (w, a) = (2.0 + 0.1 * j as f64, self.amplitude);
            joint.q_d = start + a * (1.0 - (w * t).cos());
            joint.dq_d = a * w * (w * t).sin();
            joint.ddq_d = a * w * w * (w * t).cos();
        }
        self.change_settings(place);
    }

    /// Tares and choices of contacts.
    fn change_settings(&mut self, place: u64) {
        match place {
            900 => self.settings.contact_set = 1,
            1900 => self.settings.contact_set = 2,
            3000 => self.settings.contact_set = 0,
            4000 => {
                self.settings.ft_offset[0].force[2] += 1.5;
                self.settings.ft_offset[1].torque[0] -= 0.1;
            }
            _ => return,
        }
        self.settings.sequence += 1;
    }

    fn input(&self) -> ClientInput<'_> {
        ClientInput {
            reference: (self.reference.sequence > 0).then_some(&self.reference),
            age_s: self.age_s,
            settings: Some(&self.settings),
            request: self.request,
            ..ClientInput::default()
        }
    }
}
