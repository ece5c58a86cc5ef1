//! Both ends in one process.

use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::{scope, sleep};
use std::time::Duration;

use crate::common::{RunDir, connect, description, record, while_led};
use torqued_client::robot_state::{Event, Mode, Reference, SharedRecord, not_followed};
use torqued_client::{Client, Commander, DaemonPorts, Error, Location};

const SECOND: Duration = Duration::from_secs(1);
const PATIENCE: Duration = Duration::from_secs(10);
/// Time-out of references in the tests of no time-out, s.
const LONG_S: f64 = 10.0;

#[test]
fn every_record_arrives_in_order_and_unchanged() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    assert_eq!(*client.description(), description("leg", 6));
    for sequence in 1..=100 {
        ports.publish(&record(sequence)).expect("published");
    }
    for sequence in 1..=100 {
        let received = client.next_record(SECOND).expect("record");
        assert_eq!(*received, record(sequence));
        assert_eq!(received.lost, 0);
    }
    assert!(client.latest().expect("nothing").is_none());
}

#[test]
fn a_slow_client_loses_the_oldest_and_is_told_how_many() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    ports.publish(&record(1)).expect("published");
    assert_eq!(client.next_record(SECOND).expect("first").cycle.sequence, 1);
    for sequence in 2..=1001 {
        ports.publish(&record(sequence)).expect("published");
    }
    let mut lost = 0;
    let mut received = 0;
    while received + lost < 1000 {
        let record = client.next_record(SECOND).expect("record");
        lost += record.lost;
        received += 1;
    }
    assert_eq!(received, 128, "the newest 128 are kept");
    assert_eq!(lost, 1000 - 128);
}

#[test]
fn latest_skips_to_the_newest() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    for sequence in 1..=50 {
        ports.publish(&record(sequence)).expect("published");
    }
    let newest = client.latest().expect("received").expect("some");
    assert_eq!((newest.cycle.sequence, newest.lost), (50, 0));
}

#[test]
fn records_can_be_held_but_not_without_end() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    for sequence in 1..=10 {
        ports.publish(&record(sequence)).expect("published");
    }
    let held: Vec<_> = (0..4)
        .map(|_| client.next_record(SECOND).expect("record"))
        .collect();
    assert_eq!(
        client.next_record(SECOND).err(),
        Some(Error::TooManyRecordsHeld { allowed: 4 })
    );
    for sequence in 11..=1000 {
        ports
            .publish(&record(sequence))
            .expect("the publisher does not care");
    }
    for (held, sequence) in held.iter().zip(1..) {
        assert_eq!(**held, record(sequence), "a held record is not overwritten");
    }
    drop(held);
    assert!(client.next_record(SECOND).expect("record").lost > 0);
}

#[test]
fn references_arrive_in_order_and_bit_for_bit() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    // A NaN passes: judging it is the cycle's business, and it counts it.
    let odd = f64::from_bits(0x7ff8_dead_beef_0001);
    let pose = |record: &mut SharedRecord| {
        let joints = &mut record.cycle.measured.joints;
        (joints[0].q, joints[3].q) = (0.25, -0.5);
    };
    let ((), followed) = while_led(&ports, LONG_S, pose, || {
        let mut commander = Commander::connect(&mut client).expect("commander");
        for q_d in [1.0, 2.0, odd] {
            let change = |r: &mut Reference| {
                r.mode = Mode::InverseDynamics.number();
                r.joints[3].q_d = q_d;
            };
            commander.send(change).expect("sent");
            sleep(Duration::from_millis(10));
        }
        commander.close().expect("given back");
    });
    let first = &followed[0];
    let own = (first.mode, first.pid, first.priority);
    assert_eq!(own, (Mode::Hold.number(), std::process::id(), 0));
    let begins = [0, 1, 3].map(|j| first.joints[j].q_d);
    assert_eq!(begins, [0.25, 0.0, -0.5], "it begins at the measured pose");
    for pair in followed.windows(2) {
        assert_eq!(pair[0].session, pair[1].session);
        assert!(pair[0].sequence < pair[1].sequence);
        assert!(pair[0].sent_ns < pair[1].sent_ns);
    }
    let [.., given, last] = &followed[..] else {
        panic!("followed {}", followed.len());
    };
    assert_eq!(
        (given.joint_count, given.mode),
        (6, Mode::InverseDynamics.number())
    );
    assert_eq!(given.joints[3].q_d.to_bits(), odd.to_bits());
    assert_eq!((last.mode, last.gives_back), (Mode::Hold.number(), 1));
}

