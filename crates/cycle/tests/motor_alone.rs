//! Joints without a link-side encoder: the angle by the explained torsion, the torque of F/T sensors and IMU,
//! control by it, and what becomes of both when a sensor fails.

use crate::common;

use common::motion::{Motion, state};
use common::{Bench, client_input, read, spoil};
use cycle::ClientInput;
use robot_config::slots;
use robot_state::{
    CycleRecord, Event, JointReference, Mode, Reference, RobotState, measured_flags, torque_flags,
    torque_source,
};
use std::f64::consts::TAU;
use std::io;

const ROBOT: &str = "hrp2-like";
const KNEE: usize = 3;

/// A client that swings every joint of the leg: the reference at a time since its start.
fn swing(reference: &mut Reference, start: &Reference, frequency: f64, t: f64) {
    let w = TAU * frequency;
    let (sin, cos) = (w * t).sin_cos();
    let amplitudes = [0.1, -0.1, -0.3, 0.4, -0.2, 0.1];
    reference.sequence += 1;
    reference.contact_wrench_given = 0;
    for ((joint, start), a) in reference
        .joints
        .iter_mut()
        .zip(&start.joints)
        .zip(amplitudes)
    {
        *joint = JointReference {
            q_d: start.q_d + 0.5 * a * (1.0 - cos),
            dq_d: 0.5 * a * w * sin,
            ddq_d: 0.5 * a * w * w * cos,
            ..JointReference::default()
        };
    }
}

/// Root mean squares over a swing, joint by joint, and what else happened.
struct Swing {
    /// Torque from F/T sensors and IMU less the truth of its instant, N·m, and the largest truth.
    torque: Vec<f64>,
    largest: Vec<f64>,
    /// Measured less true angle, and desired less true angle, rad.
    angle: Vec<f64>,
    position: Vec<f64>,
    last: CycleRecord,
}

fn swung(bench: &mut Bench, frequency: f64, cycles: usize) -> Swing {
    let start = bench.follow();
    let mut reference = start;
    let joints = bench.robot.parameters.joints.len();
    let zero = || vec![0.0; joints];
    let (mut torque, mut largest, mut angle, mut position) = (zero(), zero(), zero(), zero());
    let mut truth: Vec<Vec<f64>> = Vec::new();
    let settled = 500;
    for k in 0..cycles {
        swing(&mut reference, &start, frequency, k as f64 * 1e-3);
        let record = *bench.step(&client_input(&reference));
        assert_eq!(record.fault, 0, "cycle {k}");
        truth.push(bench.plant.truth().joints.iter().map(|j| j.tau).collect());
        for (j, real) in bench.plant.truth().joints.iter().enumerate() {
            let tau = record.estimated.joints[j].tau_whole_body;
            let delay = (tau.delay_s * 1e3).round() as usize;
            if k < settled {
                continue;
            }
            assert!(tau.flags & torque_flags::VALID != 0, "cycle {k}, joint {j}");
            torque[j] += (tau.tau - truth[k - delay][j]).powi(2);
            largest[j] = largest[j].max(real.tau.abs());
            angle[j] += (record.measured.joints[j].q - real.q).powi(2);
            position[j] += (reference.joints[j].q_d - real.q).powi(2);
        }
    }
    let rms = |sums: Vec<f64>| -> Vec<f64> {
        let mean = |sum: f64| (sum / (cycles - settled) as f64).sqrt();
        sums.into_iter().map(mean).collect()
    };
    Swing {
        torque: rms(torque),
        largest,
        angle: rms(angle),
        position: rms(position),
        last: *bench.cycle.record(),
    }
}

