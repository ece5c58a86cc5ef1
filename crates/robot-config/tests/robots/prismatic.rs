//! Prismatic joints: units of keys, signals and parameters; joints that follow others.

use crate::files::{Files, LEG, LIFT_GRIPPER, refused};
use control::predictive::Design;
use control::{DriveModel, PositionDrive};
use robot_config::slots;
use robot_state::JointKind;
use std::f64::consts::TAU;

const DBC: &str = "robot-models/lift-gripper/drives.dbc";

/// The lift rings with help where a command acts 6 ms late.
#[test]
fn prismatic_joints_have_the_design_of_others_and_no_help_for_a_hand_where_it_rings() {
    let designs = |files: Files| {
        let robot = files.load(LIFT_GRIPPER).unwrap();
        let joints = robot.parameters.joints.into_iter();
        joints.map(|joint| joint.law.design).collect::<Vec<_>>()
    };
    // Slides have no more help than the default's, which a hinge may have.
    let [lift, boom, finger] = designs(Files::new())[..] else {
        panic!("three joints")
    };
    assert_eq!([lift, finger], [Design::default(); 2]);
    assert!(boom.assist > lift.assist, "{boom:?}");
    let linear = Design {
        assist: lift.assist,
        ..boom
    };
    assert_eq!(linear, lift);
    let late = Files::new().with(
        LIFT_GRIPPER,
        "[control]",
        "[control]\ncommand_delay_us = 6000",
    );
    let [lift, ..] = designs(late)[..] else {
        panic!("no lift")
    };
    assert!(lift.assist == 0.0, "{lift:?}");
}

#[test]
fn a_lifts_parameters_are_in_newton_and_metres() {
    let robot = Files::new().load(LIFT_GRIPPER).unwrap();
    let joints = &robot.parameters.joints;
    let kinds: Vec<_> = joints.iter().map(|joint| joint.kind).collect();
    use JointKind::{Prismatic, Revolute};
    assert_eq!(kinds, [Prismatic, Revolute, Prismatic]);
    let lift = &joints[0];
    let near = |value: f64, expected: f64| {
        assert!((value / expected - 1.0).abs() < 1e-9, "{value} {expected}");
    };
    near(lift.encoders.gear_ratio, TAU / 0.005);
    near(lift.limits.position_min, -0.2);
    near(lift.limits.torque, 600.0);
    near(lift.limits.velocity, 0.25);
    near(lift.limits.rest, 0.002);
    near(lift.limits.lead, 1.33333e-6 * 600.0);
    near(lift.estimator.link_resolution, 1e-6);
    near(lift.estimator.torsion_sigma, 5.4e-6);
    near(lift.estimator.kinematic_error.link[0].0, 3e-6);
    near(lift.estimator.kinematic_error.w_link, 104.72);
    // 9 kg of torso, 2 of boom, 0.8 of gripper, and two fingers.
    near(lift.link_inertia, 12.04);
    // Its own finger, and the one that follows.
    near(joints[2].link_inertia, 0.24);
    let DriveModel::Position(PositionDrive { k_tau, .. }) = lift.drive_model else {
        panic!("{:?}", lift.drive_model)
    };
    near(k_tau, 1.33333e-6);
    near(*lift.desired_range().end(), 0.2 + 0.1 * TAU / 360.0);
    let followers = joints
        .iter()
        .filter(|joint| joint.name.contains("follower"));
    assert_eq!(followers.count(), 0);
}

#[test]
fn set_points_and_link_signals_are_lengths() {
    let robot = Files::new().load(LIFT_GRIPPER).unwrap();
    let decoded = |table: &can_codec::Table, slot: usize, bytes: &[u8]| {
        let mut values = vec![0.0; 400];
        for message in 0..table.message_count() {
            if table.slots(message).any(|own| own == slot) {
                let mut frame = can_codec::Frame::zeroed(0, 0, 0, true);
                assert!(table.encode(message, &values, &mut frame));
                frame.data[..bytes.len()].copy_from_slice(bytes);
                assert!(table.decode(&frame, &mut values).is_ok());
            }
        }
        values[slot]
    };
    // 262,144 counts of 1 um are the middle of the stroke, 1000 more are a mm above it.
    let counts = (262_144_u32 + 1000).to_le_bytes();
    let q = decoded(&robot.receive, slots::link_angle(0), &counts);
    assert!((q - 1e-3).abs() < 1e-12, "{q}");
    // Boom's set-point in the first four bytes, the lift's in the next, 10 nm a count.
    let set_point = [[0; 4], 5_000_000_i32.to_le_bytes()].concat();
    let q = decoded(&robot.send, slots::command(0), &set_point);
    assert!((q - 0.05).abs() < 1e-12, "{q}");
}

#[test]
fn keys_with_the_other_kinds_units_are_refused_with_the_right_one() {
    for (from, to, key, allowed) in [
        (
            "torque_limit_N = 600.0",
            "torque_limit_N = 600.0\ntorque_limit_Nm = 600.0",
            "torque_limit_Nm",
            "torque_limit_N",
        ),
        (
            "torque_limit_N = 600.0",
            "torque_limit_N = 600.0\nposition_max_deg = 100.0",
            "position_max_deg",
            "position_max_mm",
        ),
        (
            "torque_limit_Nm = 57.0",
            "torque_limit_Nm = 57.0\nposition_max_mm = 20.0",
            "position_max_mm",
            "position_max_deg",
        ),
        (
            "torque_limit_N = 600.0",
            "torque_limit_N = 600.0\nfollowing_error_deg = 1.0",
            "following_error_deg",
            "following_error_mm",
        ),
        (
            "K_fs0_N_per_m = 1500000.0",
            "K_fs0_N_per_m = 1500000.0\nK_fs0_Nm_per_rad = 15.0",
            "K_fs0_Nm_per_rad",
            "K_fs0_N_per_m",
        ),
        (
            "motor_mm = [[-0.0015,",
            "motor_deg = [[0, 1]], motor_mm = [[-0.0015,",
            "motor_deg",
            "motor_mm",
        ),
    ] {
        let files = Files::new().with(LIFT_GRIPPER, from, to);
        let at = if to.contains('\n') {
            to.split('\n').nth(1).unwrap()
        } else {
            to
        };
        let key = format!(".{key}");
        refused(
            &files,
            LIFT_GRIPPER,
            at,
            &[&key, "has other units", &format!("allowed: {allowed}")],
        );
    }
}

