//! `torquectl watch` as its own process, beside a daemon's end of shared memory.

use crate::common;

use common::{RunDir, text};
use serde_json::Value;
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::Duration;
use torqued_client::DaemonPorts;
use torqued_client::robot_state::{
    Description, Event, Mode, Name, SharedRecord, command_flags, lease_refusal, measured_flags,
    not_followed, torque_flags, torque_source,
};

fn description() -> Description {
    let mut description = Description {
        robot: Name::new("leg"),
        rate_hz: 1000.0,
        joint_count: 2,
        ft_count: 1,
        ..Description::default()
    };
    description.joint_names[0] = Name::new("hip_yaw");
    description.joint_names[1] = Name::new("knee");
    description.ft_names[0] = Name::new("ankle");
    description
}

fn record() -> SharedRecord {
    let mut record = SharedRecord::default();
    let cycle = &mut record.cycle;
    (cycle.joint_count, cycle.ft_count) = (2, 1);
    cycle.mode = Mode::Torque.number();
    cycle.fault = Event::JointStale.number();
    cycle.events[Event::JointMissed.index()] = 3;
    cycle.estimated.ft[0].contact_wrench.force = [1.0, -2.0, 640.5];
    let hip = &mut cycle.estimated.joints[0];
    hip.tau_encoder.tau = 12.345;
    hip.tau_encoder.sigma = 1.5;
    hip.tau_encoder.source = torque_source::ENCODER;
    hip.tau_encoder.flags = torque_flags::VALID | torque_flags::SATURATED;
    hip.tau_whole_body.tau = f64::NAN;
    let hip = &mut cycle.commanded.joints[0];
    hip.tau_d = -7.25;
    hip.flags = command_flags::TORQUE_LIMITED | 1 << 9;
    let knee = &mut cycle.measured.joints[1];
    knee.flags = measured_flags::MISSED | measured_flags::STALE;
    knee.age_s = 0.025;
    let commander = &mut cycle.commander;
    (commander.session, commander.pid, commander.priority) = (u64::MAX, 4711, 2);
    (cycle.stamp_ns, commander.since_ns) = (5_000_000_000, 3_500_000_000);
    (commander.not_followed, commander.cause) = (not_followed::FAULT, cycle.fault);
    (commander.refused, commander.refused_reason) = (8, lease_refusal::HELD);
    record.timing.late_cycles = 4;
    record.timing.gather_ns = 310_000;
    record
}

fn beside_daemon(dir: &RunDir, command: &mut Command) -> Output {
    dir.beside_daemon(command, &description(), record(), |_, _| {})
}

#[test]
fn once_shows_torques_flags_faults_and_events_in_words() {
    let dir = RunDir::new();
    let output = beside_daemon(&dir, &mut dir.torquectl("watch --once"));
    assert!(output.status.success(), "{output:?}");
    let shown = text(&output.stdout);
    for part in [
        "mode torque",
        "FAULT 104 joint_stale: A joint has sent no sample for longer than allowed.",
        "loop.stale_after_ms",
        "commander: process 4711, priority 2, for 1.5 s; not followed: fault 104 joint_stale is latched",
        "8 references refused, the last one because another client of the same or a higher priority commands",
        "12.35 ± 1.50",
        "-7.25",
        "encoder saturated, torque_limited, bit_0x200",
        "25.0",
        "missed, stale",
        "1.0 -2.0 640.5",
        "events: joint_missed 3",
        "late 4",
        "gathered 310 us",
    ] {
        assert!(shown.contains(part), "{part} is missing in:\n{shown}");
    }
    let hip = shown
        .lines()
        .find(|line| line.contains("hip_yaw"))
        .expect("a line for hip_yaw");
    let cells: Vec<&str> = hip.split_whitespace().collect();
    assert_eq!(
        cells[5], "-",
        "an estimate that is not valid is not shown: {hip}"
    );
    assert!(
        !shown.contains('\x1b'),
        "no terminal, no control characters"
    );
}