#[test]
fn a_second_commander_is_refused_until_the_first_has_gone() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    let mut other = connect(&dir, &ports, "leg");
    let error = Commander::connect(&mut client).expect_err("no pose to begin at");
    assert!(matches!(error, Error::NoRecord { .. }), "{error}");
    while_led(
        &ports,
        LONG_S,
        |_| (),
        || {
            let mut first = Commander::connect(&mut client).expect("first");
            // It goes on while the other asks.
            scope(|threads| {
                let asking = threads.spawn(|| Commander::connect(&mut other).expect_err("second"));
                while !asking.is_finished() {
                    first.send(|_| ()).expect("sent");
                    sleep(Duration::from_millis(1));
                }
                let error = asking.join().expect("asked");
                let Error::AlreadyCommanded {
                    pid, session, held, ..
                } = error
                else {
                    panic!("{error}");
                };
                assert_eq!(
                    (pid, session),
                    (std::process::id(), first.reference().session)
                );
                assert!(
                    held > Duration::from_millis(1) && held < PATIENCE,
                    "{held:?}"
                );
                let pid = format!("process {pid} ");
                assert!(error.to_string().contains(&pid), "{error}");
            });
            first.close().expect("given back");
            Commander::connect(&mut other).expect("second, later, at once");
        },
    );
}

#[test]
fn a_commander_of_higher_priority_takes_over_and_the_first_one_notices() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    let mut other = connect(&dir, &ports, "leg");
    let torque = |r: &mut Reference| r.mode = Mode::Torque.number();
    let ((), followed) = while_led(
        &ports,
        LONG_S,
        |_| (),
        || {
            let mut first = Commander::connect_with(&mut client, 1).expect("first");
            first.send(torque).expect("sent");
            let second = Commander::connect_with(&mut other, 2).expect("second");
            let lost = |error: &Error| matches!(error, Error::AlreadyCommanded { priority: 2, .. });
            for mode in [Mode::Torque, Mode::Hold, Mode::Torque] {
                let error = first.send(|r| r.mode = mode.number()).expect_err("lost");
                assert!(lost(&error), "{error}");
            }
            let error = first
                .hold_until_ready(PATIENCE)
                .expect_err("held by another");
            assert!(lost(&error), "{error}");
            second.close().expect("given back");
            first.hold_until_ready(PATIENCE).expect("free again");
            first.send(torque).expect("sent");
        },
    );
    let modes: Vec<_> = followed.iter().map(|r| (r.priority, r.mode)).collect();
    let position = |wanted| modes.iter().position(|seen| *seen == wanted);
    let taken_over = position((2, 0)).expect("followed");
    assert!(position((1, 1)).expect("followed") < taken_over);
    assert!(!modes[taken_over..].contains(&(2, 1)));
    assert_eq!(modes.last(), Some(&(1, 0)), "given back: {modes:?}");
}

#[test]
fn references_that_are_not_followed_are_an_error_until_hold_is_asked_for() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    let torque = |r: &mut Reference| r.mode = Mode::Torque.number();
    let stale = Event::JointStale.number();
    let fault = AtomicU32::new(0);
    let latch = |record: &mut SharedRecord| {
        let number = fault.load(Ordering::Relaxed);
        if number != 0 {
            let lease = &mut record.cycle.commander;
            (lease.not_followed, lease.cause) = (not_followed::FAULT, number);
        }
    };
    // Longer than a busy machine lets this thread wait.
    let timeout_s = 1.5;
    while_led(&ports, timeout_s, latch, || {
        let mut commander = Commander::connect(&mut client).expect("commander");
        let send = |commander: &mut Commander| {
            (0..50).find_map(|_| {
                sleep(Duration::from_millis(1));
                commander.send(torque).err()
            })
        };
        assert_eq!(send(&mut commander), None);
        fault.store(stale, Ordering::Relaxed);
        let error = send(&mut commander).expect("a fault").to_string();
        for part in ["not followed", "104 joint_stale", "torquectl acknowledge"] {
            assert!(error.contains(part), "{part} is missing in: {error}");
        }
        let waited = commander.hold_until_ready(Duration::from_millis(50));
        assert!(
            matches!(waited, Err(Error::NotFollowed { .. })),
            "{waited:?}"
        );
        fault.store(0, Ordering::Relaxed);
        commander
            .hold_until_ready(PATIENCE)
            .expect("followed again");
        assert_eq!(send(&mut commander), None);
        sleep(Duration::from_secs_f64(1.2 * timeout_s));
        let error = commander.send(torque).expect_err("too late");
        assert!(
            error.to_string().contains("the command was lost"),
            "{error}"
        );
        commander
            .send(|r| r.mode = Mode::Hold.number())
            .expect("anew");
        // At once, within the daemon's cycle.
        commander.send(torque).expect("sent");
        assert_eq!(send(&mut commander), None);
    });
}

