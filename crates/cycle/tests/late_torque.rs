//! Mode torque of joints without a link-side encoder, which follow the torque of F/T sensors and IMU: a sensor that
//! errs moves no joint that stands, and is found by motor current; sound sensors are not.

use crate::common;

use common::motion::Motion;
use common::{Bench, FLOOR, client_input, read, spoil, spoil_ft};
use robot_config::slots;
use robot_state::{Event, JointReference, Mode, Reference, torque_flags};
use std::f64::consts::TAU;
use std::io;

const ROBOT: &str = "hrp2-like";
const KNEE: usize = 3;

/// A push on a link, N, while the robot swings.
fn push(link: &str, force: f64) -> String {
    format!(
        "\n[[push]]\nlink = \"{link}\"\nstart_s = 2.0\nduration_s = 0.4\nforce_N = [{force:.1}, 0.0, 0.0]\n"
    )
}

/// The robot's files with another seed and stiffness of the gears, and further surroundings.
fn files(
    seed: u64,
    stiffness: f64,
    surroundings: &str,
) -> impl Fn(&str) -> io::Result<String> + use<'_> {
    move |path: &str| {
        let mut text = read(path)?;
        if path.ends_with("hrp2-like/sim.toml") {
            text = text.replace("seed = 1\n", &format!("seed = {seed}\n"));
            text += surroundings;
        }
        if path.ends_with("hrp2-like/robot.toml") {
            let key = "K_fs0_Nm_per_rad = ";
            let lines = text.lines().map(|line| match line.strip_prefix(key) {
                Some(k) => format!("{key}{}", stiffness * k.parse::<f64>().unwrap()),
                None => line.to_owned(),
            });
            text = lines.collect::<Vec<_>>().join("\n");
        }
        Ok(text)
    }
}

