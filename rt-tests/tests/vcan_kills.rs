//! Processes killed and buses taken down on a real kernel's CAN: how soon it is noticed, what the robot
//! does, and what is left. Each kind a few times; with KILLS_PAGE=FILE as often as that page says,
//! which is docs/results/safety-processes.md: rt-tests/vcan/kills.sh.
#![cfg(feature = "vcan")]

mod kills;

use std::process::Command;
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use kills::table::{Row, text};
use kills::{PATIENCE, Process, Rig, Watch, holds, recover, state};
use nix::sys::signal::Signal;
use torqued::real_time::monotonic_ns;
use torqued_client::Client;
use torqued_client::robot_state::{
    Event, Mode, Reference, SharedRecord, layout_hash, lease_refusal, measured_flags,
};

/// A commander that vanishes is noticed within this time (docs/safety.md).
const NOTICED_WITHIN_S: f64 = 0.05;
/// Cycles for which the robot is watched after it was noticed.
const WATCHED: u64 = 100;

/// There are two interfaces: one test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The robot's processes, and this program's own client.
struct Robot {
    rig: Rig,
    simulator: Process,
    daemon: Process,
    client: Client,
}

impl Robot {
    fn start() -> Self {
        Self::start_on(Rig::new())
    }

    fn start_on(rig: Rig) -> Self {
        let (simulator, daemon) = (rig.simulator(), rig.daemon());
        let mut client = rig.client();
        // A kernel that is slow at the start may have latched a fault; the tests are about later ones.
        recover(&mut client);
        Self {
            rig,
            simulator,
            daemon,
            client,
        }
    }

    /// Ends in an orderly way; gives what is left in shared memory.
    fn end(self) -> Vec<String> {
        drop(self.client);
        self.daemon.terminate();
        self.simulator.terminate();
        self.rig.shared_memory()
    }

    /// SIGKILL ends a commander, SIGSTOP makes it hang, in the midst of a motion. Gives how many
    /// had lost the command before.
    fn stop_commanders(&mut self, row: &mut Row, signal: Signal, times: u64) -> usize {
        let Self { rig, client, .. } = self;
        let mut lost_before = 0;
        while (row.states.len() as u64) < times {
            let asked = Instant::now();
            let (mut commander, lost) = rig.commander(client);
            lost_before += lost;
            let recovery_s = asked.elapsed().as_secs_f64();
            // At another phase of its motion each time, within a quarter of a second.
            let phase_ms = 37 * row.states.len() as u64 % 250;
            let cycles = (phase_ms as f64 * 1e-3 * client.description().rate_hz) as u64;
            let mut watch = Watch::begin(client);
            let last = watch.cycles(client, 2 + cycles);
            if last.cycle.commander.pid != commander.id() {
                lost_before += 1;
                continue;
            }
            let mut watch = Watch::begin(client);
            let begun_ns = monotonic_ns();
            commander.signal(signal);
            let mut newest = (0, last.cycle.sequence);
            let noticed = watch.until(client, |record| {
                let lease = &record.cycle.commander;
                if lease.session != 0 && lease.sequence != newest.0 {
                    newest = (lease.sequence, record.cycle.sequence);
                }
                lease.session == 0
            });
            row.recovery_s.push(recovery_s);
            row.noticed(noticed.cycle.sequence - newest.1, begun_ns, &noticed);
            if signal == Signal::SIGSTOP {
                // It goes on as if nothing had happened: it is not followed, and ends with an error.
                commander.signal(Signal::SIGCONT);
                assert!(!commander.wait().success(), "{}", commander.output());
            }
            let last = watch.cycles(client, WATCHED);
            row.add(&watch, &last);
        }
        lost_before
    }

    /// SIGKILL to the daemon, every other time while a client commands; then another one.
    fn kill_daemons(&mut self, row: &mut Row, times: u64) {
        for i in 0..times {
            let Self {
                rig,
                client,
                daemon,
                ..
            } = self;
            let commander = (i % 2 == 0).then(|| rig.commander(client).0);
            let mut watch = Watch::begin(client);
            let killed = Instant::now();
            daemon.signal(Signal::SIGKILL);
            daemon.wait();
            *daemon = rig.daemon();
            let last = watch.until(client, |record| holds(record) || record.cycle.fault != 0);
            row.recovery_s.push(killed.elapsed().as_secs_f64());
            if let Some(mut commander) = commander {
                assert!(!commander.wait().success(), "{}", commander.output());
            }
            watch.cycles(client, WATCHED);
            row.add(&watch, &last);
        }
    }

    /// Takes a bus down and up, and recovers as an operator would.
    fn cut_buses(&mut self, row: &mut Row, times: u64) {
        let client = &mut self.client;
        for i in 0..times {
            let interface = if i % 2 == 0 { "vcan0" } else { "vcan1" };
            let mut watch = Watch::begin(client);
            let begun_ns = monotonic_ns();
            ip(interface, "down");
            let (cycles, noticed) = until_fault(&mut watch, client);
            row.noticed(cycles, begun_ns, &noticed);
            let last = watch.cycles(client, WATCHED);
            ip(interface, "up");
            let begun = Instant::now();
            recover(client);
            row.recovery_s.push(begun.elapsed().as_secs_f64());
            watch.cycles(client, WATCHED);
            row.add(&watch, &last);
        }
    }

