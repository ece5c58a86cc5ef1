//! Requests of clients to a daemon that runs the simulated leg, in one process: shared memory, request server,
//! loop and CAN frames are the real ones, time is as fast as it goes.

use crate::common;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use common::{RunDir, leg_with_contacts};
use cycle::ClientInput;
use plant::SimParameters;
use plant::parameters::PushParameters;
use robot_config::Robot;
use robot_state::{Answer, Description, Mode, Name, TaredSensor, Wrench};
use torqued::bus::LockStep;
use torqued::bus::in_process::{VirtualClock, VirtualDeadline};
use torqued::control_loop::ControlLoop;
use torqued::offsets::Store;
use torqued::real_time::{Pace, monotonic_ns};
use torqued::request_server::RequestServer;
use torqued::shared_memory;
use torqued_client::{Client, Commander, Error};

const PATIENCE: Duration = Duration::from_secs(10);
/// Time-out of references: simulated time differs from the clients'.
const TIMEOUT_S: f64 = 10.0;
const CONTACTS: &str = r#"
[[contacts]]
name = "standing"
touch = [{ link = "base_link", type = "full_wrench" }, { link = "ankle_ft", type = "full_wrench" }]
[[contacts]]
name = "in_the_air"
touch = [{ link = "base_link", type = "full_wrench" }, { link = "ankle_ft", type = "none" }]
[tare]
time_s = 0.5
"#;

fn leg() -> Robot {
    leg_with_contacts(CONTACTS)
}

/// A simulated robot with a bias of its F/T sensors for a tare to find.
fn biased(name: &str) -> SimParameters {
    let mut sim = common::sim(name);
    (sim.ft_sensor.bias_force, sim.ft_sensor.bias_torque) = (10.0, 1.0);
    sim
}

/// Run directory and state directory of one test.
struct Place(RunDir);

impl Place {
    fn new() -> Self {
        Self(RunDir::new())
    }

    fn store(&self) -> Store {
        Store::at(&self.0.directory.path().join("state"), "leg")
    }

    fn client(&self) -> Client {
        Client::connect_at(&self.0.location, "leg", PATIENCE).expect("a daemon runs")
    }
}

/// A daemon that runs until it is stopped.
struct Daemon {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Vec<[f64; 6]>>>,
}

impl Daemon {
    fn start(place: &Place, sim: &SimParameters) -> Self {
        Self::start_robot(place, leg(), sim)
    }

