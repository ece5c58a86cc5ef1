//! Joints without a link-side encoder.

use crate::files::{Files, HRP2_LIKE, LEG, leg_with, refused};
use control::DriveModel;
use robot_config::{Robot, slots};

const KNEE_LINK: &str =
    "link_angle = { signal = \"KNEE_STATE.link_angle\", direction = 1, offset_deg = -180.0 }\n";

#[test]
fn a_motor_angle_that_wraps_within_the_joints_range_is_refused() {
    // 16 turns of 100 : 1 are 57.6 degrees; the knee moves by 150.
    let gains = "gains = { K_p = 0.0, K_i_per_s = 8.0, K_s_Nm_per_rad = 9804.0";
    let files = leg_with(KNEE_LINK, "").with(LEG, "gains = { K_s_Nm_per_rad = 9804.0", gains);
    let parts = [
        "joint.motor_angle (knee): the signal starts again after 57.600 deg of the joint",
        "allowed: position limits within half",
    ];
    let at = "motor_angle = { signal = \"KNEE_STATE.motor_angle\"";
    refused(&files, LEG, at, &parts);
}

#[test]
fn hrp2_like_has_motor_encoders_alone() {
    let robot = Files::new().load(HRP2_LIKE).unwrap();
    let filled: Vec<usize> = (0..robot.receive.message_count())
        .flat_map(|m| robot.receive.slots(m).collect::<Vec<_>>())
        .collect();
    for (j, joint) in robot.parameters.joints.iter().enumerate() {
        assert!(!joint.has_link_encoder);
        assert!(filled.contains(&slots::motor_angle(j)));
        assert!(!filled.contains(&slots::link_angle(j)));
        let n = joint.encoders.gear_ratio;
        assert!(
            (joint.estimator.link_resolution * n - joint.estimator.motor_resolution).abs() < 1e-15
        );
    }
    // Over the motor's angle: no gear.
    let drive = 3.46069e-5;
    let knee = &robot.parameters.joints[3];
    let DriveModel::Position(model) = knee.drive_model else {
        panic!("{:?}", knee.drive_model)
    };
    for lead in [model.k_tau, model.k_tau_motor, knee.limits.lead / 233.0] {
        assert!((lead / drive - 1.0).abs() < 1e-9, "{lead} {drive}");
    }
}

