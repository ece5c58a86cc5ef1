//! Joints on CANopen drives, without a DBC file.

use crate::files::{Files, refused};
use drives_of_makers::canopen::Object;
use drives_of_makers::canopen::bring_up::{Plan, Step};

const TEST_JOINT: &str = "config/test-joint/robot.toml";
const STATE: &str = "[drive.joint.state]\nprofile = \"cia402\"\n";
const CANOPEN: &str = "profile = \"cia402\"\n[drive.joint.canopen]\nposition = \"link\"\nother_angle = \"2240:00\"\nrated_current_A = 5.0\n";
const BUS: &str = "dbc = \"../../robot-models/test-joint/drives.dbc\"\nsync = \"SYNC\"\n";
const SIGNALS: &str = "motor_angle = { signal = \"JOINT_STATE.motor_angle\", direction = -1, offset_deg = 0.0 }\nlink_angle = { signal = \"JOINT_STATE.link_angle\", direction = 1, offset_deg = -180.0 }\ncurrent = { signal = \"JOINT_STATE.current\", direction = -1 }\nstatus = { signal = \"JOINT_STATE.status\" }\nset_point = { signal = \"COMMAND.joint_position\" }\ncontrol = { signal = \"CONTROL.joint_control\" }\n";

/// The test joint on node 3, with no word about frames.
fn node() -> Files {
    Files::new()
        .with(TEST_JOINT, BUS, "")
        .with(TEST_JOINT, STATE, CANOPEN)
        .with(TEST_JOINT, SIGNALS, "node = 3\n")
}

/// Its set-up.
fn plan(files: &Files) -> Plan {
    let robot = files.load(TEST_JOINT).unwrap_or_else(|e| panic!("{e}"));
    robot.nodes.plans[0].clone()
}

/// What a set-up writes to an object.
fn written(plan: &Plan, object: Object) -> Vec<Vec<u8>> {
    let writes = plan.steps.iter().filter_map(|step| match step {
        Step::Write(write) if write.object == object => Some(write.value.clone()),
        _ => None,
    });
    writes.collect()
}

#[test]
fn one_line_makes_a_joint_and_no_dbc_file_its_frames() {
    let robot = node().load(TEST_JOINT).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((robot.sync.len(), robot.sync[0].id), (1, 0x80));
    let ids = |table: &can_codec::Table| -> Vec<u32> {
        let messages = (0..table.message_count()).filter_map(|i| table.message(i));
        messages.map(|message| message.id).collect()
    };
    assert_eq!(ids(&robot.receive), [0x183, 0x283]);
    assert_eq!(ids(&robot.send), [0x203, 0x303]);
    let joint = &robot.parameters.joints[0];
    assert!(joint.has_link_encoder && joint.has_status && !joint.has_velocity);
    assert!(joint.drive_profile.is_some());
    let [plan] = &robot.nodes.plans[..] else {
        panic!("{:?}", robot.nodes.plans);
    };
    assert_eq!((plan.bus, plan.node, plan.name.as_str()), (0, 3, "joint"));
    assert!((robot.nodes.heartbeat - 0.1).abs() < 1e-12);
}

#[test]
fn keys_reach_the_set_up() {
    let files = node().with(
        TEST_JOINT,
        "rated_current_A = 5.0\n",
        "rated_current_A = 5.0\nheartbeat_ms = 250\nvendor = 90\nsdo = [{ object = \"6065\", bits = 32, value = 4000000000 }, { object = \"60C5:00\", bits = 8, value = -1 }]\n",
    );
    let plan = plan(&files);
    let consumer = 127u32 << 16 | 250;
    assert_eq!(
        written(&plan, Object::new(0x1016, 1)),
        [consumer.to_le_bytes().to_vec()]
    );
    assert_eq!(
        written(&plan, Object::new(0x6065, 0)),
        [4_000_000_000u32.to_le_bytes().to_vec()]
    );
    assert_eq!(written(&plan, Object::new(0x60C5, 0)), [vec![0xFF]]);
    assert_eq!(written(&plan, Object::new(0x6060, 0)), [vec![8]]);
    let maker = plan.steps.iter().any(
        |step| matches!(step, Step::Read(check) if check.object == Object::new(0x1018, 1) && check.mask == u32::MAX && check.value == 90),
    );
    assert!(maker);
}

#[test]
fn a_drive_at_the_motor_has_a_joint_without_a_link_side_encoder_or_with_one() {
    let motor = node().with(TEST_JOINT, "position = \"link\"", "position = \"motor\"");
    let robot = motor.load(TEST_JOINT).unwrap_or_else(|e| panic!("{e}"));
    assert!(robot.parameters.joints[0].has_link_encoder);
    let alone = motor.with(TEST_JOINT, "other_angle = \"2240:00\"\n", "");
    let text = alone.errors(TEST_JOINT);
    assert!(
        text.contains("joint.link_angle (joint): the key is missing"),
        "{text}"
    );
}