#[test]
fn torque_and_angle_are_as_good_as_with_link_encoders() {
    let with_links = swung(&mut Bench::new("leg"), 1.4, 2500);
    let alone = swung(&mut Bench::new(ROBOT), 1.4, 2500);
    for j in 0..alone.torque.len() {
        let largest = alone.largest[j];
        assert!(
            alone.torque[j] < 1.1 * with_links.torque[j] + 0.01 * largest,
            "torque {j}"
        );
        // 0.01 degrees, a hundred times the leg's counts; without the torsion the hip pitch has 0.02.
        assert!(alone.angle[j] < 2e-4, "angle {j}: {}", alone.angle[j]);
        // D Table 3 at the same K6: 3 to 42 mrad at most, of a swing as fast.
        assert!(
            alone.position[j] < 3e-3,
            "position {j}: {}",
            alone.position[j]
        );
        let joint = &alone.last.estimated.joints[j];
        assert_eq!(
            (joint.tau_encoder.source, joint.tau_encoder.flags),
            (torque_source::NONE, 0)
        );
        assert!(joint.tau_hat.flags & torque_flags::VALID != 0);
        assert_eq!(joint.tau_current.source, torque_source::CURRENT);
        let measured = &alone.last.measured.joints[j];
        let n = 100.0;
        assert!((measured.theta / n - measured.torsion - measured.q).abs() < 1e-12);
    }
}

#[test]
fn a_gear_of_another_stiffness_than_configured_neither_rings_nor_faults() {
    for factor in [0.7, 1.3] {
        let files = |path: &str| {
            let text = read(path)?;
            if !path.ends_with("hrp2-like/robot.toml") {
                return Ok(text);
            }
            let changed = text
                .lines()
                .map(|line| match line.split_once("K_fs0_Nm_per_rad = ") {
                    Some(("", k)) => {
                        format!("K_fs0_Nm_per_rad = {}", factor * k.parse::<f64>().unwrap())
                    }
                    _ => line.to_owned(),
                });
            Ok(changed.collect::<Vec<_>>().join("\n"))
        };
        let run = swung(&mut Bench::reading(ROBOT, &files), 1.4, 2500);
        for j in 0..run.position.len() {
            // A third of the torsion is unexplained; the torque control does not know the gear.
            assert!(run.angle[j] < 3e-4, "{factor} angle {j}: {}", run.angle[j]);
            let position = run.position[j];
            assert!(position < 3e-3, "{factor} position {j}: {position}");
        }
    }
}

#[test]
fn an_ft_sensor_that_falls_silent_ends_the_mode_and_moves_nothing() {
    for mode in [Mode::Torque, Mode::InverseDynamics] {
        let mut bench = Bench::new(ROBOT);
        bench.run(600);
        let mut reference = bench.reference(mode.number(), 1);
        reference.contact_wrench_given = 0;
        for (joint, estimated) in
            (reference.joints.iter_mut()).zip(&bench.cycle.record().estimated.joints)
        {
            joint.tau_d = estimated.tau_whole_body.tau;
        }
        for _ in 0..400 {
            reference.sequence += 1;
            assert_eq!(bench.step(&client_input(&reference)).mode, mode.number());
        }
        let mut motion = Motion::of(&bench);
        let before = *bench.cycle.record();
        for _ in 0..800 {
            bench.gather();
            bench.drop_answers(|frame| matches!(frame.id, 0x181 | 0x182));
            reference.sequence += 1;
            bench.compute(&client_input(&reference));
            motion.take(&bench);
        }
        let record = bench.cycle.record();
        assert_eq!((record.mode, record.fault), (Mode::Hold.number(), 0));
        assert_eq!(state(record), RobotState::Holding);
        motion.assert_small("F/T sensor silent");
        for (a, b) in before.measured.joints.iter().zip(&record.measured.joints) {
            assert!((a.torsion - b.torsion).abs() < 1e-4, "the torsion stays");
        }
    }
}

