//! Both ends in one process.

use std::time::Duration;

use crate::common::{RunDir, connect, description, record};
use torqued_client::robot_state::{Mode, Reference};
use torqued_client::{Client, Commander, DaemonPorts, Error, Location};

const SECOND: Duration = Duration::from_secs(1);

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
fn references_arrive_newest_first_and_bit_for_bit() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    assert!(ports.newest_reference().expect("none yet").is_none());
    let mut pose = record(1);
    (
        pose.cycle.measured.joints[0].q,
        pose.cycle.measured.joints[3].q,
    ) = (0.25, -0.5);
    ports.publish(&pose).expect("published");
    let mut commander = Commander::connect(&mut client).expect("commander");
    let first = ports.newest_reference().expect("received").expect("some");
    assert_eq!((first.sequence, first.mode), (1, Mode::Hold.number()));
    let begins = [0, 1, 3].map(|j| first.joints[j].q_d);
    assert_eq!(begins, [0.25, 0.0, -0.5], "it begins at the measured pose");
    // A NaN passes: judging it is the cycle's business, and it counts it.
    let odd = f64::from_bits(0x7ff8_dead_beef_0001);
    for q_d in [1.0, 2.0, odd] {
        let change = |r: &mut Reference| {
            r.mode = Mode::InverseDynamics.number();
            r.joints[3].q_d = q_d;
        };
        commander.send(change).expect("sent");
    }
    let reference = ports.newest_reference().expect("received").expect("some");
    assert_eq!((reference.sequence, reference.joint_count), (4, 6));
    assert_eq!(reference.joints[3].q_d.to_bits(), odd.to_bits());
    assert!(ports.newest_reference().expect("no newer").is_none());

    drop(commander);
    let last = ports.newest_reference().expect("received").expect("some");
    assert_eq!(
        last.mode,
        Mode::Hold.number(),
        "a commander that goes leaves the robot holding"
    );
}

#[test]
fn a_second_commander_is_refused_until_the_first_has_gone() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description("leg", 6)).expect("ports");
    let mut client = connect(&dir, &ports, "leg");
    let mut other = connect(&dir, &ports, "leg");
    let error = Commander::connect(&mut client).expect_err("no pose to begin at");
    assert!(matches!(error, Error::NoRecord { .. }), "{error}");
    ports.publish(&record(1)).expect("published");
    let first = Commander::connect(&mut client).expect("first");
    let error = Commander::connect(&mut other).expect_err("second");
    assert_eq!(
        error,
        Error::AlreadyCommanded {
            robot: "leg".into()
        }
    );
    assert!(error.to_string().contains("another client"), "{error}");
    drop(first);
    ports.publish(&record(2)).expect("published");
    Commander::connect(&mut other).expect("second, later");
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
    ports.publish(&record(899)).expect("published");
    let mut commander = Commander::connect(&mut client).expect("commander");
    ports.publish(&record(900)).expect("published");
    assert_eq!(
        client.next_record(SECOND).expect("record").cycle.sequence,
        900
    );
    drop(ports);
    let error = commander.send(|_| ()).expect_err("no receiver");
    assert_eq!(
        error,
        Error::Gone {
            robot: "leg".into()
        }
    );

    let ports = DaemonPorts::create(&dir.location, &description("leg", 5)).expect("ports again");
    assert!(
        ports
            .newest_reference()
            .expect("no old reference")
            .is_none()
    );
    ports.publish(&record(1)).expect("published");
    let next = client.next_record(SECOND).expect("record");
    assert_eq!((next.cycle.sequence, next.lost), (1, 0));
    drop(next);
    assert_eq!(
        client.description().joint_count,
        5,
        "the description is the new daemon's"
    );
    // It commanded the daemon before: this one does not obey it before it has asked for hold.
    let mut ask = |mode: u32| {
        let change = |r: &mut Reference| (r.mode, r.joints[0].q_d) = (mode, 0.5);
        commander.send(change).expect("sent");
        let newest = ports.newest_reference().expect("received");
        newest.map(|r| (r.mode, r.joints[0].q_d))
    };
    assert_eq!(ask(Mode::Torque.number()), None);
    assert_eq!(ask(99), None);
    assert_eq!(ask(Mode::Hold.number()), Some((Mode::Hold.number(), 0.5)));
    assert_eq!(
        ask(Mode::Torque.number()),
        Some((Mode::Torque.number(), 0.5))
    );
    drop(commander);
    ports.newest_reference().expect("received");
    ports.publish(&record(2)).expect("published");
    let mut newcomer = Commander::connect(&mut client).expect("another commander");
    newcomer
        .send(|r| r.mode = Mode::Torque.number())
        .expect("sent");
    let reference = ports.newest_reference().expect("received").expect("some");
    assert_eq!(
        reference.mode,
        Mode::Torque.number(),
        "a later commander is followed at once"
    );
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