#[test]
fn what_a_node_cannot_have_is_refused() {
    for (from, to, at, parts) in [
        (
            "node = 3\n",
            "",
            "[[joint]]",
            ["joint.node (joint): the key is missing", "1 to 126"],
        ),
        (
            "node = 3",
            "node = 127",
            "node = 127",
            ["joint.node (joint)", "1 to 126"],
        ),
        (
            "other_angle = \"2240:00\"\n",
            "",
            "[drive.joint.canopen]",
            [
                "drive.canopen.other_angle (joint): the key is missing",
                "nothing measures the motor's",
            ],
        ),
        (
            "\"2240:00\"",
            "\"2240:zz\"",
            "other_angle",
            [
                "drive.canopen.other_angle (joint)",
                "index and sub-index in hexadecimal",
            ],
        ),
        (
            "rated_current_A = 5.0",
            "rated_current_A = 0.0",
            "rated_current_A",
            ["drive.canopen.rated_current_A (joint)", "> 0"],
        ),
        (
            "rated_current_A",
            "heartbeat_ms = 5\nrated_current_A",
            "heartbeat_ms",
            ["drive.canopen.heartbeat_ms (joint)", "20 to 2000"],
        ),
        (
            "rated_current_A",
            "sdo = [{ object = \"6065:00\", bits = 8, value = 300 }]\nrated_current_A",
            "sdo",
            ["drive.canopen.sdo.value (joint)", "300"],
        ),
        (
            "rated_current_A",
            "sdo = [{ object = \"6065:00\", bits = 12, value = 3 }]\nrated_current_A",
            "sdo",
            ["drive.canopen.sdo.bits (joint)", "8, 16 or 32"],
        ),
        (
            "rated_current_A",
            "eds = \"drive.eds\"\nrated_current_A",
            "eds",
            ["drive.eds", "cannot be read"],
        ),
    ] {
        refused(&node().with(TEST_JOINT, from, to), TEST_JOINT, at, &parts);
    }
}

#[test]
fn a_bus_without_nodes_needs_its_keys() {
    for (key, line) in [
        (
            "dbc",
            "dbc = \"../../robot-models/test-joint/drives.dbc\"\n",
        ),
        ("sync", "sync = \"SYNC\"\n"),
    ] {
        let text = Files::new().with(TEST_JOINT, line, "").errors(TEST_JOINT);
        let missing = format!("bus.{key} (a): the key is missing");
        assert!(text.contains(&missing), "{text}");
    }
    let dbc = Files::new().with(TEST_JOINT, SIGNALS, &format!("node = 3\n{SIGNALS}"));
    let parts = [
        "joint.node (joint): its drive is no node",
        "no such key, or a profile",
    ];
    refused(&dbc, TEST_JOINT, "node = 3", &parts);
}

