//! The daemon's hand-over to clients, seen from both sides.

use crate::common;

use std::thread;
use std::time::{Duration, Instant};

use common::{RunDir, robot};
use problem::Problem;
use robot_state::{Description, Mode, Name, Reference, SharedRecord};
use test_support::allocations;
use torqued::real_time::monotonic_ns;
use torqued::request_server::RequestServer;
use torqued::shared_memory::{self, LoopEnds};
use torqued_client::{Client, Commander, Error};

const PATIENCE: Duration = Duration::from_secs(10);
/// Time-out of references in the tests that measure none.
const TIMEOUT_S: f64 = 10.0;

/// The daemon's end, in a run directory of one test.
struct Daemon(RunDir);

impl Daemon {
    fn new() -> Self {
        Self(RunDir::new())
    }

    fn start(&self) -> LoopEnds {
        shared_memory::start_at(
            &self.0.location,
            &description(),
            request_server(),
            supervisor::Commanders::new(TIMEOUT_S),
        )
        .expect("shared memory")
    }

    fn client(&self) -> Client {
        Client::connect_at(&self.0.location, "leg", PATIENCE).expect("the daemon's end is there")
    }
}

/// A request server of the leg; no test here requests a tare.
fn request_server() -> RequestServer {
    RequestServer::new(
        &robot("leg"),
        Err(Problem::new("nowhere to keep offsets", "")),
    )
    .expect("a request server")
}

fn description() -> Description {
    Description {
        robot: Name::new("leg"),
        joint_count: 6,
        ..Description::default()
    }
}

fn record(sequence: u64) -> SharedRecord {
    let mut record = SharedRecord::default();
    record.cycle.sequence = sequence;
    record.cycle.estimated.joints[5].tau_encoder.tau = sequence as f64;
    record.timing.frames_sent = !sequence;
    record
}

