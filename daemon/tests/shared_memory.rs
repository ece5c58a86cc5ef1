//! The daemon's hand-over to clients, seen from both sides.

mod common;

use std::thread;
use std::time::{Duration, Instant};

use common::{RunDir, robot};
use problem::Problem;
use robot_state::{Description, Mode, Name, SharedRecord};
use test_support::allocations;
use torqued::real_time::monotonic_ns;
use torqued::request_server::RequestServer;
use torqued::shared_memory::{self, LoopEnds};
use torqued_client::{Client, Commander, Error};

const PATIENCE: Duration = Duration::from_secs(10);

/// The daemon's end, in a run directory of one test.
struct Daemon(RunDir);

impl Daemon {
    fn new() -> Self {
        Self(RunDir::new())
    }

    fn start(&self) -> LoopEnds {
        shared_memory::start_at(&self.0.location, &description(), request_server())
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
    let dir = Daemon::new();
    let mut sender = dir.start().records;
    let mut client = dir.client();
    // Far faster than any publisher thread takes them.
    let accepted = (1..=20_000)
        .filter(|sequence| sender.send(&record(*sequence)))
        .count();
    assert!(accepted >= 256, "{accepted}");
    assert_eq!(accepted as u64 + sender.overflow(), 20_000);
    let last = wait_for(|| {
        assert!(sender.overflow() > 0);
        sender.send(&record(30_000)).then_some(30_000)
    });
    wait_for(|| {
        client
            .latest()
            .expect("records")
            .filter(|r| r.cycle.sequence == last)
    });
}

#[test]
fn references_come_with_their_time_of_sending() {
    let dir = Daemon::new();
    let ends = dir.start();
    let (mut sender, mut references) = (ends.records, ends.references);
    assert!(references.latest().is_none());
    let mut client = dir.client();
    sender.send(&record(1));
    let mut commander = Commander::connect(&mut client).expect("commander");
    let before = monotonic_ns();
    let odd = f64::from_bits(0x7ff8_dead_beef_0001);
    commander
        .send(|r| {
            r.mode = Mode::Torque.number();
            r.joints[2].tau_d = odd;
        })
        .expect("sent");
    let (reference, first_ns) = wait_for(|| {
        let newest = references.latest().map(|(r, at)| (*r, at));
        newest.filter(|(r, _)| r.mode == Mode::Torque.number())
    });
    assert!((before..=monotonic_ns()).contains(&first_ns));
    assert_eq!(
        first_ns, reference.sent_ns,
        "its way to the loop counts as age"
    );
    assert_eq!(reference.mode, Mode::Torque.number());
    assert_eq!(
        reference.joints[2].tau_d.to_bits(),
        odd.to_bits(),
        "unchecked, untouched"
    );
    assert_eq!(
        references.latest().map(|(_, at)| at),
        Some(first_ns),
        "it only grows older"
    );

    drop(commander);
    let last_ns = wait_for(|| {
        let (reference, at) = references.latest()?;
        (reference.mode == Mode::Hold.number()).then_some(at)
    });
    assert!(last_ns > first_ns);
}

#[test]
fn the_loops_thread_does_not_allocate() {
    let dir = Daemon::new();
    let mut ends = dir.start();
    let mut client = dir.client();
    let mut record = Box::new(record(0));
    ends.records.send(&record);
    let mut commander = Commander::connect(&mut client).expect("commander");
    // Clients come and go meanwhile, which makes the publisher thread map and unmap files.
    let location = dir.0.location.clone();
    let others = thread::spawn(move || {
        for _ in 0..5 {
            let mut guest = Client::connect_at(&location, "leg", PATIENCE).expect("guest");
            guest.next_record(PATIENCE).expect("record");
            commander
                .send(|r| r.mode = Mode::Torque.number())
                .expect("sent");
            guest.choose_contact_set("default").expect("chosen");
        }
    });
    let (mut arrivals, mut changes) = (0, 0);
    let first_sequence = ends.settings.latest().sequence;
    let (mut last_ns, mut last_sequence) = (0, first_sequence);
    // The newest of them may still be under way.
    while !others.is_finished() || arrivals == 0 {
        let before = allocations();
        record.cycle.sequence += 1;
        ends.records.send(&record);
        let sequence = ends.settings.latest().sequence;
        changes += u32::from(sequence > last_sequence);
        last_sequence = sequence;
        if let Some((_, at_ns)) = ends.references.latest() {
            arrivals += u32::from(at_ns > last_ns);
            last_ns = at_ns;
        }
        assert_eq!(allocations(), before);
        thread::sleep(Duration::from_micros(200));
    }
    others.join().expect("served");
    assert!(record.cycle.sequence >= 5);
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
    let refused = shared_memory::start_at(&dir.0.location, &description(), request_server()).err();
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