#[test]
fn a_missing_key_is_named_with_its_own_units() {
    let files = Files::new().with(LIFT_GRIPPER, "torque_limit_N = 600.0\n", "");
    let text = files.errors(LIFT_GRIPPER);
    assert!(
        text.contains("joint.torque_limit_N (lift): the key is missing"),
        "{text}"
    );
    let files = Files::new().with(
        LIFT_GRIPPER,
        "w_link_per_m = 104.72, link_mm = [[0.003",
        "link_mm = [[0.003",
    );
    let text = files.errors(LIFT_GRIPPER);
    assert!(
        text.contains("joint.kinematic_error.w_link_per_m (lift)"),
        "{text}"
    );
}

#[test]
fn a_drive_is_for_joints_of_its_kind() {
    let files = Files::new().with(LIFT_GRIPPER, "drive = \"lift\"", "drive = \"boom\"");
    let parts = [
        "joint.drive (lift)",
        "the joint is prismatic",
        "lead_mm_per_turn",
    ];
    refused(&files, LIFT_GRIPPER, "drive = \"boom\"", &parts);
    let files = Files::new().with(
        LIFT_GRIPPER,
        "lead_mm_per_turn = 5.0",
        "lead_mm_per_turn = 5.0\ngear_ratio = 100.0",
    );
    let parts = ["drive.gear_ratio (lift)", "not both"];
    refused(&files, LIFT_GRIPPER, "gear_ratio = 100.0", &parts);
    let files = Files::new().with(LEG, "torque_limit_Nm", "torque_limit_N");
    assert!(files.errors(LEG).contains("torque_limit_Nm"));
}

#[test]
fn angles_are_no_signals_of_a_prismatic_joints_link() {
    let from = "lift_position : 32|32@1- (1e-08,0) [-21.4748365|21.4748365] \"m\"";
    let files = Files::new();
    assert!(files.text(DBC).contains("lift_position"));
    let files = files.with(DBC, from, &from.replace("\"m\"", "\"rad\""));
    let text = files.errors(LIFT_GRIPPER);
    assert!(text.contains("COMMAND.lift_position"), "{text}");
    assert!(text.contains("allowed: m, mm, um, count"), "{text}");
}

/// A joint file of the lift: its way is the arc of a radius of 0.1 m.
const LIFT: &str = "[joint]\nname = \"lift\"\ngear_ratio = 125.66370614359172\n\
    torque_constant_Nm_per_A = 0.06\nrotor_inertia_kg_m2 = 2e-5\nrated_torque_Nm = 27.0\n\
    link_counts_per_turn = 628318.5307179586\nmotor_counts_per_turn = 4096\nsample_rate_hz = 1000\n\
    torque_limit_Nm = 60.0\nradius_m = 0.1\n";

#[test]
fn a_joint_file_is_of_a_joint_that_slides_or_of_one_that_turns() {
    let with = |joint: &str, text: &str| {
        let named = format!("name = \"{joint}\"\ncalibration = \"joint.toml\"");
        let files = Files::new().with(LIFT_GRIPPER, &format!("name = \"{joint}\""), &named);
        files.and("config/lift-gripper/joint.toml", text)
    };
    let robot = with("lift", LIFT).load(LIFT_GRIPPER).expect("a robot");
    let file = robot.parameters.joints[0].calibration.as_ref();
    assert_eq!(file.expect("a calibration").file().joint.radius, Some(0.1));
    for (joint, from, to, part) in [
        ("lift", "radius_m = 0.1\n", "", "this one is prismatic"),
        ("boom", "", "", "is for a prismatic joint"),
        (
            "lift",
            "radius_m = 0.1",
            "radius_m = 0.2",
            "is for gear_ratio = 125.6",
        ),
        (
            "lift",
            "= 628318.5307179586",
            "= 524288",
            "is for link_counts_per_turn",
        ),
        ("lift", "= 60.0", "= 59.0", "is for torque_limit_Nm = 59"),
        ("lift", "radius_m = 0.1", "radius_m = -1", "joint.radius_m"),
    ] {
        let text = with(joint, &LIFT.replacen(from, to, 1)).errors(LIFT_GRIPPER);
        assert!(text.contains(part), "{part}: {text}");
        assert!(
            text.contains(&format!("joint.calibration ({joint})")),
            "{text}"
        );
    }
}

#[test]
fn joints_that_follow_others_have_no_table() {
    let joint = "[[joint]]\nname = \"finger\"";
    let files = Files::new().with(LIFT_GRIPPER, joint, "[[joint]]\nname = \"finger_follower\"");
    let text = files.errors(LIFT_GRIPPER);
    assert!(text.contains("joint.name (finger_follower)"), "{text}");
    assert!(text.contains("follows finger"), "{text}");
}
