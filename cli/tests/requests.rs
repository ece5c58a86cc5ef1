//! `torquectl tare`, `contacts` and an operator's commands as their own processes, beside a daemon's end of shared
//! memory that answers like torqued.

use crate::common;

use common::{RunDir, text};
use serde_json::Value;
use std::process::Output;
use torqued_client::robot_state::{
    Answer, Description, Event, Name, Request, RobotState, SharedRecord, Text, Wrench,
    answer_status, command_flags, measured_flags, request,
};

fn description() -> Description {
    let mut description = Description {
        robot: Name::new("leg"),
        rate_hz: 1000.0,
        joint_count: 2,
        ft_count: 2,
        contact_set_count: 2,
        ..Description::default()
    };
    for (j, name) in ["hip", "knee"].into_iter().enumerate() {
        description.joint_names[j] = Name::new(name);
        (description.position_min[j], description.position_max[j]) = (-0.5, 1.0);
    }
    description.ft_names[0] = Name::new("left");
    description.ft_names[1] = Name::new("right");
    description.contact_set_names[0] = Name::new("standing");
    description.contact_set_names[1] = Name::new("in_the_air");
    description
}

fn wrench(first: f64) -> Wrench {
    Wrench {
        force: [first, first + 1.0, first + 2.0],
        torque: [0.5 * first, 0.0, -first],
    }
}

/// The answer of torqued; the right sensor's fz cannot be determined in the pose.
fn reply(asked: &Request, record: &mut SharedRecord) -> Answer {
    let mut answer = Answer {
        status: answer_status::DONE,
        ft_count: 2,
        date_unix_s: 1_795_245_606.0,
        contact_set: Name::new("in_the_air"),
        text: Text::new("F/T offsets of then (3 days old), contacts in_the_air"),
        ..Answer::default()
    };
    for (s, sensor) in answer.ft.iter_mut().take(2).enumerate() {
        sensor.before = wrench(-1.5);
        sensor.offset = wrench(2.25 + s as f64);
        sensor.sigma = wrench(0.125);
        sensor.known = if s == 0 { 0b11_1111 } else { 0b11_1011 };
    }
    match (asked.kind, asked.contact_set.as_str()) {
        (request::TARE, "standing") => {
            answer.status = answer_status::REFUSED;
            answer.text = Text::new("the robot moves: joint `knee` turns at 0.2 rad/s");
        }
        (request::FORGET_TARE, _) => {
            answer.date_unix_s = 0.0;
            answer.text = Text::new("no tare: F/T offsets are those of the configuration");
            answer.ft = Answer::default().ft;
        }
        (request::CHOOSE_CONTACT_SET, name) => {
            record.cycle.estimated.contact_set = u32::from(name == "in_the_air");
            record.cycle.estimated.contact_set_automatic = 0;
        }
        (request::ENABLE, _) if record.cycle.fault != 0 => {
            answer.status = answer_status::REFUSED;
            answer.text = Text::new("fault 104 joint_stale is latched: acknowledge it first");
        }
        (request::ENABLE, _) => {
            record.cycle.state = RobotState::Holding.number();
            answer.text = Text::new("enabled: every joint is held; a client may command");
        }
        (request::ACKNOWLEDGE, _) if asked.fault != record.cycle.fault => {
            answer.status = answer_status::REFUSED;
            answer.text = Text::new(&format!("not {}", asked.fault));
        }
        (request::ACKNOWLEDGE, _) => {
            (record.cycle.fault, record.cycle.state) = (0, RobotState::Ready.number());
            answer.text = Text::new("fault 104 joint_stale is acknowledged");
        }
        (request::DISABLE | request::STOP, _) => answer.text = Text::new("done so"),
        (request::AUTOMATIC_CONTACT_SET, _) => record.cycle.estimated.contact_set_automatic = 1,
        _ => {}
    }
    answer
}

/// Runs torquectl beside a daemon's end.
fn beside_daemon(dir: &RunDir, arguments: &str) -> Output {
    beside_robot(dir, arguments, |_| ())
}

/// Runs torquectl beside the daemon's end of a robot whose first record has been changed.
fn beside_robot(dir: &RunDir, arguments: &str, change: impl Fn(&mut SharedRecord)) -> Output {
    let mut record = SharedRecord::default();
    change(&mut record);
    let mut command = dir.torquectl(arguments);
    dir.beside_daemon(&mut command, &description(), record, |ports, record| {
        while let Some(asked) = ports.next_request().expect("received") {
            let waiting = Answer {
                id: asked.id,
                status: answer_status::WORKING,
                text: Text::new("drives are being switched on: knee"),
                ..Answer::default()
            };
            if asked.kind == request::ENABLE {
                ports.answer(&waiting).expect("answered");
                ports.answer(&waiting).expect("answered");
            }
            let mut answer = reply(&asked, record);
            answer.id = asked.id;
            ports.answer(&answer).expect("answered");
        }
    })
}