#[test]
fn what_needs_a_second_encoder_is_refused() {
    let name = "drive = \"knee\"";
    for (from, to, parts) in [
        (
            "torque_feedback = \"whole_body\"",
            "torque_feedback = \"encoder\"",
            vec![
                "joint.link_angle (knee)",
                "takes both encoders",
                "\"whole_body\"",
            ],
        ),
        (
            name,
            "drive = \"knee\"\nskew_us = 100.0",
            vec!["joint.skew_us (knee)", "one encoder"],
        ),
        (
            name,
            "drive = \"knee\"\ncalibration = \"knee.toml\"",
            vec!["joint.calibration (knee)", "both encoders"],
        ),
    ] {
        let text = Files::new().with(HRP2_LIKE, from, to).errors(HRP2_LIKE);
        for part in parts {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
    let current = Files::new().with(HRP2_LIKE, "command = \"position\"", "command = \"current\"");
    let text = current
        .with(
            HRP2_LIKE,
            "current_sigma_A = 0.02",
            "current_sigma_A = 0.02\ncurrent_limit_A = 20.0",
        )
        .with(
            HRP2_LIKE,
            "K_tau_rad_per_Nm = ",
            "K_1_Nm_per_A = 8.0\nK_2_Nms_per_rad = 0.5\nK_3_Nm = 4.0\n# ",
        )
        .with(HRP2_LIKE, "K_v_s = ", "# ")
        .with(HRP2_LIKE, "K_c_rad = ", "# ")
        .with(HRP2_LIKE, "dead_zone_rad = ", "# ")
        .errors(HRP2_LIKE);
    assert!(text.contains("joint.link_angle (knee)"), "{text}");
    assert!(text.contains("takes currents"), "{text}");
    // A feedback of torque needs a sensor that measures contacts.
    let toml = Files::new();
    let toml = toml.text(HRP2_LIKE);
    let from = toml.find("[[ft_sensor]]").unwrap();
    let to = toml.find("[imu]").unwrap();
    let text = Files::new()
        .with(HRP2_LIKE, &toml[from..to], "")
        .with(
            HRP2_LIKE,
            "gains = { K_p = 0.0, K_s_Nm_per_rad = 3066.0",
            "gains = { K_p = 0.0, K_i_per_s = 8.0, K_s_Nm_per_rad = 3066.0",
        )
        .errors(HRP2_LIKE);
    assert!(text.contains("joint.gains (ankle_roll)"), "{text}");
    assert!(text.contains("no torque to feed back"), "{text}");
}

#[test]
fn one_kind_of_drive_is_not_that_of_joints_of_both_kinds() {
    let gains = "gains = { K_p = 0.0, K_i_per_s = 8.0, K_s_Nm_per_rad = 9804.0";
    let files = leg_with(KNEE_LINK, "")
        .with(LEG, "gains = { K_s_Nm_per_rad = 9804.0", gains)
        .with(
            LEG,
            "drive = \"knee\"",
            "drive = \"hip_roll\"\nposition_max_deg = 25.0",
        );
    let parts = [
        "joint.drive (knee)",
        "joint hip_roll",
        "a kind of drive of its own",
    ];
    refused(
        &files,
        LEG,
        "drive = \"hip_roll\"\nposition_max_deg",
        &parts,
    );
}

#[test]
fn a_joint_that_forgets_its_encoder_says_so_by_its_gains() {
    // The predictive law has no K_p: a link_angle that was left out by mistake does not pass unnoticed.
    let text = leg_with(KNEE_LINK, "").errors(LEG);
    assert!(
        text.contains("joint.gains.K_p (knee): the key is missing"),
        "{text}"
    );
}

/// The integral that brings the torque to the level of F/T sensors and IMU is the largest that the margins allow.
#[test]
fn the_margins_choose_the_feedback() {
    let k_i = |robot: &Robot| -> Vec<f64> {
        let joints = robot.parameters.joints.iter();
        joints.map(|joint| joint.gains.k_i).collect()
    };
    let robot = Files::new().load(HRP2_LIKE).unwrap();
    assert_eq!(k_i(&robot), [8.0; 6]);
    // A torque that is 150 ms late can be followed less closely.
    let later = Files::new()
        .with(
            HRP2_LIKE,
            "encoder = { window = 80",
            "encoder = { window = 300",
        )
        .with(
            HRP2_LIKE,
            "sensor = { window = 80",
            "sensor = { window = 300",
        );
    for k_i in k_i(&later.load(HRP2_LIKE).unwrap()) {
        assert!((0.5..8.0).contains(&k_i), "{k_i}");
    }
    for (joint, _) in robot.parameters.joints.iter().zip(0..) {
        let feedback = robot_config::motor_side_loop(joint, &robot.parameters).unwrap();
        assert!((feedback.smoothing.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        // The velocity of a unit rate.
        let rate = |(k, weight): (usize, &f64)| k as f64 * 1e-3 * weight;
        let velocity: f64 = feedback.velocity.iter().enumerate().map(rate).sum();
        assert!((velocity - 1.0).abs() < 1e-9, "{velocity}");
        assert!(feedback.keeps(control::margins::NEEDED), "{}", joint.name);
    }
}

#[test]
fn a_torque_that_no_current_can_judge_is_not_fed_back() {
    let files = Files::new();
    let toml = files.text(HRP2_LIKE);
    let drive = toml.find("[drive.knee.friction]").unwrap();
    let line = toml[drive..]
        .lines()
        .find(|l| l.starts_with("coulomb_Nm"))
        .unwrap();
    let friction = &toml[drive..drive + toml[drive..].find(line).unwrap() + line.len()];
    let without = friction.replace(line, "coulomb_Nm = 0.0");
    let text = Files::new()
        .with(HRP2_LIKE, friction, &without)
        .errors(HRP2_LIKE);
    assert!(text.contains("joint.gains (knee)"), "{text}");
    assert!(text.contains("motor current cannot show"), "{text}");
}