/// Calls `step` until it returns a value.
fn wait_for<T>(mut step: impl FnMut() -> Option<T>) -> T {
    let until = Instant::now() + PATIENCE;
    loop {
        if let Some(value) = step() {
            return value;
        }
        assert!(Instant::now() < until, "nothing came");
        thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn every_record_reaches_a_client_in_order() {
    let dir = Daemon::new();
    let mut sender = dir.start().records;
    let mut client = dir.client();
    let (arrived, arrivals) = std::sync::mpsc::channel();
    let reader = thread::spawn(move || {
        for sequence in 1..=2000 {
            let received = client.next_record(PATIENCE).expect("record");
            assert!(*received == record(sequence), "record {sequence}");
            assert_eq!(received.lost, 0);
            arrived.send(()).expect("the sender waits for it");
        }
    });
    // On a busy machine the reader may get no time for a while: the sender is never further
    // ahead of it than the buffers between them are long.
    const AHEAD: u64 = 16;
    for sequence in 1..=2000 {
        if sequence > AHEAD {
            arrivals.recv_timeout(PATIENCE).expect("the reader follows");
        }
        assert!(sender.send(&record(sequence)));
    }
    reader.join().expect("all arrived");
    assert_eq!((sender.overflow(), sender.failures()), (0, 0));
}

#[test]
fn a_full_ring_refuses_and_counts_but_does_not_wait() {
    const LAST: u64 = u64::MAX;
    let dir = Daemon::new();
    let mut sender = dir.start().records;
    let mut client = dir.client();
    // Faster than a publisher thread takes them, unless this thread gets no time meanwhile.
    let mut sent = 0;
    let mut accepted = 0;
    wait_for(|| {
        for sequence in sent + 1..=sent + 2000 {
            accepted += u64::from(sender.send(&record(sequence)));
        }
        sent += 2000;
        (sender.overflow() > 0).then_some(())
    });
    assert!(accepted >= 256, "{accepted}");
    assert_eq!(accepted + sender.overflow(), sent);
    let last = wait_for(|| sender.send(&record(LAST)).then_some(LAST));
    wait_for(|| {
        client
            .latest()
            .expect("records")
            .filter(|r| r.cycle.sequence == last)
    });
}

/// Runs a loop without a robot until `done`: each millisecond a record with the lease, and the
/// references that a cycle would follow, with their ages.
fn run_loop(ends: &mut LoopEnds, done: impl Fn() -> bool) -> Vec<(Reference, f64)> {
    let mut seen = Vec::with_capacity(10_000);
    let mut record = record(0);
    while !done() {
        let now = monotonic_ns();
        record.cycle.sequence += 1;
        let commanders = ends.references.next_command(now);
        record.cycle.commander = commanders.record();
        if let Some(reference) = commanders.reference() {
            record.cycle.commander.sequence = reference.sequence;
            seen.push((*reference, commanders.age_s(now)));
        }
        ends.records.send(&record);
        thread::sleep(Duration::from_millis(1));
    }
    seen
}

#[test]
fn references_arrive_unchanged_and_age_from_their_sending() {
    let dir = Daemon::new();
    let mut ends = dir.start();
    let mut client = dir.client();
    let odd = f64::from_bits(0x7ff8_dead_beef_0001);
    let commanding = thread::spawn(move || {
        let mut commander = Commander::connect(&mut client).expect("commander");
        commander
            .send(|r| {
                r.mode = Mode::Torque.number();
                r.joints[2].tau_d = odd;
            })
            .expect("sent");
        // Nothing more is sent while it ages.
        thread::sleep(Duration::from_millis(100));
        commander.close().expect("given back");
        // The loop is to see that.
        thread::sleep(Duration::from_millis(100));
    });
    let seen = run_loop(&mut ends, || commanding.is_finished());
    commanding.join().expect("commanded");
    assert_eq!(seen[0].0.mode, Mode::Hold.number());
    let torque: Vec<_> = (seen.iter())
        .filter(|(r, _)| r.mode == Mode::Torque.number())
        .collect();
    let first = torque.first().expect("followed");
    assert_eq!(
        first.0.joints[2].tau_d.to_bits(),
        odd.to_bits(),
        "unchecked, untouched"
    );
    for pair in torque.windows(2) {
        assert_eq!(pair[0].0.sent_ns, pair[1].0.sent_ns);
        assert!(pair[1].1 > pair[0].1, "it only grows older");
    }
    assert!(torque.last().expect("followed").1 > 0.05, "age counts");
    let last = seen.last().expect("followed");
    assert_eq!((last.0.mode, last.0.gives_back), (Mode::Hold.number(), 1));
    assert!(
        ends.references
            .next_command(monotonic_ns())
            .reference()
            .is_none()
    );
}

#[test]
fn the_loops_thread_does_not_allocate() {
    let dir = Daemon::new();
    let mut ends = dir.start();
    let mut client = dir.client();
    let mut record = Box::new(record(0));
    // Clients come and go meanwhile, which makes the publisher thread map and unmap files.
    let location = dir.0.location.clone();
    let others = thread::spawn(move || {
        let mut commander = Commander::connect(&mut client).expect("commander");
        for _ in 0..5 {
            let mut guest = Client::connect_at(&location, "leg", PATIENCE).expect("guest");
            guest.next_record(PATIENCE).expect("record");
            let refused = Commander::connect(&mut guest).expect_err("refused");
            assert!(
                matches!(refused, Error::AlreadyCommanded { .. }),
                "{refused}"
            );
            commander
                .send(|r| r.mode = Mode::Torque.number())
                .expect("sent");
            guest.choose_contact_set("default").expect("chosen");
        }
    });
    let (mut arrivals, mut changes) = (0, 0);
    let first_sequence = ends.settings.latest().sequence;
    let (mut last_seen, mut last_sequence) = (0, first_sequence);
    // The newest of them may still be under way.
    while !others.is_finished() || arrivals == 0 {
        let before = allocations();
        record.cycle.sequence += 1;
        ends.records.send(&record);
        let sequence = ends.settings.latest().sequence;
        changes += u32::from(sequence > last_sequence);
        last_sequence = sequence;
        let commanders = ends.references.next_command(monotonic_ns());
        record.cycle.commander = commanders.record();
        if let Some(reference) = commanders.reference() {
            arrivals += u32::from(reference.sequence > last_seen);
            last_seen = reference.sequence;
        }
        assert_eq!(allocations(), before);
        thread::sleep(Duration::from_micros(200));
    }
    others.join().expect("served");
    assert!(record.cycle.commander.refused >= 5);
    assert!(arrivals >= 5);
    assert!(changes > 0);
    let choices = last_sequence - first_sequence;
    assert_eq!(choices, 5, "each is with the loop before it is answered");
}

#[test]
fn records_left_in_the_ring_are_published_before_the_end() {
    let dir = Daemon::new();
    let mut sender = dir.start().records;
    let mut client = dir.client();
    for sequence in 1..=100 {
        assert!(sender.send(&record(sequence)));
    }
    drop(sender);
    for sequence in 1..=100 {
        assert_eq!(
            client.next_record(PATIENCE).expect("record").cycle.sequence,
            sequence
        );
    }
}

#[test]
fn one_daemon_at_a_time_and_the_next_may_start() {
    let dir = Daemon::new();
    let sender = dir.start().records;
    let mut client = dir.client();
    let refused = shared_memory::start_at(
        &dir.0.location,
        &description(),
        request_server(),
        supervisor::Commanders::new(TIMEOUT_S),
    )
    .err();
    assert_eq!(
        refused,
        Some(Error::AlreadyRunning {
            robot: "leg".into()
        })
    );
    drop(sender);
    let mut sender = dir.start().records;
    assert!(sender.send(&record(7)));
    assert_eq!(
        client.next_record(PATIENCE).expect("record").cycle.sequence,
        7
    );
}