#[test]
fn a_second_daemon_is_refused() {
    let dir = RunDir::new();
    let _ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let error = DaemonPorts::create(&dir.location, &description("leg", 6)).expect_err("second");
    assert_eq!(
        error,
        Error::AlreadyRunning {
            robot: "leg".into()
        }
    );
    DaemonPorts::create(&dir.location, &description("arm", 7)).expect("another robot is fine");
}

#[test]
fn a_client_goes_on_with_the_next_daemon() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    let (mut commander, _) = while_led(
        &ports,
        LONG_S,
        |_| (),
        || Commander::connect(&mut client).expect("commander"),
    );
    client.latest().expect("records");
    ports.publish(&record(900)).expect("published");
    assert_eq!(
        client.next_record(SECOND).expect("record").cycle.sequence,
        900
    );
    drop(ports);
    let gone = (0..2).find_map(|_| commander.send(|_| ()).err());
    assert_eq!(
        gone,
        Some(Error::Gone {
            robot: "leg".into()
        })
    );

    let ports = DaemonPorts::create(&dir.location, &description("leg", 5)).expect("ports again");
    assert!(ports.next_reference().expect("no old reference").is_none());
    ports.publish(&record(1)).expect("published");
    let next = client.next_record(SECOND).expect("record");
    assert_eq!((next.cycle.sequence, next.lost), (1, 0));
    drop(next);
    assert_eq!(
        client.description().joint_count,
        5,
        "the description is the new daemon's"
    );
    // It commanded the daemon before: this one does not follow it before it has asked for hold.
    let torque = |r: &mut Reference| r.mode = Mode::Torque.number();
    let ((), followed) = while_led(
        &ports,
        LONG_S,
        |_| (),
        || {
            // Until the new daemon's first status arrives.
            let noticed = (0..5000).any(|_| {
                sleep(Duration::from_millis(1));
                commander.send(torque).is_err()
            });
            assert!(noticed);
            for _ in 0..20 {
                let error = commander.send(torque).expect_err("lost");
                assert!(matches!(error, Error::CommandLost { .. }), "{error}");
            }
            commander
                .hold_until_ready(PATIENCE)
                .expect("commands again");
            commander.send(torque).expect("sent");
            sleep(Duration::from_millis(20));
            commander.close().expect("given back");
            let mut newcomer = Commander::connect(&mut client).expect("another commander");
            newcomer.send(torque).expect("sent");
            sleep(Duration::from_millis(20));
        },
    );
    let mut modes: Vec<_> = followed.iter().map(|r| r.mode).collect();
    modes.dedup();
    assert_eq!(modes, [0, 1, 0, 1, 0]);
}

#[test]
fn without_a_daemon_the_error_says_what_and_where() {
    let dir = RunDir::new();
    let error =
        Client::connect_at(&dir.location, "leg", Duration::from_millis(10)).expect_err("no daemon");
    let text = error.to_string();
    for part in [
        "torqued/leg/",
        "start `torqued run",
        dir.location.path().to_str().expect("text"),
    ] {
        assert!(text.contains(part), "{part} is missing in: {text}");
    }
}

#[test]
fn a_daemon_that_falls_silent_is_noticed() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    let waited = Duration::from_millis(20);
    let error = client.next_record(waited).expect_err("nothing comes");
    assert_eq!(
        error,
        Error::NoRecord {
            robot: "leg".into(),
            waited
        }
    );
}

#[test]
fn the_only_robot_is_found() {
    let dir = RunDir::new();
    let none = dir.location.only_robot().expect_err("none runs");
    assert!(none.to_string().contains("no torqued runs"), "{none}");
    let _leg = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    assert_eq!(dir.location.only_robot().as_deref(), Ok("leg"));
    let _arm = DaemonPorts::create(&dir.location, &description("arm", 7)).expect("ports");
    let two = dir.location.only_robot().expect_err("two run");
    assert!(two.to_string().ends_with("arm, leg"), "{two}");
}

#[test]
fn run_directories_keep_robots_of_one_name_apart() {
    let (here, there) = (RunDir::new(), RunDir::new());
    let ports = DaemonPorts::create(&here.location, &description("leg", 6)).expect("ports");
    let other = DaemonPorts::create(&there.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&there, &other, "leg");
    ports.publish(&record(1)).expect("published");
    assert!(client.latest().expect("connected").is_none());
}

#[test]
fn a_run_directory_must_be_usable() {
    let error = Location::at("/proc/torqued").expect_err("nothing can be made in /proc");
    assert!(error.to_string().contains("TORQUED_RUN_DIR"), "{error}");
}