/// A robot in mode torque with the torques that it carries, for `cycles`.
fn in_torque(mut bench: Bench, cycles: usize) -> (Bench, Reference) {
    bench.run(600);
    let mut reference = bench.reference(Mode::Torque.number(), 1);
    reference.contact_wrench_given = 0;
    let estimated = bench.cycle.record().estimated.joints;
    for (reference, joint) in reference.joints.iter_mut().zip(estimated) {
        reference.tau_d = joint.tau_whole_body.tau;
    }
    for _ in 0..cycles {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    assert_eq!(bench.cycle.record().mode, Mode::Torque.number());
    (bench, reference)
}

fn count(bench: &Bench, event: Event) -> u64 {
    bench.cycle.record().events[event.index()]
}

/// A change of the F/T sensor's axes in the `k`-th cycle.
type Lie = fn(&mut [f64; 6], usize);

#[test]
fn an_ft_sensor_that_errs_moves_no_joint_that_stands() {
    let lies: [(&str, Lie, bool); 6] = [
        (
            "reversed",
            |axes, _| axes.iter_mut().for_each(|x| *x = -*x),
            false,
        ),
        ("exchanged", |axes, _| axes.rotate_left(1), false),
        (
            "steps",
            |axes, _| (axes[2], axes[4]) = (axes[2] + 50.0, axes[4] + 5.0),
            false,
        ),
        ("steps far", |axes, _| axes[4] -= 60.0, true),
        ("drifts", |axes, k| axes[4] += 4e-3 * k as f64, false),
        ("drifts fast", |axes, k| axes[4] -= 0.08 * k as f64, true),
    ];
    for (what, lie, found) in lies {
        for cycles in [350, 2500] {
            let (mut bench, mut reference) = in_torque(Bench::new(ROBOT), cycles);
            let mut motion = Motion::of(&bench);
            for k in 0..1000 {
                bench.gather();
                spoil_ft(&mut bench, |axes| lie(axes, k));
                reference.sequence += 1;
                bench.compute(&client_input(&reference));
                motion.take(&bench);
            }
            motion.assert_small(&format!("F/T sensor {what} after {cycles} cycles"));
            if found {
                let events = count(&bench, Event::FtImplausible);
                assert!((1..=6).contains(&events), "{what}: {events} events");
                let torque = bench.cycle.record().estimated.joints[KNEE].tau_whole_body;
                assert_eq!(torque.flags & torque_flags::VALID, 0, "{what}");
            }
        }
    }
}

#[test]
fn in_motion_an_ft_sensor_that_errs_is_found_and_no_longer_followed() {
    for step in [40.0, -40.0] {
        let (mut bench, mut reference) = in_torque(Bench::new(ROBOT), 500);
        let start = reference;
        let limit = bench.robot.parameters.joints[KNEE].limits.velocity;
        let (mut fastest, mut moved, mut found) = (0.0_f64, 0.0_f64, None);
        for k in 0..1400_usize {
            bench.gather();
            if k >= 700 {
                spoil_ft(&mut bench, |axes| axes[4] += step);
            }
            // The client swings the knee, and knows its angle.
            let measured = bench.cycle.record().measured.joints[KNEE];
            let (sin, cos) = (TAU * 0.7 * k as f64 * 1e-3).sin_cos();
            let wanted = [0.15 * (1.0 - cos), 0.15 * TAU * 0.7 * sin];
            let from = start.joints[KNEE].q_d;
            reference.joints[KNEE].tau_d = start.joints[KNEE].tau_d
                + 150.0 * (from + wanted[0] - measured.q)
                + 15.0 * (wanted[1] - measured.dq);
            reference.sequence += 1;
            bench.compute(&client_input(&reference));
            let truth = bench.plant.truth().joints[KNEE];
            fastest = fastest.max(truth.dq.abs());
            match k {
                ..700 => {
                    moved = moved.max((truth.q - from).abs());
                    assert_eq!(count(&bench, Event::FtImplausible), 0, "cycle {k}");
                }
                _ if count(&bench, Event::FtImplausible) > 0 => _ = found.get_or_insert(k - 700),
                _ => {}
            }
        }
        assert!(moved > 0.1, "{moved} rad");
        assert!(found.is_some_and(|ms| ms < 100), "{step}: {found:?} ms");
        assert!(fastest < 0.5 * limit, "{step}: {fastest} rad/s");
        assert_eq!(bench.cycle.record().fault, 0);
    }
}

/// Every joint swings by inverse dynamics, with pushes; 5 seeds, gears 30 % softer and stiffer than configured.
#[test]
fn sound_sensors_are_not_found() {
    let cases = [
        (1, 1.0, String::new()),
        (2, 0.7, push("foot", 40.0)),
        (3, 1.3, push("foot", -40.0)),
        (4, 1.0, String::new()),
        // Where no sensor measures it: the mode goes on.
        (5, 1.0, push("knee_link", 60.0)),
    ];
    for (seed, stiffness, pushed) in cases {
        let mut bench = Bench::reading(ROBOT, &files(seed, stiffness, &pushed));
        let start = bench.follow();
        let mut reference = start;
        let amplitudes = [0.1, -0.1, -0.3, 0.4, -0.2, 0.1];
        for k in 0..3000 {
            // Whole turns in a second and a half.
            let w = TAU * if k < 1500 { 4.0 / 3.0 } else { 2.0 / 3.0 };
            let (sin, cos) = (w * f64::from(k % 1500) * 1e-3).sin_cos();
            let joints = reference.joints.iter_mut().zip(&start.joints);
            for ((joint, start), a) in joints.zip(amplitudes) {
                *joint = JointReference {
                    q_d: start.q_d + 0.5 * a * (1.0 - cos),
                    dq_d: 0.5 * a * w * sin,
                    ddq_d: 0.5 * a * w * w * cos,
                    ..JointReference::default()
                };
            }
            reference.contact_wrench_given = 0;
            reference.sequence += 1;
            let record = bench.step(&client_input(&reference));
            let followed = (0, Mode::InverseDynamics.number());
            assert_eq!(
                (record.fault, record.mode),
                followed,
                "seed {seed}, cycle {k}"
            );
        }
        let unmeasured = pushed.contains("knee_link");
        let events = count(&bench, Event::FtImplausible);
        assert!(unmeasured || events == 0, "seed {seed}: {events}");
    }
}

/// The foot on the floor: the knee presses it down by some 100 N more and less; 5 seeds.
#[test]
fn desired_torques_are_reached_and_held() {
    for (seed, stiffness) in [(1, 1.0), (2, 1.3), (3, 0.7), (4, 1.0), (5, 1.0)] {
        let bench = Bench::reading(ROBOT, &files(seed, stiffness, FLOOR));
        let (mut bench, mut reference) = in_torque(bench, 1);
        let load = reference.joints[KNEE].tau_d;
        let mut motion = Motion::of(&bench);
        let mut worst = [0.0_f64; 6];
        for k in 0..3500 {
            let share = 0.5 * (1.0 - (TAU * 0.4 * f64::from(k) * 1e-3).cos());
            reference.joints[KNEE].tau_d = load - 12.7 * share;
            reference.sequence += 1;
            let record = *bench.step(&client_input(&reference));
            let mode = Mode::Torque.number();
            assert_eq!((record.fault, record.mode), (0, mode), "cycle {k}");
            motion.take(&bench);
            for (j, worst) in worst.iter_mut().enumerate().filter(|_| k > 1000) {
                let error = bench.plant.truth().joints[j].tau - reference.joints[j].tau_d;
                *worst = worst.max(error.abs());
            }
        }
        motion.assert_small("torques of a foot on the floor");
        assert_eq!(count(&bench, Event::FtImplausible), 0, "seed {seed}");
        for (worst, joint) in worst.iter().zip(&bench.robot.parameters.joints) {
            // Without feedback friction alone makes an error of its own size, and the drive's stiffness more.
            let friction = joint.encoders.gear_ratio * joint.estimator.wave_generator.friction;
            assert!(
                *worst < 0.75 * friction,
                "seed {seed}, {}: {worst} of {friction}",
                joint.name
            );
        }
    }
}

#[test]
fn the_only_encoder_that_drifts_moves_its_joint_by_little() {
    for rate in [0.1, -0.05] {
        let (mut bench, reference) = in_torque(Bench::new(ROBOT), 350);
        let mut motion = Motion::of(&bench);
        for k in 0..500 {
            bench.gather();
            let drift = 100.0 * rate * 1e-3 * f64::from(k);
            spoil(&mut bench, KNEE, |values| {
                values[slots::motor_angle(KNEE)] += drift;
            });
            bench.compute(&client_input(&reference));
            motion.take(&bench);
        }
        motion.assert_small(&format!("drift of {rate} rad/s"));
        assert_ne!(bench.cycle.record().fault, 0, "{rate} rad/s");
    }
}