    fn start_robot(place: &Place, robot: Robot, sim: &SimParameters) -> Self {
        let plant = common::plant(&robot, sim);
        let server = RequestServer::new(&robot, Ok(place.store())).expect("a request server");
        let mut description = Description {
            // The only robot.
            robot: Name::new("leg"),
            joint_count: robot.parameters.joints.len() as u32,
            ft_count: robot.parameters.ft_sensors.len() as u32,
            ..Description::default()
        };
        for (i, name) in robot_config::contact_names(&robot.parameters)
            .iter()
            .enumerate()
        {
            description.contact_set_names[i] = Name::new(name);
            description.contact_set_count += 1;
        }
        let mut ends = shared_memory::start_at(
            &place.0.location,
            &description,
            server,
            supervisor::Commanders::new(TIMEOUT_S),
        )
        .expect("ends");
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            let clock = VirtualClock::new();
            let bus = LockStep::new(plant, &clock);
            let mut control_loop = ControlLoop::new(&robot, bus).expect("a loop");
            let mut deadline = VirtualDeadline::new(&clock, 1_000_000);
            let mut errors = vec![[0.0; 6]; robot.parameters.ft_sensors.len()];
            let mut cycles = 0.0;
            while !stopped.load(Ordering::Relaxed) {
                let commanders = ends.references.next_command(monotonic_ns());
                let wanted = ClientInput {
                    // Simulated time differs from the clients': their leases do not end.
                    reference: commanders.reference(),
                    age_s: 0.0,
                    commander: commanders.record(),
                    settings: Some(ends.settings.latest()),
                    request: None,
                };
                let record = control_loop.run_cycle(&deadline.wait(), &wanted);
                while !ends.records.send(record) && !stopped.load(Ordering::Relaxed) {
                    thread::sleep(Duration::from_micros(100));
                }
                let plant = &control_loop.bus().peer();
                let sensors = plant.robot().readings().ft.iter().zip(&plant.truth().ft);
                for (error, (shown, truth)) in errors.iter_mut().zip(sensors) {
                    let pairs = shown.to_array().into_iter().zip(truth.to_array());
                    error
                        .iter_mut()
                        .zip(pairs)
                        .for_each(|(e, (s, t))| *e += s - t);
                }
                cycles += 1.0;
            }
            let mean = |error: [f64; 6]| error.map(|e| e / cycles);
            errors.into_iter().map(mean).collect()
        });
        Self {
            stop,
            thread: Some(thread),
        }
    }

    /// Ends it; returns the mean errors of its sensors, which a tare should find.
    fn stop(mut self) -> Vec<[f64; 6]> {
        self.stop.store(true, Ordering::Relaxed);
        let thread = self.thread.take().expect("it runs");
        thread.join().expect("it ran well")
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Waits until the filters are full.
fn settled(client: &mut Client) {
    for record in client.records(PATIENCE) {
        if record.expect("a record").cycle.sequence > 200 {
            return;
        }
    }
}

fn reason(result: Result<Answer, Error>) -> String {
    match result {
        Err(Error::Refused { reason }) => reason,
        other => panic!("not refused: {other:?}"),
    }
}

#[test]
fn a_tare_in_the_air_finds_the_offset_and_keeps_it() {
    let place = Place::new();
    let daemon = Daemon::start(&place, &biased("leg"));
    let mut client = place.client();
    settled(&mut client);
    let untared = client.last_tare().expect("answered");
    assert_eq!(untared.date_unix_s, 0.0);
    assert!(
        untared.text.as_str().contains("no tare"),
        "{}",
        untared.text
    );

    let mut progress = Vec::new();
    let kind = robot_state::request::TARE;
    let answer = client.request(kind, "in_the_air", |a| progress.push(a.progress));
    let answer = answer.expect("tared");
    assert!(progress.is_sorted(), "{progress:?}");
    let sensor = answer.ft[0];
    assert_eq!((answer.ft_count, sensor.known), (1, 0b11_1111));
    assert_eq!(sensor.before, Wrench::default());
    assert!((answer.date_unix_s - unix_now()).abs() < 60.0);
    assert_eq!(answer.contact_set.as_str(), "in_the_air");

    // The loop adopts it within a blending time, and a second tare has little to add.
    let taken = |r: &torqued_client::Record| r.cycle.measured.ft[0].offset == sensor.offset;
    let found = (client.records(PATIENCE).take(2000)).any(|r| taken(&r.expect("a record")));
    assert!(found, "the loop does not go by it");
    let again = client.tare("in_the_air").expect("tared again");
    assert_eq!(again.ft[0].before, sensor.offset);

    let bias = daemon.stop()[0];
    assert_found(&sensor, &bias);
    assert_found(&again.ft[0], &bias);
    assert!(bias[..3].iter().any(|f| f.abs() > 1.0), "{bias:?}");

    // Another daemon starts with it.
    let daemon = Daemon::start(&place, &biased("leg"));
    let mut client = place.client();
    let first = client.next_record(PATIENCE).expect("a record");
    assert_eq!(first.cycle.measured.ft[0].offset, again.ft[0].offset);
    drop(first);
    let kept = client.last_tare().expect("answered");
    assert_eq!(kept.ft[0].offset, again.ft[0].offset);
    assert_eq!(kept.ft[0].sigma, again.ft[0].sigma);
    assert_eq!(kept.date_unix_s, again.date_unix_s);
    client.forget_tare().expect("forgotten");
    assert!(!place.store().file().exists());
    assert_eq!(client.last_tare().expect("answered").date_unix_s, 0.0);
    drop(daemon);
}

/// Asserts that the tare has found the sensor's error.
fn assert_found(tare: &TaredSensor, bias: &[f64; 6]) {
    let parts = tare
        .offset
        .to_array()
        .into_iter()
        .zip(tare.sigma.to_array());
    for ((offset, sigma), bias) in parts.zip(bias) {
        let (error, limit) = ((offset - bias).abs(), 3.0 * sigma + 1e-3);
        assert!(sigma > 0.0 && error < limit, "{error}, at most {limit}");
    }
}

fn unix_now() -> f64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    since.expect("after 1970").as_secs_f64()
}

/// The humanoid on both feet: the offsets of its hands become known, and the sum of its feet's.
#[test]
fn a_humanoid_that_stands_is_tared() {
    let place = Place::new();
    let daemon = Daemon::start_robot(&place, common::robot("humanoid"), &biased("humanoid"));
    let mut client = place.client();
    settled(&mut client);
    let answer = client.tare("unheld").expect("tared");
    let known: Vec<u32> = answer.ft[..4].iter().map(|s| s.known).collect();
    assert_eq!(known[2..], [0b11_1111; 2]);
    assert_eq!(
        known[0] & 0b100,
        0,
        "the share of each foot in the weight is unknown"
    );
    // Feet are parallel: their vertical axes too.
    let sum = answer.ft[0].offset.force[2] + answer.ft[1].offset.force[2];
    let bias = daemon.stop();
    let error = sum - bias[0][2] - bias[1][2];
    assert!(error.abs() < 6.0, "{error} N: 1 % of the weight");
    assert!((bias[0][2] + bias[1][2]).abs() > 1.0, "nothing to find");
    for hand in [2, 3] {
        assert_found(&answer.ft[hand], &bias[hand]);
    }
}

