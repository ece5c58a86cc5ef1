//! A joint file that is refused: the problem has the line, the key and the numbers allowed.

use joint_file::{JointFile, no_files};

const JOINT: &str = r#"
[joint]
name = "bench"
gear_ratio = 100
torque_constant_Nm_per_A = 0.05
rotor_inertia_kg_m2 = 1.14e-5
rated_torque_Nm = 16
link_counts_per_turn = 524288
motor_counts_per_turn = 4096
sample_rate_hz = 1000
"#;

#[test]
fn joint_files_are_checked_key_by_key() {
    let message = |text: &str| {
        JointFile::parse(text, "joint.toml", &no_files)
            .unwrap_err()
            .to_string()
    };
    let with = |from: &str, to: &str| JOINT.replace(from, to);
    let gear = |springs: &str| {
        let elastic = "linear_Nm_per_rad = 7000\ncubic_Nm_per_rad3 = 0\nwind_up = []";
        format!("{JOINT}\n[hysteresis]\n{elastic}\n{springs}\ntorsion_sigma_rad = 1e-6")
    };
    let cases = [
        (
            with("gear_ratio = 100", "gear_ratio = -1"),
            "joint.toml:4: joint.gear_ratio = -1; allowed: a finite number > 0",
        ),
        (
            with("gear_ratio = 100", ""),
            "joint.toml:2: missing field `gear_ratio`",
        ),
        (
            with("gear_ratio", "gear_ration"),
            "unknown field `gear_ration`",
        ),
        (
            with("= 16", "= nan"),
            "joint.toml:7: joint.rated_torque_Nm = NaN; allowed: a finite number",
        ),
        (
            format!("{JOINT}\n[encoders]\nskew_s = 1"),
            "encoders.skew_s = 1; allowed: a number from -0.016 to 0.016",
        ),
        (
            format!("{JOINT}\n[kinematic_error]\nlink_rad = [[1e-5, inf]]"),
            "joint.toml:13: kinematic_error.link_rad[0][1] = inf; allowed: a finite number",
        ),
        (
            gear("slipping = [[1e-4, 500.0], [-2e-4, 300.0]]"),
            "joint.toml:16: hysteresis.slipping[1][0] = -0.0002; allowed: a finite number > 0",
        ),
        (
            gear("slipping = []\ncreeping = [[0.0, 300.0]]"),
            "joint.toml:17: hysteresis.creeping[0][0] = 0; allowed: a finite number > 0",
        ),
        (
            gear("slipping = []\ntracking_poles = [0.5, 1.0, 0.9]"),
            "joint.toml:17: hysteresis.tracking_poles[1] = 1; allowed: a number from 0 to below 1",
        ),
        (
            gear("slipping = []\ntracking_sigma_rad = -1e-6"),
            "joint.toml:17: hysteresis.tracking_sigma_rad = -0.000001; allowed: a finite number >= 0",
        ),
        (
            gear("slipping = []\ncreeping = [[0.3, -1.0]]"),
            "joint.toml:17: hysteresis.creeping[0][1] = -1; allowed: a finite number >= 0",
        ),
        (format!("{JOINT}\n[moon]\nx = 1"), "unknown field `moon`"),
    ];
    for (text, expected) in cases {
        let message = message(&text);
        assert!(message.contains(expected), "{message}");
    }
    // The smallest file runs: torque from current alone.
    let joint = JointFile::parse(JOINT, "joint.toml", &no_files).unwrap();
    assert_eq!(joint.estimators().unwrap().names(), ["current"]);
}
