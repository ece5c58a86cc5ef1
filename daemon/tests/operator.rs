//! Operators' requests to a daemon that runs the simulated leg, in one process: shared memory,
//! request server, loop and CAN frames are the real ones, time is as fast as it goes.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use cycle::ClientInput;
use plant::{CanRobot, SimParameters};
use problem::Problem;
use robot_config::Robot;
use robot_state::{
    Answer, CycleRecord, Description, Event, Mode, Name, RobotState, command_flags, request,
};
use test_support::read_project_file;
use torqued::bus::in_process::{VirtualClock, VirtualDeadline};
use torqued::bus::{FaultInjector, Faults, LockStep};
use torqued::control_loop::ControlLoop;
use torqued::real_time::{Pace, monotonic_ns};
use torqued::request_server::RequestServer;
use torqued::shared_memory;
use torqued_client::{Client, Commander, Error, Location};

const PATIENCE: Duration = Duration::from_secs(10);
/// Time-out of references: simulated time differs from the clients'.
const TIMEOUT_S: f64 = 10.0;
const JOINTS: usize = 6;

/// The leg that an operator enables.
fn leg(change: impl Fn(String) -> String) -> Robot {
    let read = |path: &str| {
        let text = read_project_file(path)?;
        Ok(if path.ends_with("robot.toml") {
            change(text.replace("enable = \"automatic\"", "enable = \"operator\""))
        } else {
            text
        })
    };
    robot_config::load("config/leg/robot.toml", &read).expect("the leg")
}