#[test]
fn a_robot_that_is_pushed_is_not_tared() {
    let place = Place::new();
    let mut sim = biased("leg");
    sim.pushes.push(PushParameters {
        link: "ankle_ft".to_owned(),
        start: 0.0,
        duration: 100.0,
        // Rises by 60 N a second.
        force: [2e3, 0.0, 0.0],
        torque: [0.0; 3],
    });
    let _daemon = Daemon::start(&place, &sim);
    let mut client = place.client();
    settled(&mut client);
    let why = reason(client.tare("in_the_air"));
    assert!(why.contains("the robot moves"), "{why}");
    assert!(!place.store().file().exists(), "nothing is kept");
}

#[test]
fn only_a_robot_that_holds_its_position_is_tared() {
    let place = Place::new();
    let _daemon = Daemon::start(&place, &biased("leg"));
    let mut client = place.client();
    settled(&mut client);
    let other = place.client();
    let mut commander = Commander::connect(&mut client).expect("commander");
    let pose = client
        .next_record(PATIENCE)
        .expect("a record")
        .cycle
        .measured
        .joints;
    let mut seen = 0;
    // Sends references as a client does, and requests in between.
    for record in client.records(PATIENCE) {
        seen = record.expect("a record").cycle.mode;
        let sent = commander.send(|r| {
            r.mode = Mode::InverseDynamics.number();
            for (joint, now) in r.joints.iter_mut().zip(&pose) {
                joint.q_d = now.q;
            }
        });
        assert!(
            matches!(sent, Ok(()) | Err(Error::NotFollowed { .. })),
            "{sent:?}"
        );
        if seen == Mode::InverseDynamics.number() {
            break;
        }
    }
    assert_eq!(seen, Mode::InverseDynamics.number());
    let asking = thread::spawn(move || {
        let tare = reason(other.tare("in_the_air"));
        (tare, reason(other.forget_tare()))
    });
    while !asking.is_finished() {
        commander.send(|_| ()).expect("sent");
        thread::sleep(Duration::from_millis(2));
    }
    let (tare, forget) = asking.join().expect("answered");
    assert!(
        tare.contains("mode inverse_dynamics; allowed: mode hold"),
        "{tare}"
    );
    assert!(forget.contains("mode inverse_dynamics"), "{forget}");
}

#[test]
fn impossible_requests_are_refused_with_the_allowed() {
    let place = Place::new();
    let _daemon = Daemon::start(&place, &biased("leg"));
    let mut client = place.client();
    settled(&mut client);
    for strange in ["", "on_the_moon", &"é".repeat(60)] {
        let why = reason(client.tare(strange));
        assert!(why.contains("allowed: standing, in_the_air"), "{why}");
        assert_eq!(why, reason(client.choose_contact_set(strange)));
    }
    let why = reason(client.tare("standing"));
    assert!(
        why.contains("every part of the robot has a contact"),
        "{why}"
    );
    let why = reason(client.automatic_contact_set());
    assert!(why.contains("no automatic rule"), "{why}");
    let why = reason(client.request(99, "standing", |_| ()));
    assert!(why.contains("kind 99"), "{why}");
}

#[test]
fn one_of_two_concurrent_tares_is_served() {
    let place = Place::new();
    let _daemon = Daemon::start(&place, &biased("leg"));
    let mut clients: Vec<Client> = (0..3).map(|_| place.client()).collect();
    settled(&mut clients[0]);
    let asking: Vec<_> = (clients.into_iter())
        .map(|client| thread::spawn(move || client.tare("in_the_air")))
        .collect();
    let answers: Vec<_> = asking
        .into_iter()
        .map(|t| t.join().expect("answered"))
        .collect();
    let served: Vec<_> = answers.iter().flatten().collect();
    assert!(!served.is_empty());
    for refused in answers.iter().filter(|a| a.is_err()) {
        let why = refused.as_ref().expect_err("refused").to_string();
        assert!(why.contains("try again"), "{why}");
    }
}

#[test]
fn chosen_contact_sets_hold_and_are_published() {
    let place = Place::new();
    let _daemon = Daemon::start(&place, &biased("leg"));
    let mut client = place.client();
    assert_eq!(client.description().contact_set_count, 2);
    for (index, name) in [(1, "in_the_air"), (0, "standing"), (1, "in_the_air")] {
        client.choose_contact_set(name).expect("chosen");
        let holds = |r: &torqued_client::Record| r.cycle.estimated.contact_set == index;
        let found =
            (client.records(PATIENCE).take(2000)).any(|record| holds(&record.expect("a record")));
        assert!(found, "{name} does not hold");
    }
}