#[test]
fn a_move_beyond_position_limits_is_refused_with_them_before_anything_is_asked_of_the_robot() {
    let dir = RunDir::new();
    let output = beside_daemon(&dir, "move hip=20 knee=90");
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert_eq!(
        error.trim(),
        "knee=90 is beyond its limits; allowed: -28.6 to 57.3 deg"
    );
}

#[test]
fn a_tare_shows_offsets_before_and_after_and_what_is_unknown() {
    let dir = RunDir::new();
    let output = beside_daemon(&dir, "tare --contacts in_the_air");
    assert!(output.status.success(), "{output:?}");
    let shown = text(&output.stdout);
    assert!(shown.contains("3 days old"), "{shown}");
    let cells = |line: &str| -> Vec<String> {
        let found = shown.lines().find(|l| l.contains(line)).expect("a line");
        found.split_whitespace().map(str::to_owned).collect()
    };
    assert_eq!(cells("left"), ["left", "fx", "N", "2.25", "-1.50", "0.12"]);
    let right: Vec<&str> = shown.lines().skip_while(|l| !l.contains("right")).collect();
    assert!(right[2].trim_start().starts_with("fz N"), "{shown}");
    assert!(
        right[2].contains("5.25") && right[2].ends_with("unknown"),
        "{shown}"
    );
    assert_eq!(shown.matches("unknown").count(), 1);
    assert!(text(&output.stderr).is_empty(), "no terminal, no bar");
}

#[test]
fn json_is_for_programs() {
    let dir = RunDir::new();
    let output = beside_daemon(&dir, "tare --show --json");
    let shown: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(shown["robot"], "leg");
    assert_eq!(shown["date"], "2026-11-21T07:20:06Z");
    assert_eq!(shown["ft"][1]["name"], "right");
    assert_eq!(shown["ft"][1]["known"][2], false);
    assert_eq!(shown["ft"][0]["offset"]["torque_Nm"][2], -2.25);
    let output = beside_daemon(&dir, "tare --forget --json");
    let shown: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(shown["date"], Value::Null);
}

#[test]
fn refusals_and_wrong_arguments_have_their_exit_codes() {
    let dir = RunDir::new();
    let output = beside_daemon(&dir, "tare --contacts standing");
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text(&output.stderr).contains("joint `knee` turns"),
        "{output:?}"
    );
    assert!(output.stdout.is_empty());
    for wrong in ["tare --contacts moon", "contacts moon"] {
        let output = beside_daemon(&dir, wrong);
        assert_eq!(output.status.code(), Some(2), "{wrong}");
        let message = text(&output.stderr);
        assert!(
            message.contains("allowed: standing, in_the_air"),
            "{message}"
        );
    }
    for wrong in ["tare", "tare --show --forget", "tare --contacts"] {
        assert_eq!(
            dir.torquectl(wrong)
                .output()
                .expect("torquectl starts")
                .status
                .code(),
            Some(2),
            "{wrong}"
        );
    }
    for command in ["tare --show --robot leg", "contacts"] {
        let output = dir.torquectl(command).output().expect("torquectl starts");
        assert_eq!(output.status.code(), Some(1), "{command}");
        assert!(text(&output.stderr).contains("torqued run"), "{output:?}");
    }
}

#[test]
fn contacts_are_listed_and_chosen() {
    let dir = RunDir::new();
    let listed = beside_daemon(&dir, "contacts");
    let shown = text(&listed.stdout);
    assert!(
        shown.contains("* standing") && shown.contains("  in_the_air"),
        "{shown}"
    );
    assert!(
        shown.contains("by a client or the configuration"),
        "{shown}"
    );
    let chosen = beside_daemon(&dir, "contacts in_the_air");
    let shown = text(&chosen.stdout);
    assert!(
        shown.contains("* in_the_air") && shown.contains("  standing"),
        "{shown}"
    );
    let automatic = beside_daemon(&dir, "contacts automatic --json");
    let shown: Value = serde_json::from_slice(&automatic.stdout).expect("JSON");
    assert_eq!(shown["automatic"], true);
    assert_eq!(shown["sets"], serde_json::json!(["standing", "in_the_air"]));
}

