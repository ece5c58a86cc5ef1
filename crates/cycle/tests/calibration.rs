//! A joint with a joint file is estimated by all estimators of the file.

use crate::common;

use common::{Bench, client_input, read};
use cycle::ClientInput;
use estimators::joint::{DRIVE_OFF, JointTorqueEstimator};
use joint_file::{JointFile, no_files};
use robot_state::measured_flags::{MISSED, NEVER};
use robot_state::{DriveState, Event, JointTare, Mode, Settings, torque_flags, torque_source};

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
rms_Nm = [6.0, 6.0, 6.0, 6.0, 6.0, 6.0, 6.0, 6.0]
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
        let tau = bench.cycle.record().estimated.joints[0].tau_encoder;
        if cycle > 100 {
            assert_eq!(tau.source, torque_source::FUSED);
            assert!(tau.flags & torque_flags::VALID != 0);
            // Of the file's estimators only the compliance has weight, and it is that of the drive.
            let other = plain.cycle.record().estimated.joints[0].tau_encoder;
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

/// The loop and an evaluation of its log build the same samples, for any velocity window.
#[test]
fn the_loop_estimates_as_an_evaluation_of_its_log_does() {
    let current = "[current]\nK_1_Nm_per_A = 5.0\nK_2_Nms_per_rad = 40.0\nK_3_Nm = 1.0\n\
        inertia_kg_m2 = 0.1\noffset_A = 0.0\nsign_smoothing_rad_per_s = 0.02\n\
        low_pass_pole = 0.5\nsigma_Nm = 1.0\n";
    for window in [5, 33] {
        let encoders = format!("skew_s = 7e-4\nvelocity_window = {window}");
        let text = JOINT.replace("skew_s = 0.0", &encoders) + current;
        let mut bench = Bench::reading("test-joint", &calibrated(&text));
        let file = JointFile::parse(&text, "joint.toml", &no_files).unwrap();
        let mut front_end = file.front_end().unwrap();
        let mut set = file.estimators().unwrap();
        let mut largest = 0.0f64;
        let (mut off, mut on) = (0u32, 0);
        for _ in 0..1200 {
            // While the drive is off, and half a second longer, the loop says so.
            let state = bench.cycle.record().commanded.joints[0].drive_state;
            off = if state == DriveState::Enabled.number() {
                off.saturating_sub(1)
            } else {
                500
            };
            bench.run(1);
            let record = bench.cycle.record();
            let measured = &record.measured.joints[0];
            assert_eq!(measured.flags & (MISSED | NEVER), 0);
            let mut sample = front_end.update(measured.theta, measured.q, measured.current);
            if off > 0 {
                sample.flags |= DRIVE_OFF;
            } else {
                on += 1;
            }
            let tau = set.update(&sample).tau;
            assert_eq!(record.estimated.joints[0].tau_encoder.tau, tau);
            largest = largest.max(sample.dq.abs());
        }
        assert!(largest > 1e-4, "the joint moves: {largest}");
        assert!(on > 500, "the drive is on: {on}");
    }
}

/// The times that the disagreement of the sources is counted in four seconds, with a torque constant `gain`
/// times the right one in the calibration.
fn disagreements(gain: f64) -> u64 {
    let current = format!(
        "[current]\nK_1_Nm_per_A = {:.2}\nK_2_Nms_per_rad = 40.0\nK_3_Nm = 1.0\n\
         inertia_kg_m2 = 0.1\noffset_A = 0.0\nsign_smoothing_rad_per_s = 0.02\n\
         low_pass_pole = 0.5\nsigma_Nm = 1.0\n",
        5.0 * gain
    );
    let text = JOINT.replace("6.0, 6.0", "1.5, 0.8") + &current;
    let mut bench = Bench::reading("test-joint", &calibrated(&text));
    bench.run(4000);
    bench.cycle.record().events[Event::SourcesDisagree.index()]
}

#[test]
fn a_lasting_disagreement_of_torsion_and_current_is_an_event_counted_once() {
    assert_eq!(disagreements(1.0), 0);
    assert_eq!(disagreements(-20.0), 1);
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
            JOINT.replace("= 0.05", "= 0.06"),
            "is for torque_constant_Nm_per_A = 0.06, this joint has 0.05",
        ),
        (
            JOINT.replace("= 524288", "= 262144"),
            "is for link_counts_per_turn = 262144, this joint has 524288",
        ),
        (
            JOINT.replace("= 4096", "= 8192"),
            "is for motor_counts_per_turn = 8192, this joint has 4096",
        ),
        (
            JOINT.replace("= 16.0", "= 1.0"),
            "is for torque_limit_Nm = 2.5, this joint has",
        ),
        (
            JOINT.replace("[compliance]", "[complaint]"),
            "unknown field `complaint`",
        ),
        (
            format!("{JOINT}[torsion_gain]\ngain = 3.0\nsigma = 0.1\n"),
            "torsion_gain.gain",
        ),
        (
            JOINT.replace("sources.current", "sources.network"),
            "fusion.sources.network: network is not switched on",
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

/// The test joint with an encoder's zero that is 2 mrad off: 14 N·m.
fn with_a_wrong_zero() -> Bench {
    let hysteresis = "[hysteresis]\nlinear_Nm_per_rad = 7000.0\ncubic_Nm_per_rad3 = 0.0\n\
        wind_up = []\nslipping = []\ntorsion_sigma_rad = 5e-5\n";
    let text = JOINT
        .replace("a0_rad = 0.0", "a0_rad = 2e-3")
        .replace("sources.compliance]", "sources.hysteresis]")
        .replace("[fusion]\n", &format!("{hysteresis}[fusion]\n"));
    let mut bench = Bench::reading("test-joint", &calibrated(&text));
    bench.run(600);
    bench
}

#[test]
fn a_joint_is_tared_to_a_known_torque() {
    let mut bench = with_a_wrong_zero();
    let error = |bench: &Bench| {
        let truth = bench.plant.truth().joints[0].tau;
        bench.cycle.record().estimated.joints[0].tau_encoder.tau - truth
    };
    assert!(error(&bench).abs() > 5.0, "{}", error(&bench));
    let mut settings = Settings {
        sequence: 1,
        ..Settings::default()
    };
    settings.joint_tares[0] = JointTare {
        torque: bench.plant.truth().joints[0].tau,
        sigma: 0.1,
        count: 1,
    };
    for _ in 0..200 {
        bench.step(&ClientInput {
            settings: Some(&settings),
            ..ClientInput::default()
        });
    }
    assert!(error(&bench).abs() < 0.3, "{}", error(&bench));
    // Once is enough: it is not tared again when the torque changes.
    // (The load is no part of the true torque.)
    bench.plant.robot_mut().set_load(0, 4.0);
    for _ in 0..500 {
        bench.step(&ClientInput {
            settings: Some(&settings),
            ..ClientInput::default()
        });
    }
    assert!((error(&bench) - 4.0).abs() < 1.0, "{}", error(&bench));
}

/// A mode may have changed the torque that was known: the tare does not take place.
#[test]
fn a_tare_is_dropped_where_a_mode_is_followed() {
    let mut bench = with_a_wrong_zero();
    let mut reference = bench.reference(Mode::InverseDynamics.number(), 1);
    reference.contact_wrench_given = 0;
    let mut settings = Settings::default();
    let error = |bench: &Bench| {
        let truth = bench.plant.truth().joints[0].tau;
        bench.cycle.record().estimated.joints[0].tau_encoder.tau - truth
    };
    for cycle in 0..300 {
        reference.sequence += 1;
        if cycle == 100 {
            settings.sequence = 1;
            settings.joint_tares[0] = JointTare {
                torque: bench.plant.truth().joints[0].tau,
                sigma: 0.1,
                count: 1,
            };
        }
        bench.step(&ClientInput {
            settings: Some(&settings),
            ..client_input(&reference)
        });
    }
    assert_eq!(bench.cycle.record().mode, Mode::InverseDynamics.number());
    assert!(error(&bench).abs() > 5.0, "{}", error(&bench));
}

/// A gear's past before the start is not known from torsion; the rigid-body model shows it.
#[test]
fn a_gear_s_past_is_shown_by_the_model() {
    const MEAN: u32 = 80;
    let hysteresis = "[hysteresis]\nlinear_Nm_per_rad = 6460.0\ncubic_Nm_per_rad3 = 0.0\nwind_up = []\n\
        slipping = [[5e-5, 1200.0], [1e-4, 600.0], [2e-4, 300.0], [4e-4, 150.0]]\ntorsion_sigma_rad = 1e-6\n\
        tracking_poles = [0.5, 0.9, 0.99]\ntracking_sigma_rad = 1e-5\n";
    let none = vec!["0.0"; 20].join(", ");
    let text = JOINT
        .replace("sources.compliance]", "sources.hysteresis]")
        .replace(
            "sigma_Nm = [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]",
            "sigma_Nm = [0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03]",
        )
        .replace(
            "rms_Nm = [0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3]",
            "rms_Nm = [0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03]",
        )
        .replace(
            "[fusion]\n",
            &format!("{hysteresis}uncertainty = [[{none}]]\n[fusion]\n"),
        );
    let sigmas = |past: &str| {
        let read = calibrated(&text);
        let start = format!("[start]\n{past}");
        let read = move |path: &str| match path {
            "config/test-joint/sim.toml" => Ok(read(path)?.replace("[start]\n", &start)),
            _ => read(path),
        };
        let mut bench = Bench::reading("test-joint", &read);
        [20, 4840].map(|cycles| {
            bench.run(cycles);
            // A mean, as single samples differ by the encoders' noise.
            let (mut sum, mut sigma) = (0.0, 0.0);
            for _ in 0..MEAN {
                bench.run(1);
                let tau = bench.cycle.record().estimated.joints[0].tau_encoder;
                sum += tau.tau - bench.plant.truth().joints[0].tau;
                sigma = tau.sigma;
            }
            (sum / f64::from(MEAN), sigma)
        })
    };
    let [without, with] = ["", "gear_past = true\n"].map(sigmas);
    let apart = |k: usize| (without[k].0 - with[k].0).abs();
    assert!(apart(0) > 0.05, "{without:?} {with:?}");
    assert!(apart(1) < 0.5 * apart(0), "{without:?} {with:?}");
    assert!(with[1].1 < 0.8 * with[0].1, "{with:?}");
}