#[test]
fn json_is_one_object_a_line() {
    let dir = RunDir::new();
    let output = beside_daemon(&dir, &mut dir.torquectl("watch --robot leg --once --json"));
    assert!(output.status.success(), "{output:?}");
    assert_eq!(text(&output.stdout).lines().count(), 1);
    let record: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(record["robot"], "leg");
    assert_eq!(record["mode"], "torque");
    assert_eq!(record["fault"]["number"], 104);
    assert_eq!(record["fault"]["config_key"], "loop.stale_after_ms");
    let commander = &record["commander"];
    assert_eq!(commander["session"], "ffffffffffffffff");
    assert_eq!(
        (&commander["pid"], &commander["priority"]),
        (&4711.into(), &2.into())
    );
    let reason = commander["not_followed"].as_str().expect("a reason");
    assert!(
        reason.starts_with("fault 104 joint_stale is latched"),
        "{reason}"
    );
    assert_eq!(record["references_refused"], 8);
    let joints = record["joints"].as_array().expect("joints");
    assert_eq!(joints.len(), 2);
    assert_eq!(joints[0]["name"], "hip_yaw");
    assert_eq!(joints[0]["tau_encoder"]["tau_Nm"], 12.345);
    assert_eq!(joints[0]["tau_encoder"]["source"], "encoder");
    assert_eq!(
        joints[0]["tau_encoder"]["flags"],
        serde_json::json!(["valid", "saturated"])
    );
    assert_eq!(joints[0]["tau_whole_body"]["tau_Nm"], Value::Null, "NaN");
    assert_eq!(joints[1]["flags"], serde_json::json!(["missed", "stale"]));
    assert_eq!(record["ft"][0]["contact_wrench"]["force_N"][2], 640.5);
    assert_eq!(record["events"], serde_json::json!({ "joint_missed": 3 }));
    assert_eq!(record["timing"]["late_cycles"], 4);
}

#[test]
fn continuous_json_ends_quietly_when_its_reader_has_enough() {
    let dir = RunDir::new();
    let watch = dir.torquectl("watch --json --rate 100");
    let mut shell = Command::new("sh");
    shell
        .args(["-c", "\"$0\" watch --json --rate 100 | head -n 3"])
        .arg(watch.get_program());
    shell.env("TORQUED_RUN_DIR", dir.location.path());
    let output = beside_daemon(&dir, &mut shell);
    assert_eq!(text(&output.stderr), "");
    let sequences: Vec<u64> = text(&output.stdout)
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).expect("JSON a line"))
        .map(|record| record["sequence"].as_u64().expect("a number"))
        .collect();
    assert_eq!(sequences.len(), 3);
    assert!(sequences.is_sorted_by(|a, b| a < b), "{sequences:?}");
}

#[test]
fn without_a_daemon_it_reports_the_remedy() {
    let dir = RunDir::new();
    for (arguments, service) in [
        ("--once", "torqued/<robot>/state"),
        ("--once --robot leg", "torqued/leg/description"),
    ] {
        let output = dir
            .torquectl(&format!("watch {arguments}"))
            .output()
            .expect("torquectl starts");
        assert_eq!(output.status.code(), Some(1));
        let message = text(&output.stderr);
        for part in [
            service,
            "torqued run",
            dir.location.path().to_str().expect("text"),
        ] {
            assert!(message.contains(part), "{part} is missing in: {message}");
        }
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn a_daemon_that_goes_away_is_noticed() {
    let dir = RunDir::new();
    let ports = DaemonPorts::create(&dir.location, &description()).expect("the daemon's end");
    let mut watch = dir
        .torquectl("watch --rate 10")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    let watch = watch.as_mut().expect("torquectl starts");
    for _ in 0..300 {
        ports.publish(&record()).expect("published");
        sleep(Duration::from_millis(1));
    }
    drop(ports);
    assert_eq!(watch.wait().expect("ends").code(), Some(1));
    let message = std::io::read_to_string(watch.stderr.take().expect("piped")).expect("text");
    assert!(message.contains("torqued has stopped"), "{message}");
}

#[test]
fn a_rate_that_cannot_be_is_refused() {
    let dir = RunDir::new();
    for rate in ["0", "NaN", "1e9", "fast"] {
        let output = dir
            .torquectl(&format!("watch --rate {rate}"))
            .output()
            .expect("torquectl starts");
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output.stderr).contains("0.1 to 1000"), "{output:?}");
    }
}
