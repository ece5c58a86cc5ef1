//! A daemon's end of shared memory in this process: it follows references, and answers requests.

use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, sleep, spawn};
use std::time::Duration;

use control::{MotionLimits, TrajectoryLimits};
use nix::time::{ClockId, clock_gettime};
use supervisor::Commanders;
use test_support::TemporaryDirectory;
use torqued_client::robot_state::{
    Answer, Description, Mode, Name, Request, RobotState, SharedRecord, Text, Wrench,
    answer_status, frame_flags, request, torque_flags,
};
use torqued_client::{DaemonPorts, Location};

use crate::compiled::expect;

const JOINTS: u32 = 6;

/// A robot "leg", which holds and follows references at once.
pub(crate) struct StandIn {
    location: Location,
    done: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    _directory: TemporaryDirectory,
}

impl StandIn {
    pub(crate) fn start() -> Self {
        let directory = TemporaryDirectory::new();
        let location = Location::at(directory.path()).expect("a run directory");
        let directory = directory.with_shared_memory(location.shared_memory_prefix());
        let ports = DaemonPorts::create(&location, &description()).expect("the daemon's end");
        let done = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&done);
        let thread = spawn(move || serve(&ports, &ended));
        Self {
            location,
            done,
            thread: Some(thread),
            _directory: directory,
        }
    }

    /// Runs a program beside the daemon; what it prints.
    pub(crate) fn run(&self, program: &Path, arguments: &[&str]) -> String {
        expect(
            Command::new(program)
                .args(arguments)
                .env("TORQUED_RUN_DIR", self.location.path()),
        )
    }
}

impl Drop for StandIn {
    fn drop(&mut self) {
        self.done.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn description() -> Description {
    let mut description = Description {
        robot: Name::new("leg"),
        rate_hz: 1000.0,
        joint_count: JOINTS,
        ft_count: 1,
        frame_count: 1,
        ..Description::default()
    };
    for j in 0..JOINTS as usize {
        description.joint_names[j] = Name::new(&format!("joint_{j}"));
    }
    // As long as a name can be: no zero at its end.
    description.joint_names[5] = Name::new(&"x".repeat(48));
    description.ft_names[0] = Name::new("ankle");
    description.contact_set_count = 1;
    description.contact_set_names[0] = Name::new("in_the_air");
    description
}

fn limits() -> TrajectoryLimits {
    TrajectoryLimits {
        position_min: -1.0,
        position_max: 1.0,
        velocity: 5.0,
        acceleration: 100.0,
        stop: MotionLimits {
            velocity: 5.0,
            acceleration: 50.0,
            jerk: 1e3,
        },
    }
}

fn serve(ports: &DaemonPorts, ended: &AtomicBool) {
    let mut record = SharedRecord::default();
    record.cycle.joint_count = JOINTS;
    record.cycle.state = RobotState::Holding.number();
    record.cycle.commanded.frames[0].flags = frame_flags::VALID;
    record.cycle.commanded.frames[0].orientation[0] = 1.0;
    for (j, joint) in (0..JOINTS).zip(&mut record.cycle.estimated.joints) {
        (joint.tau_encoder.tau, joint.tau_encoder.sigma) = (f64::from(j) + 0.5, 0.5);
        joint.tau_encoder.flags = torque_flags::VALID;
    }
    // Longer than a loaded machine keeps a program waiting.
    let mut commanders = Commanders::new(2.0).with_trajectories([limits(); JOINTS as usize]);
    while !ended.load(Ordering::Relaxed) {
        let now_ns = monotonic_ns();
        while let Some(reference) = ports.next_reference().expect("received") {
            commanders.offer(&reference, now_ns);
        }
        while let Some(piece) = ports.next_piece().expect("received") {
            let _ = commanders.offer_piece(&piece);
        }
        commanders.begin_cycle(now_ns);
        record.cycle.commander = commanders.record();
        record.cycle.mode = Mode::Hold.number();
        if let Some(reference) = commanders.reference() {
            record.cycle.commander.sequence = reference.sequence;
            record.cycle.mode = reference.mode;
            for (joint, desired) in record
                .cycle
                .measured
                .joints
                .iter_mut()
                .zip(&reference.joints)
            {
                joint.q = desired.q_d;
            }
        }
        record.cycle.sequence += 1;
        record.cycle.stamp_ns = record.cycle.sequence * 1_000_000;
        while let Some(asked) = ports.next_request().expect("received") {
            answer(ports, &asked);
        }
        ports.publish(&record).expect("published");
        ports.cleanup_dead_clients();
        sleep(Duration::from_millis(1));
    }
}

fn answer(ports: &DaemonPorts, asked: &Request) {
    let mut answer = Answer {
        id: asked.id,
        ft_count: 1,
        status: answer_status::WORKING,
        progress: 0.5,
        ..Answer::default()
    };
    if asked.kind == request::TARE {
        ports.answer(&answer).expect("answered");
        answer.ft[0].offset = Wrench {
            force: [1.0, 2.0, 3.0],
            torque: [4.0, 5.0, 6.0],
        };
    }
    let refused = asked.kind == request::CHOOSE_CONTACT_SET && asked.contact_set.as_str() == "moon";
    answer.status = if refused {
        answer_status::REFUSED
    } else {
        answer_status::DONE
    };
    if refused {
        answer.text = Text::new("no moon; allowed: in_the_air");
    }
    ports.answer(&answer).expect("answered");
}

fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC).expect("a clock");
    now.tv_sec().unsigned_abs() * 1_000_000_000 + now.tv_nsec().unsigned_abs()
}