/// A daemon in a run directory of a test's own, until it is dropped.
struct Daemon {
    run: Location,
    /// Every frame from the robot is lost.
    unplugged: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Daemon {
    fn start(test: &str, robot: Robot) -> Self {
        Self::start_unplugged(test, robot, false)
    }

    fn start_unplugged(test: &str, robot: Robot, unplugged: bool) -> Self {
        let name = format!("torqued-operator-{}-{test}", std::process::id());
        let path: PathBuf = std::env::temp_dir().join(name);
        let run = Location::at(path).expect("a run directory");
        let urdf = read_project_file(&robot.parameters.urdf_path).expect("readable");
        let sim = "config/leg/sim.toml";
        let sim = SimParameters::parse(&read_project_file(sim).expect("readable"), sim);
        let plant = CanRobot::new(&robot, &urdf, &sim.expect("parameters")).expect("a plant");
        let server = RequestServer::new(&robot, Err(Problem::new("no tares here", "")));
        let description = Description {
            robot: Name::new("leg"),
            joint_count: JOINTS as u32,
            ..Description::default()
        };
        let server = server.expect("a request server");
        let mut ends = shared_memory::start_at(
            &run,
            &description,
            server,
            supervisor::Commanders::new(TIMEOUT_S),
        )
        .expect("ends");
        let [stop, unplugged] = [false, unplugged].map(|set| Arc::new(AtomicBool::new(set)));
        let (stopped, lost) = (Arc::clone(&stop), Arc::clone(&unplugged));
        let thread = thread::spawn(move || {
            let clock = VirtualClock::new();
            let bus = LockStep::new(plant, &clock);
            let bus = FaultInjector::new(bus, &robot.receive, Faults::default(), 1);
            let mut control_loop = ControlLoop::new(&robot, bus).expect("a loop");
            let mut deadline = VirtualDeadline::new(&clock, 1_000_000);
            while !stopped.load(Ordering::Relaxed) {
                let drop = f64::from(u8::from(lost.load(Ordering::Relaxed)));
                let faults = Faults {
                    drop,
                    ..Faults::default()
                };
                control_loop.bus_mut().set_faults(faults);
                let commanders = ends.references.next_command(monotonic_ns());
                let input = ClientInput {
                    // Time here is not the clients': their leases do not end.
                    reference: commanders.reference(),
                    age_s: 0.0,
                    commander: commanders.record(),
                    settings: None,
                    request: ends.operator.next_request(),
                };
                let record = control_loop.run_cycle(&deadline.wait(), &input);
                while !ends.records.send(record) && !stopped.load(Ordering::Relaxed) {
                    thread::sleep(Duration::from_micros(100));
                }
            }
        });
        Self {
            run,
            unplugged,
            stop,
            thread: Some(thread),
        }
    }

    fn client(&self) -> Client {
        Client::connect_at(&self.run, "leg", PATIENCE).expect("a daemon runs")
    }

    fn unplug(&self, unplugged: bool) {
        self.unplugged.store(unplugged, Ordering::Relaxed);
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        let _ = std::fs::remove_dir_all(self.run.path());
        let prefix = self.run.shared_memory_prefix();
        let objects = std::fs::read_dir("/dev/shm").into_iter().flatten();
        for file in objects.flatten() {
            if file.file_name().to_string_lossy().starts_with(&prefix) {
                let _ = std::fs::remove_file(file.path());
            }
        }
    }
}

/// The first record from now on that is in that state.
fn wait_for(client: &mut Client, state: RobotState) -> CycleRecord {
    let mut seen = Vec::new();
    client.latest().expect("records");
    for record in client.records(PATIENCE).take(30_000) {
        let cycle = record.expect("a record").cycle;
        if cycle.state == state.number() {
            return cycle;
        }
        if seen.last() != Some(&cycle.state) {
            seen.push(cycle.state);
        }
    }
    panic!("never in state {}, but in {seen:?}", state.name());
}

fn engaged(record: &CycleRecord) -> usize {
    let joints = record.commanded.joints.iter();
    joints
        .filter(|joint| joint.flags & command_flags::ENGAGED != 0)
        .count()
}

fn reason(result: Result<Answer, Error>) -> String {
    match result {
        Err(Error::Refused { reason }) => reason,
        other => panic!("not refused: {other:?}"),
    }
}

fn done(result: Result<Answer, Error>) -> String {
    result.expect("done").text.to_string()
}

/// How long references are sent at least, so that the daemon sees some of them.
const SEEN: Duration = Duration::from_millis(200);

/// Asks for the mode at the pose of the record, until the robot is in `state`.
fn command(client: &mut Client, commander: &mut Commander, mode: Mode, state: RobotState) {
    let pose = client.next_record(PATIENCE).expect("a record").cycle;
    let since = Instant::now();
    while since.elapsed() < PATIENCE {
        let result = commander.send(|reference| {
            reference.mode = mode.number();
            let joints = reference.joints.iter_mut().zip(&pose.measured.joints);
            joints.for_each(|(desired, joint)| desired.q_d = joint.q);
        });
        // A mode that is not followed yet is an error.
        assert!(
            matches!(result, Ok(()) | Err(Error::NotFollowed { .. })),
            "{result:?}"
        );
        let record = client.next_record(PATIENCE).expect("a record");
        if since.elapsed() > SEEN && record.cycle.state == state.number() {
            return;
        }
    }
    panic!("never in state {}", state.name());
}

#[test]
fn an_operator_goes_the_whole_way() {
    use RobotState::{Active, Fault, Holding, Ready};
    let daemon = Daemon::start("way", leg(|text| text));
    let mut client = daemon.client();
    let ready = wait_for(&mut client, Ready);
    assert_eq!(engaged(&ready), 0, "nothing is sent unless asked");
    assert!(done(client.stop()).contains("no motion to stop"));

    assert!(done(client.enable()).contains("every joint is held"));
    assert_eq!(engaged(&wait_for(&mut client, Holding)), JOINTS);
    assert!(done(client.enable()).contains("every joint is held"));

    let mut commander = Commander::connect(&mut client).expect("commander");
    command(&mut client, &mut commander, Mode::Hold, Holding);
    command(&mut client, &mut commander, Mode::InverseDynamics, Active);
    assert!(done(client.stop()).contains("at rest"));
    // The reference still asks for motion: it is not followed before it has asked for hold.
    client.latest().expect("records");
    let mut refused = String::new();
    for record in client.records(PATIENCE).take(300) {
        assert_eq!(record.expect("a record").cycle.state, Holding.number());
        if let Err(error) = commander.send(|_| ()) {
            refused = error.to_string();
        }
    }
    for part in [
        "not followed",
        "operator's request",
        "ask for mode hold first",
    ] {
        assert!(refused.contains(part), "{part} is missing in: {refused}");
    }
    command(&mut client, &mut commander, Mode::Hold, Holding);
    command(&mut client, &mut commander, Mode::InverseDynamics, Active);
    command(&mut client, &mut commander, Mode::Hold, Holding);

    assert!(done(client.disable()).contains("no set-points are sent"));
    assert_eq!(engaged(&wait_for(&mut client, Ready)), 0);
    client.enable().expect("enabled again");
    wait_for(&mut client, Holding);

    daemon.unplug(true);
    let fault = wait_for(&mut client, Fault).fault;
    assert_eq!(fault, Event::JointStale.number());
    let why = reason(client.enable());
    assert!(why.contains("fault 104 joint_stale is latched"), "{why}");
    assert!(why.contains("torquectl acknowledge"), "{why}");
    let why = reason(client.acknowledge(403));
    assert!(
        why.contains("104 joint_stale is latched, not 403 command_not_finite"),
        "{why}"
    );
    // Its drives could not be switched off without an answer: no other fault follows once they can.
    daemon.unplug(false);
    let text = done(client.acknowledge(fault));
    assert!(
        text.contains("fault 104 joint_stale is acknowledged"),
        "{text}"
    );
    let why = reason(client.acknowledge(fault));
    assert!(why.contains("no fault is latched"), "{why}");

    assert_eq!(engaged(&wait_for(&mut client, Ready)), 0);
    client.enable().expect("enabled after the fault");
    assert_eq!(engaged(&wait_for(&mut client, Holding)), JOINTS);
}

#[test]
fn a_joint_that_has_never_answered_is_named() {
    let daemon = Daemon::start_unplugged("never", leg(|text| text), true);
    let mut client = daemon.client();
    assert_eq!(engaged(&wait_for(&mut client, RobotState::Boot)), 0);
    let why = reason(client.enable());
    assert!(why.contains("the robot is in state boot"), "{why}");
    assert!(why.contains("joint `knee` has never answered"), "{why}");
    daemon.unplug(false);
    wait_for(&mut client, RobotState::Ready);
    client.enable().expect("enabled");
}

#[test]
fn a_joint_outside_its_limits_is_named_with_them() {
    let mut robot = leg(|text| text);
    // The leg starts with its knee at 50 deg.
    let limits = &mut robot.parameters.joints[3].limits;
    (limits.position_min, limits.position_max) = ((-5_f64).to_radians(), 40.25_f64.to_radians());
    let daemon = Daemon::start("outside", robot);
    let mut client = daemon.client();
    wait_for(&mut client, RobotState::Ready);
    let why = reason(client.enable());
    assert!(
        why.contains("joint `knee` stands outside its position limits: "),
        "{why}"
    );
    assert!(why.contains(": 50.0 deg, allowed -5 to 40.3 deg"), "{why}");
    assert_eq!(engaged(&wait_for(&mut client, RobotState::Ready)), 0);
}

#[test]
fn a_robot_that_was_disabled_is_not_enabled_without_its_operator() {
    let robot = leg(|text| text.replace("enable = \"operator\"", "enable = \"automatic\""));
    let daemon = Daemon::start("automatic", robot);
    let mut client = daemon.client();
    wait_for(&mut client, RobotState::Holding);
    client.disable().expect("disabled");
    client.latest().expect("records");
    for record in client.records(PATIENCE).take(500) {
        let record = record.expect("a record");
        assert_eq!(record.cycle.state, RobotState::Ready.number());
        assert_eq!(engaged(&record.cycle), 0);
    }
    client.enable().expect("enabled");
}

#[test]
fn many_operators_at_once_are_all_answered() {
    let daemon = Daemon::start("many", leg(|text| text));
    let mut client = daemon.client();
    wait_for(&mut client, RobotState::Ready);
    let kinds = [request::ENABLE, request::STOP, request::DISABLE];
    let asking: Vec<_> = (0..6)
        .map(|i| {
            let client = daemon.client();
            thread::spawn(move || {
                for round in 0..5 {
                    match client.request(kinds[(i + round) % 3], "", |_| ()) {
                        Ok(_) | Err(Error::Refused { .. }) => {}
                        Err(e) => panic!("{e}"),
                    }
                }
            })
        })
        .collect();
    for thread in asking {
        thread.join().expect("answered");
    }
    client.enable().expect("enabled");
    wait_for(&mut client, RobotState::Holding);
}