    /// SIGKILL to the simulated robot; then another one, which begins at a pose of its own.
    fn kill_simulators(&mut self, row: &mut Row, times: u64) {
        let Self {
            rig,
            simulator,
            client,
            ..
        } = self;
        for _ in 0..times {
            let mut watch = Watch::begin(client);
            let begun_ns = monotonic_ns();
            simulator.signal(Signal::SIGKILL);
            let (cycles, noticed) = until_fault(&mut watch, client);
            row.noticed(cycles, begun_ns, &noticed);
            let last = watch.cycles(client, WATCHED);
            simulator.wait();
            *simulator = rig.simulator();
            let begun = Instant::now();
            recover(client);
            row.recovery_s.push(begun.elapsed().as_secs_f64());
            let mut watch = Watch::begin(client);
            watch.cycles(client, WATCHED);
            row.add(&watch, &last);
        }
    }
}

/// Watches until a fault is latched; the cycles since the first in which a joint was missed.
fn until_fault(watch: &mut Watch, client: &mut Client) -> (u64, Box<SharedRecord>) {
    let mut missed = None;
    let record = watch.until(client, |record| {
        let mut joints = record.cycle.measured.joints.iter();
        if joints.any(|joint| joint.flags & measured_flags::MISSED != 0) {
            missed.get_or_insert(record.cycle.sequence);
        }
        record.cycle.fault != 0
    });
    let first = missed.unwrap_or(record.cycle.sequence);
    (record.cycle.sequence - first + 1, record)
}

fn ip(interface: &str, state: &str) {
    let mut command = Command::new("ip");
    let status = command.args(["link", "set", interface, state]).status();
    assert!(
        status.expect("ip").success(),
        "ip link set {interface} {state}"
    );
}

#[test]
fn processes_are_killed_and_buses_cut_and_the_robot_holds() {
    let _alone = alone();
    let page = std::env::var_os("KILLS_PAGE");
    let times = |all: u64, few: u64| if page.is_some() { all } else { few };
    let left_by_a_quiet_run = Robot::start().end().len();

    let mut robot = Robot::start();
    let rate_hz = robot.client.description().rate_hz;
    let begun_with = robot.rig.shared_memory().len();
    let mut killed = Row::new("commander, SIGKILL", "holding");
    let mut lost = robot.stop_commanders(&mut killed, Signal::SIGKILL, times(200, 5));
    eprintln!("{}", killed.text());
    let mut hung = Row::new("commander, SIGSTOP", "holding");
    lost += robot.stop_commanders(&mut hung, Signal::SIGSTOP, times(20, 2));
    eprintln!("{}", hung.text());
    // The daemon clears up after the dead within a moment.
    let until = Instant::now() + PATIENCE;
    while robot.rig.shared_memory().len() > begun_with && Instant::now() < until {
        sleep(Duration::from_millis(50));
    }
    let meanwhile = robot.rig.shared_memory().len();
    let mut cut = Row::new("bus down, then up", "fault 112");
    robot.cut_buses(&mut cut, times(20, 2));
    eprintln!("{}", cut.text());
    let mut simulators = Row::new("simulated robot, SIGKILL", "fault 104");
    robot.kill_simulators(&mut simulators, times(20, 2));
    eprintln!("{}", simulators.text());
    let mut daemons = Row::new("daemon, SIGKILL", "holding");
    robot.kill_daemons(&mut daemons, times(50, 4));
    eprintln!("{}", daemons.text());
    let left = robot.end();

    let rows = [killed, hung, cut, simulators, daemons];
    if let Some(path) = page {
        let counts = [begun_with, meanwhile, left_by_a_quiet_run, left.len()];
        std::fs::write(path, text(&rows, rate_hz, lost, counts)).expect("written");
    }
    for row in &rows {
        row.check();
    }
    for row in &rows[..2] {
        let slowest = row.cycles.iter().fold(0.0_f64, |a, b| a.max(*b));
        assert!(slowest / rate_hz <= NOTICED_WITHIN_S, "{}", row.text());
    }
    assert!(
        meanwhile <= begun_with,
        "{meanwhile} files, {begun_with} before"
    );
    assert_eq!(left.len(), left_by_a_quiet_run, "{left:?}");
}

/// A reference in shared memory, as a program without our client could write it.
#[repr(transparent)]
#[derive(Debug, Clone, Copy)]
struct RawReference(Reference);

