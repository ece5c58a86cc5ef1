//! What is sent is always meant.

use crate::files::{Files, LEG, refused};
use can_codec::Frame;
use robot_config::{Robot, slots};

const DBC: &str = "robot-models/leg/drives.dbc";
const CONTROL: &str = "BO_ 497 CONTROL_A: 3 TORQUED";
/// The first key that names a signal of that message.
const KEY: &str = "control = { signal = \"CONTROL_A.hip_yaw_control\"";
const BUS: &str = "name = \"a\"";

/// The leg, whose message of control words carries a torque with offset binary too.
fn with_torque(range: &str) -> Files {
    let signal = format!("\n SG_ torque : 24|8@1+ (1,-100) [{range}] \"Nm\" DRIVES");
    let message = CONTROL.replace(": 3", ": 4");
    Files::new().with(DBC, CONTROL, &format!("{message}{signal}"))
}

fn sent(robot: &Robot) -> Frame {
    let mut frame = Frame::zeroed(0, 0, 0, false);
    let values = vec![1.0; slots::send_len(&robot.parameters)];
    let index = (0..robot.send.message_count())
        .find(|&i| robot.send.message(i).is_some_and(|m| m.name == "CONTROL_A"));
    assert!(robot.send.encode(index.expect("sent"), &values, &mut frame));
    frame
}

#[test]
fn a_count_zero_that_means_torque_is_refused() {
    let parts = [
        "joint.control.signal (hip_yaw): its message has a signal CONTROL_A.torque",
        "whose count 0 means -100 Nm",
        "constants = [{ signal = \"CONTROL_A.torque\", value = .. }]",
        "GenSigStartValue",
    ];
    refused(&with_torque("-100|100"), LEG, KEY, &parts);
}

#[test]
fn a_constant_and_a_start_value_say_what_is_sent() {
    let constant = "name = \"a\"\nconstants = [{ signal = \"CONTROL_A.torque\", value = 0.0 }]";
    let by_constant = with_torque("-100|100").with(LEG, BUS, constant);
    let start = "BA_DEF_ SG_ \"GenSigStartValue\" INT 0 255;\nBA_DEF_DEF_ \"GenSigStartValue\" 0;\n\
                 BA_ \"GenSigStartValue\" SG_ 497 torque 100;\n";
    let files = with_torque("-100|100");
    let text = format!("{}\n{start}", files.text(DBC));
    let by_file = files.and(DBC, &text);
    for files in [by_constant, by_file] {
        let robot = files.load(LEG).expect("accepted");
        assert_eq!(sent(&robot).payload(), [1, 1, 1, 100]);
    }
}

#[test]
fn a_signal_that_may_not_be_zero_is_refused() {
    let signal = "\n SG_ mode : 24|8@1+ (1,0) [1|9] \"\" DRIVES";
    let message = CONTROL.replace(": 3", ": 4");
    let files = Files::new().with(DBC, CONTROL, &format!("{message}{signal}"));
    refused(&files, LEG, KEY, &["CONTROL_A.mode from 1 to 9"]);
}

#[test]
fn faulty_constants_are_refused() {
    for (constants, parts) in [
        (
            "{ signal = \"CONTROL_A.torque\", value = 300 }",
            ["cannot be 300", "-100 to 100 Nm"],
        ),
        (
            "{ signal = \"CONTROL_A.tork\", value = 0 }",
            ["has no signal tork", "torque"],
        ),
        (
            "{ signal = \"torque\", value = 0 }",
            ["\"torque\" is not allowed", "MESSAGE.signal"],
        ),
        (
            "{ signal = \"CONTROL_A.hip_roll_control\", value = 0 }, { signal = \"CONTROL_A.torque\", value = 0 }",
            [
                "is set by joint.control.signal (hip_roll)",
                "that no key of a joint names",
            ],
        ),
    ] {
        let line = format!("{BUS}\nconstants = [{constants}]");
        let text = with_torque("-100|100").with(LEG, BUS, &line).errors(LEG);
        for part in parts {
            assert!(text.contains(part), "{part:?} is not in\n{text}");
        }
    }
}