#[test]
fn an_object_dictionary_is_held_against_what_is_needed() {
    let files = node().with(
        TEST_JOINT,
        "rated_current_A",
        "eds = \"drive.eds\"\nrated_current_A",
    );
    let eds = "[6040]\nParameterName=Control word\nDataType=0x0006\nAccessType=rw\nPDOMapping=0\n";
    let text = files
        .and("config/test-joint/drive.eds", eds)
        .errors(TEST_JOINT);
    for part in [
        "drive.eds:1: config/test-joint/robot.toml:50: drive.canopen.eds (joint): 6040:00 (Control word) cannot be mapped",
        "no object 2240:00",
    ] {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
}

/// The test joint on a Damiao actuator.
fn actuator() -> Files {
    let made = "profile = \"damiao\"\n[drive.joint.actuator]\nmodel = \"DM4310\"\nkp_Nm_per_rad = 80.0\nkd_Nms_per_rad = 2.0\n";
    let feedback = "law = \"proportional_integral\"\ntorque_feedback = \"whole_body\"";
    node()
        .with(TEST_JOINT, CANOPEN, made)
        .with(TEST_JOINT, "gear_ratio = 100.0", "gear_ratio = 10.0")
        .with(
            TEST_JOINT,
            "law = \"predictive\"\ntorque_feedback = \"torsion\"",
            feedback,
        )
        .with(
            TEST_JOINT,
            "gains = { ",
            "gains = { K_p = 0.0, K_i_per_s = 0.0, ",
        )
        .with(
            TEST_JOINT,
            "K_tau_rad_per_Nm = 0.00024",
            "K_tau_rad_per_Nm = 0.0125",
        )
}

#[test]
fn an_actuator_has_messages_that_no_bus_carries_and_is_asked_each_cycle() {
    let robot = actuator()
        .load(TEST_JOINT)
        .unwrap_or_else(|e| panic!("{e}"));
    let [made] = &robot.nodes.actuators[..] else {
        panic!("{:?}", robot.nodes.actuators);
    };
    assert_eq!(
        (made.family, made.at.node, made.at.master),
        ("damiao", 3, 0x13)
    );
    assert_eq!((made.kp, made.gear_ratio), (80.0, 10.0));
    assert!(robot.nodes.plans.is_empty());
    assert_eq!(robot.sync.len(), 1);
    let own = robot
        .sync
        .iter()
        .all(|frame| drives_of_makers::family::translation::is_own(frame.id));
    assert!(own, "no SYNC of CANopen, which may be a node's identifier");
    let joint = &robot.parameters.joints[0];
    assert!(!joint.has_link_encoder && joint.has_velocity && joint.has_status);
    let counts = joint.estimator.motor_resolution * 65535.0 / (2.0 * 12.5 * 10.0);
    assert!((counts - 1.0).abs() < 1e-12, "{counts}");
}

/// A joint that counts against its actuator takes position, velocity, torque and current of it the other way round.
#[test]
fn an_actuator_has_one_direction() {
    let frames = |written: &str| {
        let node = format!("node = 3\n{written}");
        let robot = (actuator()
            .with(TEST_JOINT, "node = 3", &node)
            .load(TEST_JOINT))
        .unwrap_or_else(|e| panic!("{e}"));
        let values = vec![0.5; robot_config::slots::receive_len(&robot.parameters)];
        let mut frames = can_codec::Frames::default();
        robot.receive.encode_all(&values, &mut frames);
        let data: Vec<_> = (&frames).into_iter().map(|frame| frame.data).collect();
        data
    };
    let against = "motor_angle = { direction = -1 }\n";
    let all = frames(&format!("{against}current = {{ direction = -1 }}\n"));
    assert_eq!(frames(against), all);
    assert_ne!(
        frames(&format!("{against}current = {{ direction = 1 }}\n")),
        all
    );
}

#[test]
fn what_an_actuator_cannot_have_is_refused() {
    for (from, to, at, parts) in [
        (
            "DM4310",
            "DM1",
            "model = ",
            ["drive.actuator.model (joint): \"DM1\"", "DM4310, DM4310P"],
        ),
        (
            "kp_Nm_per_rad = 80.0",
            "kp_Nm_per_rad = 800.0",
            "kp_Nm_per_rad",
            ["drive.actuator.kp_Nm_per_rad (joint)", "500"],
        ),
        (
            "node = 3",
            "node = 3\nreply_id = 2048",
            "reply_id",
            ["joint.reply_id (joint)", "0 to 2047"],
        ),
    ] {
        refused(
            &actuator().with(TEST_JOINT, from, to),
            TEST_JOINT,
            at,
            &parts,
        );
    }
}

/// The actuator of [`actuator`] of another family.
fn of_family(profile: &str, model: &str) -> Files {
    let table = "profile = \"damiao\"\n[drive.joint.actuator]\nmodel = \"DM4310\"";
    let made = format!("profile = \"{profile}\"\n[drive.joint.actuator]\nmodel = \"{model}\"");
    actuator().with(TEST_JOINT, table, &made)
}

#[test]
fn every_family_is_a_profile() {
    for family in drives_of_makers::family::FAMILIES {
        let model = family.models()[0].name;
        let mut files = of_family(family.name(), model);
        if family.needs_fd() {
            let parts = ["joint.node (joint)", "those of CAN FD", "fd = true"];
            refused(&files, TEST_JOINT, "node = 3", &parts);
            files = files.with(TEST_JOINT, "fd = false", "fd = true");
        }
        let robot = files.load(TEST_JOINT).unwrap_or_else(|e| panic!("{e}"));
        let made = &robot.nodes.actuators[0];
        assert_eq!((made.family, made.model.name), (family.name(), model));
    }
}

#[test]
fn a_family_has_identifiers_and_gains_of_its_own() {
    let parts = ["joint.node (joint)", "1 to 32"];
    let rmd = of_family("myactuator", "RMD-T24").with(TEST_JOINT, "node = 3", "node = 33");
    refused(&rmd, TEST_JOINT, "node = 33", &parts);
    // Of an ODrive's motor, which turns ten times for the output's once.
    let soft = of_family("odrive", "ODrive").with(
        TEST_JOINT,
        "kd_Nms_per_rad = 2.0",
        "kd_Nms_per_rad = 0.0",
    );
    let parts = ["drive.actuator.kd_Nms_per_rad (joint)", "0.001 to 100000"];
    refused(&soft, TEST_JOINT, "kd_Nms_per_rad", &parts);
}
