//! A joint that has a joint file is estimated by all that the file switches on.

mod common;

use common::{Bench, read};
use robot_state::{torque_flags, torque_source};

const JOINT: &str = "\
[joint]
name = \"joint\"
gear_ratio = 100.0
torque_constant_Nm_per_A = 0.05
rotor_inertia_kg_m2 = 1.14e-5
rated_torque_Nm = 16.0
link_counts_per_turn = 524288
motor_counts_per_turn = 4096
sample_rate_hz = 1000.0
[encoders]
skew_s = 0.0
[kinematic_error]
a0_rad = 0.0
w_link = 1.0
link_rad = [[2.576106e-06, 7.520624e-05]]
w_motor = 1.0
motor_rad = [[-2.782055e-05, 3.300418e-05], [-5.738643e-05, -1.579348e-05]]
[compliance]
K_fs0_Nm_per_rad = 8333.0
C_fs_per_Nm = 0.089
K_wg0_Nm_per_rad = 1.33
C_wg_per_Nm = 83.5
low_pass_pole = 0.95
torsion_sigma_rad = 5e-5
[fusion]
moving_rad_per_s = 0.01
loading_rad_per_s = [1e-3, 1e-2, 1e-1]
blend_s = 0.03
[fusion.sources.compliance]
rms_Nm = [0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3]
sigma_Nm = [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]
[fusion.sources.current]
rms_Nm = [1.5, 0.8, 1.5, 0.8, 1.5, 0.8, 1.5, 0.8]
sigma_Nm = [1.0, 0.8, 1.0, 0.8, 1.0, 0.8, 1.0, 0.8]
";

/// The project's files, the test joint calibrated by `joint`.
fn calibrated(joint: &str) -> impl Fn(&str) -> std::io::Result<String> {
    let joint = joint.to_owned();
    move |path| match path {
        "config/test-joint/calibration/joint.toml" => Ok(joint.clone()),
        "config/test-joint/robot.toml" => {
            let key = "drive = \"joint\"\ntorque_limit_Nm";
            let with =
                "drive = \"joint\"\ncalibration = \"calibration/joint.toml\"\ntorque_limit_Nm";
            Ok(read(path)?.replace(key, with))
        }
        _ => read(path),
    }
}

#[test]
fn the_fused_torque_is_published() {
    let mut plain = Bench::new("test-joint");
    let mut bench = Bench::reading("test-joint", &calibrated(JOINT));
    for cycle in 0..600 {
        plain.run(1);
        bench.run(1);
        let tau = bench.cycle.record().joints[0].tau_encoder;
        if cycle > 100 {
            assert_eq!(tau.source, torque_source::FUSED);
            assert!(tau.flags & torque_flags::VALID != 0);
            // Only the compliance is close enough to count, and it is the same gear.
            let other = plain.cycle.record().joints[0].tau_encoder;
            assert_eq!(other.source, torque_source::ENCODER);
            assert!(
                (tau.tau - other.tau).abs() < 0.5,
                "{} {}",
                tau.tau,
                other.tau
            );
        }
    }
}

#[test]
fn a_joint_file_of_another_joint_is_refused() {
    let message = |joint: &str| {
        let read = calibrated(joint);
        robot_config::load("config/test-joint/robot.toml", &read)
            .err()
            .map(|error| error.to_string())
            .unwrap()
    };
    let cases = [
        (
            JOINT.replace("= 100.0", "= 101.0"),
            "is for gear_ratio = 101, this joint has 100",
        ),
        (
            JOINT.replace("= 1000.0", "= 500.0"),
            "is for sample_rate_hz = 500",
        ),
        (
            JOINT.replace("[compliance]", "[complaint]"),
            "unknown field `complaint`",
        ),
        (
            JOINT.replace("sources.current", "sources.network"),
            "fusion.sources has",
        ),
    ];
    for (joint, expected) in cases {
        let message = message(&joint);
        assert!(
            message.contains(expected) && message.contains(".toml:"),
            "{message}"
        );
        assert!(message.contains("joint.calibration (joint)"), "{message}");
    }
    let missing = |path: &str| match path {
        "config/test-joint/calibration/joint.toml" => Err(std::io::ErrorKind::NotFound.into()),
        _ => calibrated("")(path),
    };
    let error = robot_config::load("config/test-joint/robot.toml", &missing);
    let message = error.err().map(|error| error.to_string()).unwrap();
    assert!(
        message.contains("config/test-joint/calibration/joint.toml: entity not found"),
        "{message}"
    );
}