fn at_fault(record: &mut SharedRecord) {
    record.cycle.state = RobotState::Fault.number();
    record.cycle.fault = Event::JointStale.number();
}

#[test]
fn an_operator_sees_what_is_waited_for_and_what_was_reached() {
    let dir = RunDir::new();
    let output = beside_daemon(&dir, "enable");
    assert!(output.status.success(), "{output:?}");
    assert!(text(&output.stdout).starts_with("enabled: every joint is held"));
    let waited = text(&output.stderr);
    assert_eq!(waited, "waiting: drives are being switched on: knee\n");
    let output = beside_daemon(&dir, "enable --robot leg --json");
    let shown: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(
        (&shown["request"], &shown["state"]),
        (&"enable".into(), &"holding".into())
    );
    for command in ["stop", "disable"] {
        let output = beside_daemon(&dir, command);
        assert_eq!(text(&output.stdout), "done so\n", "{command}");
    }
    let output = beside_robot(&dir, "enable", at_fault);
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text(&output.stderr).contains("acknowledge it first"),
        "{output:?}"
    );
    assert_eq!(
        dir.torquectl("enable")
            .output()
            .expect("torquectl starts")
            .status
            .code(),
        Some(1),
        "no daemon"
    );
}

#[test]
fn the_latched_fault_is_shown_before_it_is_acknowledged() {
    let dir = RunDir::new();
    for argument in ["", " 104", " joint_stale", " --json"] {
        let output = beside_robot(&dir, &format!("acknowledge{argument}"), at_fault);
        assert!(output.status.success(), "{output:?}");
        assert!(text(&output.stdout).contains("104 joint_stale is acknowledged"));
        let shown = text(&output.stderr).contains("FAULT 104 joint_stale: A joint has sent");
        assert_eq!(shown, argument.is_empty(), "{output:?}");
    }
    let output = beside_robot(&dir, "acknowledge 403", at_fault);
    assert_eq!(output.status.code(), Some(1), "not the latched one");
    let output = dir
        .torquectl("acknowledge 7")
        .output()
        .expect("torquectl starts");
    assert_eq!(output.status.code(), Some(2));
    assert!(
        text(&output.stderr).contains("104 joint_stale"),
        "{output:?}"
    );
}

#[test]
fn the_state_names_what_keeps_the_robot_and_the_next_step() {
    let dir = RunDir::new();
    let shown = |arguments: &str, change: &(dyn Fn(&mut SharedRecord) + Sync)| {
        let output = beside_robot(&dir, arguments, |record| {
            record.cycle.joint_count = 2;
            change(record);
        });
        assert!(output.status.success(), "{output:?}");
        text(&output.stdout).to_owned()
    };
    let boot = shown("state", &|record| {
        record.cycle.measured.joints[0].flags = measured_flags::NEVER;
    });
    assert!(
        boot.starts_with("leg: boot, mode hold\nno fault\n"),
        "{boot}"
    );
    assert!(boot.contains("joint hip has never answered"), "{boot}");
    assert!(!boot.contains("knee"), "{boot}");
    let outside = shown("state", &|record| {
        record.cycle.state = RobotState::Ready.number();
        record.cycle.measured.joints[1].q = 1.5;
    });
    assert!(
        outside.contains(
            "joint knee stands outside its position limits: 85.9 deg, allowed -28.6 to 57.3 deg"
        ),
        "{outside}"
    );
    assert!(
        outside.contains("next: move the joints named above"),
        "{outside}"
    );
    let fault = shown("state", &at_fault);
    for part in [
        "FAULT 104",
        "loop.stale_after_ms",
        "next: mend the cause, then torquectl ack",
    ] {
        assert!(fault.contains(part), "{fault}");
    }
    let holding = shown("state --json", &|record| {
        record.cycle.state = RobotState::Holding.number();
        record.cycle.commanded.joints[0].flags = command_flags::ENGAGED;
    });
    let holding: Value = serde_json::from_str(&holding).expect("JSON");
    assert_eq!(
        (&holding["state"], &holding["fault"]),
        (&"holding".into(), &Value::Null)
    );
    assert_eq!(
        (&holding["joints"], &holding["joints_engaged"]),
        (&2.into(), &1.into())
    );
    let fault = shown("state --json", &at_fault);
    let fault: Value = serde_json::from_str(&fault).expect("JSON");
    assert_eq!(fault["fault"]["name"], "joint_stale");
}