#[test]
fn no_false_angle_moves_a_joint_that_holds() {
    type Lie = fn(f64, usize) -> f64;
    let lies: [(&str, Lie, Option<Event>); 6] = [
        (
            "steps by 5 degrees",
            |theta, _| theta + 8.7,
            Some(Event::EncoderImplausible),
        ),
        (
            "steps by 0.5 degrees",
            |theta, _| theta + 0.87,
            Some(Event::EncoderImplausible),
        ),
        (
            "steps by 0.3 degrees",
            |theta, _| theta + 0.5,
            Some(Event::EncoderImplausible),
        ),
        ("drifts", |theta, k| theta + 0.01 * 1e-1 * k as f64, None),
        ("frozen", |_, _| 30.0, None),
        ("not a number", |_, _| f64::NAN, Some(Event::JointStale)),
    ];
    for (what, lie, event) in lies {
        for joint in [0, 2, KNEE] {
            let mut bench = Bench::new(ROBOT);
            bench.run(600);
            assert_eq!(state(bench.cycle.record()), RobotState::Holding);
            let frozen = bench.cycle.record().measured.joints[joint].theta;
            let mut motion = Motion::of(&bench);
            for k in 0..600 {
                bench.gather();
                spoil(&mut bench, joint, |values| {
                    let theta = &mut values[slots::motor_angle(joint)];
                    *theta = match what {
                        "frozen" => frozen,
                        _ => lie(*theta, k),
                    };
                    if theta.is_nan() {
                        // No angle at all: the frame carries another joint's.
                        *theta = 1e3;
                    }
                });
                bench.compute(&ClientInput::default());
                motion.take(&bench);
            }
            motion.assert_small(&format!("{what}, joint {joint}"));
            let record = bench.cycle.record();
            if let Some(event) = event.filter(|event| *event != Event::JointStale) {
                assert_eq!(record.fault, event.number(), "{what}, joint {joint}");
                assert!(record.measured.joints[joint].flags & measured_flags::IMPLAUSIBLE != 0);
            }
        }
    }
}

/// The leg's knee has both encoders, and the predictive law; its other joints have the motor's.
fn mixed(path: &str) -> io::Result<String> {
    let text = read(path)?;
    if path.ends_with("hrp2-like/drives.dbc") || path.ends_with("robot-models/hrp2-like/drives.dbc")
    {
        let leg = read("robot-models/leg/drives.dbc")?;
        let message = |text: &str| {
            let from = text.find("BO_ 260 KNEE_STATE").unwrap();
            let to = from + text[from..].find("\n\n").unwrap();
            text[from..to].to_owned()
        };
        return Ok(text.replace(&message(&text), &message(&leg)));
    }
    if !path.ends_with("hrp2-like/robot.toml") {
        return Ok(text);
    }
    let link = "link_angle = { signal = \"KNEE_STATE.link_angle\", offset_deg = -180.0 }\n";
    let knee = "current = { signal = \"KNEE_STATE.current\"";
    let changes = [
        (knee.to_owned(), format!("{link}{knee}")),
        (
            "K_tau_rad_per_Nm = 3.46069e-05".to_owned(),
            "K_tau_rad_per_Nm = 5.1e-05".to_owned(),
        ),
        (
            "K_p = 0.0, K_s_Nm_per_rad = 14448.0, K_d_Nms_per_rad = 144.5".to_owned(),
            "K_s_Nm_per_rad = 9804.0, K_d_Nms_per_rad = 98.0".to_owned(),
        ),
        (
            "law = \"proportional_integral\"".to_owned(),
            "law = \"predictive\"".to_owned(),
        ),
        (
            "torque_feedback = \"whole_body\"".to_owned(),
            "torque_feedback = \"levelled\"".to_owned(),
        ),
        (
            "motor_counts_per_turn = 4096".to_owned(),
            "motor_counts_per_turn = 4096\nlink_counts_per_turn = 524288".to_owned(),
        ),
    ];
    Ok(changes.iter().fold(text, |text, (from, to)| {
        assert!(text.contains(from.as_str()), "{from}");
        text.replace(from.as_str(), to)
    }))
}

#[test]
fn a_robot_may_have_joints_of_both_kinds() {
    let mut bench = Bench::reading(ROBOT, &mixed);
    let run = swung(&mut bench, 1.4, 2500);
    for (j, joint) in run.last.estimated.joints.iter().enumerate().take(6) {
        let by_encoders = joint.tau_encoder.flags & torque_flags::VALID != 0;
        assert_eq!(by_encoders, j == KNEE, "joint {j}");
        assert!(run.angle[j] < 2e-4, "angle {j}: {}", run.angle[j]);
        assert!(run.position[j] < 4e-3, "position {j}: {}", run.position[j]);
    }
    // Which sources a mode needs follows from both kinds.
    let torque = 1 << Mode::Torque.number();
    assert!(run.last.possible_modes & torque != 0);
}