// SAFETY: a `#[repr(C)]` record of numbers, under the name that the daemon knows its layout by.
unsafe impl ZeroCopySend for RawReference {
    unsafe fn type_name() -> &'static str {
        static NAME: LazyLock<String> =
            LazyLock::new(|| format!("torqued::Reference#{:016x}", layout_hash::<Reference>()));
        &NAME
    }
}

/// Sends a reference ten times, each with the next sequence and when the daemon has seen the one before;
/// gives the record after the last.
fn send_raw(
    robot: &mut Robot,
    send: impl Fn(Reference),
    reference: &mut Reference,
) -> Box<SharedRecord> {
    let mut record = None;
    for _ in 0..10 {
        reference.sequence += 1;
        reference.sent_ns = monotonic_ns();
        send(*reference);
        robot.client.latest().expect("records");
        record = Some(Watch::begin(&mut robot.client).cycles(&mut robot.client, 2));
    }
    record.expect("ten were sent")
}

/// Sends a reference beside a commander; gives the record before and after, and that commander.
/// Again with a new one if the kernel left a commander waiting until its references were stale.
fn send_beside_commander(
    robot: &mut Robot,
    send: impl Fn(Reference),
    mut reference: impl FnMut(&SharedRecord) -> Reference,
) -> (Box<SharedRecord>, Box<SharedRecord>, Process) {
    for _ in 0..20 {
        let (commander, _) = robot.rig.commander(&mut robot.client);
        let before = Watch::begin(&mut robot.client).cycles(&mut robot.client, 2);
        let after = send_raw(robot, &send, &mut reference(&before));
        let lease = &after.cycle.commander;
        if lease.session != 0 || lease.cause != Event::ReferenceStale.number() {
            return (before, after, commander);
        }
    }
    panic!("no commander keeps the command on this kernel");
}

#[test]
fn the_daemon_itself_refuses_a_second_commander() {
    let _alone = alone();
    let mut robot = Robot::start_on(Rig::with_long_lease());
    let location = &robot.rig.location;
    let mut config = Config::default();
    let root = Path::new(location.path().to_str().expect("text").as_bytes()).expect("a path");
    config.global.set_root_path(&root);
    config.global.prefix =
        FileName::new(location.shared_memory_prefix().as_bytes()).expect("a name");
    let node = NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .expect("a node");
    let service = node
        .service_builder(&"torqued/leg/reference".try_into().expect("a name"))
        .publish_subscribe::<RawReference>()
        .open()
        .expect("the daemon's service");
    let port = service.publisher_builder().create().expect("a port");
    let send = |reference| {
        port.send_copy(RawReference(reference)).expect("sent");
    };

    let mut sequence = 0;
    // As another process would send it: the pose, a tenth of a radian further.
    let mut raw = |before: &SharedRecord, priority, mode: Mode| {
        sequence += 20;
        let mut raw = Reference {
            session: 4711,
            session_began_ns: monotonic_ns(),
            sequence,
            joint_count: before.cycle.joint_count,
            pid: std::process::id(),
            priority,
            mode: mode.number(),
            ..Reference::default()
        };
        for (joint, measured) in raw.joints.iter_mut().zip(&before.cycle.measured.joints) {
            joint.q_d = measured.q + 0.1;
        }
        raw
    };
    // Of the same priority; of a higher one, but for a mode at once.
    for (priority, mode, reason) in [
        (0, Mode::Hold, lease_refusal::HELD),
        (0, Mode::InverseDynamics, lease_refusal::HELD),
        (1, Mode::InverseDynamics, lease_refusal::HOLD_FIRST),
    ] {
        let reference = |before: &SharedRecord| raw(before, priority, mode);
        let (before, record, mut commander) = send_beside_commander(&mut robot, send, reference);
        let lease = &record.cycle.commander;
        let refused = before.cycle.commander.refused;
        assert!(lease.refused >= refused + 8, "{lease:?}");
        assert_eq!(
            (lease.refused_session, lease.refused_reason),
            (4711, reason)
        );
        assert_eq!(
            (lease.pid, record.cycle.mode),
            (commander.id(), 2),
            "{lease:?}"
        );
        assert!(!commander.has_ended(), "{}", commander.output());
    }
    // Under the number of the session that commands, which did not begin at that instant.
    let copy = |before: &SharedRecord| Reference {
        session: before.cycle.commander.session,
        sequence: 0,
        ..raw(before, 1, Mode::InverseDynamics)
    };
    let (_, record, commander) = send_beside_commander(&mut robot, send, copy);
    assert_eq!(record.cycle.commander.pid, commander.id());
    // Of a higher priority, and asks for hold: it takes the command over, and the first one ends.
    let hold = |before: &SharedRecord| raw(before, 1, Mode::Hold);
    let (_, record, mut commander) = send_beside_commander(&mut robot, send, hold);
    assert_eq!(record.cycle.commander.pid, std::process::id());
    assert_eq!(
        (state(&record), record.cycle.mode),
        ("holding".to_owned(), 0)
    );
    assert!(!commander.wait().success());
    drop((port, service, node));
    robot.end();
}
