//! Prismatic joints and joints that follow others, on robots drawn at random around lift-gripper: torque and
//! control by the plant's truth.

use crate::common;

use common::{Bench, client_input, read};
use robot_state::{JointReference, Mode, Reference, torque_flags};
use std::f64::consts::TAU;
use std::io;
use test_support::Random;

const ROBOT: &str = "lift-gripper";
const SETTLED: usize = 600;

/// A number `key = value` in the tables that begin with `[table`, multiplied by a factor.
fn scaled(text: &str, table: &str, key: &str, factor: f64) -> String {
    let (mut inside, mut found) = (false, false);
    let lines = text.lines().map(|line| {
        if line.starts_with('[') {
            inside = line.starts_with(&format!("[{table}"));
        }
        let own = line.split_once('=').filter(|(name, _)| name.trim() == key);
        match own.filter(|_| inside) {
            Some((name, value)) => {
                found = true;
                let value: f64 = value.split('#').next().unwrap().trim().parse().unwrap();
                format!("{name}= {:e}", value * factor)
            }
            None => line.to_owned(),
        }
    });
    let text: Vec<String> = lines.collect();
    assert!(found, "{table} {key}");
    text.join("\n") + "\n"
}

/// A screw of another lead with the motor that makes the same force of the same current: what acts on the
/// joint stays as it is.
fn with_lead(path: &str, text: &str, drive: &str, share: f64) -> String {
    let of_motor: &[(&str, i32)] = if path.ends_with("sim.toml") {
        &[
            ("coulomb_Nm", 1),
            ("viscous_Nms_per_rad", 2),
            ("presliding_rad", -1),
            ("stribeck_rad_per_s", -1),
        ]
    } else {
        &[
            ("lead_mm_per_turn", 1),
            ("torque_constant_Nm_per_A", 1),
            ("rotor_inertia_kg_m2", 2),
            ("K_wg0_Nm_per_rad", 2),
            ("C_wg_per_Nm", -1),
            ("coulomb_Nm", 1),
            ("viscous_Nms_per_rad", 2),
            ("epsilon_rad_per_s", -1),
        ]
    };
    let table = format!("drive.{drive}");
    of_motor.iter().fold(text.to_owned(), |text, (key, power)| {
        scaled(&text, &table, key, share.powi(*power))
    })
}

/// lift-gripper with other leads, a lift that is tilted, a follower of another ratio, offset and mass.
fn random_robot(seed: u64) -> Bench {
    random_robot_with(seed, |sim| sim)
}

/// A random robot whose gripper takes hold of nothing.
fn random_robot_alone(seed: u64) -> Bench {
    random_robot_with(seed, |sim| {
        let (from, to) = (
            sim.find("# What the gripper").unwrap(),
            sim.find("[ft_sensor]").unwrap(),
        );
        format!("{}{}", &sim[..from], &sim[to..])
    })
}

/// `change`: of the simulation's file.
fn random_robot_with(seed: u64, change: impl Fn(String) -> String) -> Bench {
    let mut random = Random::new(seed);
    let mut between = |low: f64, high: f64| low + (high - low) * 0.5 * (1.0 + random.symmetric());
    let leads = [between(0.4, 4.0), between(0.4, 4.0)];
    let tilt = [between(-0.6, 0.6), between(-0.6, 0.6)];
    let (ratio, offset) = (between(-1.5, 1.5), between(-0.02, 0.02));
    let (mass, turned) = (between(0.1, 1.0), between(-1.5, 1.5));
    let files = |path: &str| -> io::Result<String> {
        let text = read(path)?;
        if path.ends_with("robot.urdf") {
            let follower = text.find("<joint name=\"finger_follower\"").unwrap();
            let (before, after) = text.split_at(follower);
            let lift = "<origin xyz=\"0.05 0 0.7\" rpy=\"0 0 0\"/>\n    <axis xyz=\"0 0 1\"/>";
            assert!(before.contains(lift) && after.contains("<mass value=\"0.12\"/>"));
            let axis = format!("<axis xyz=\"{} {} 1\"/>", tilt[0], tilt[1]);
            let before = before.replace(lift, &lift.replace("<axis xyz=\"0 0 1\"/>", &axis));
            let after = after
                .replace(
                    "rpy=\"0 0 0\"/>\n    <axis",
                    &format!("rpy=\"{turned} 0 0\"/>\n    <axis"),
                )
                .replace(
                    "multiplier=\"1\" offset=\"0\"",
                    &format!("multiplier=\"{ratio}\" offset=\"{offset}\""),
                )
                .replace(
                    "<mass value=\"0.12\"/>",
                    &format!("<mass value=\"{mass}\"/>"),
                );
            return Ok(before + &after);
        }
        if !path.ends_with(".toml") {
            return Ok(text);
        }
        let text = with_lead(path, &text, "lift", leads[0]);
        let text = with_lead(path, &text, "finger", leads[1]);
        Ok(if path.ends_with("sim.toml") {
            change(text)
        } else {
            text
        })
    };
    Bench::reading(ROBOT, &files)
}

/// Root mean squares of a joint's errors, and its largest torque.
#[derive(Debug, Default, Clone, Copy)]
struct Errors {
    largest: f64,
    whole_body: f64,
    compensated: f64,
    encoder: f64,
    position: f64,
}

/// The demo's kind of motion, faster, and how well torques and positions are those of the plant.
fn swung(bench: &mut Bench, cycles: usize) -> Vec<Errors> {
    let start = bench.follow();
    let mut reference = start;
    let amplitudes = [0.08, 0.4, 0.015];
    let mut truth: Vec<Vec<f64>> = Vec::new();
    let mut errors = vec![Errors::default(); amplitudes.len()];
    for k in 0..cycles {
        reference.sequence += 1;
        for (j, (joint, a)) in reference.joints.iter_mut().zip(amplitudes).enumerate() {
            let w = TAU * (0.5 + 0.1 * j as f64);
            let (sin, cos) = (w * k as f64 * 1e-3).sin_cos();
            *joint = JointReference {
                q_d: start.joints[j].q_d + 0.5 * a * (1.0 - cos),
                dq_d: 0.5 * a * w * sin,
                ddq_d: 0.5 * a * w * w * cos,
                ..JointReference::default()
            };
        }
        let record = *bench.step(&client_input(&reference));
        assert_eq!(record.fault, 0, "cycle {k}");
        let real = &bench.plant.truth().joints;
        truth.push(real.iter().map(|joint| joint.tau).collect());
        if k < SETTLED {
            continue;
        }
        for (j, (e, real)) in errors.iter_mut().zip(real).enumerate() {
            let joint = &record.estimated.joints[j];
            let error = |tau: &robot_state::TorqueEstimate, late: f64| {
                assert!(tau.flags & torque_flags::VALID != 0, "cycle {k}, joint {j}");
                (tau.tau - truth[k - (late * 1e3).round() as usize][j]).powi(2)
            };
            e.largest = e.largest.max(real.tau.abs());
            e.whole_body += error(&joint.tau_whole_body, joint.tau_whole_body.delay_s);
            e.encoder += error(&joint.tau_encoder, joint.tau_encoder.delay_s);
            e.compensated += error(&joint.tau_hat, 0.0);
            e.position += (reference.joints[j].q_d - real.q).powi(2);
        }
    }
    for e in &mut errors {
        for sum in [
            &mut e.whole_body,
            &mut e.compensated,
            &mut e.encoder,
            &mut e.position,
        ] {
            *sum = (*sum / (cycles - SETTLED) as f64).sqrt();
        }
    }
    errors
}

#[test]
fn torques_of_random_lifts_and_grippers_are_the_plants() {
    for seed in 0..6 {
        let mut bench = random_robot(seed);
        let errors = swung(&mut bench, 2200);
        // The boom, a revolute joint as those of the other robots, has 2.3, 1.8 and 3.5 %.
        for (joint, (e, rated)) in errors.iter().zip([300.0, 28.0, 50.0]).enumerate() {
            let scale = e.largest.max(0.1 * rated);
            assert!(
                e.whole_body < 0.03 * scale,
                "seed {seed} joint {joint}: {e:?}"
            );
            assert!(
                e.compensated < 0.04 * scale,
                "seed {seed} joint {joint}: {e:?}"
            );
            assert!(e.encoder < 0.1 * scale, "seed {seed} joint {joint}: {e:?}");
        }
        for (e, far) in errors.iter().zip([3e-4, 3e-3, 3e-4]) {
            assert!(e.position < far, "seed {seed}: {e:?}");
        }
    }
}

#[test]
fn what_acts_on_the_joint_does_not_depend_on_the_screws_lead() {
    let with = |share: f64| {
        let files = |path: &str| -> io::Result<String> {
            let text = read(path)?;
            if !path.ends_with(".toml") {
                return Ok(text);
            }
            // Errors that turn with the motor excite the link at frequencies by the lead.
            let lines = text.lines().map(|line| match line.split_once("motor_mm") {
                Some(("", _)) => String::new(),
                Some((before, _)) => format!("{} }}", before.trim_end().trim_end_matches(',')),
                None => line.replace("ripple_per_cent = 10", "ripple_per_cent = 0"),
            });
            let text: Vec<String> = lines.collect();
            Ok(with_lead(path, &text.join("\n"), "lift", share))
        };
        swung(&mut Bench::reading(ROBOT, &files), 1400)[0]
    };
    // Counts and ripples of the motor's turns differ, and nothing else.
    let (fine, coarse) = (with(0.5), with(2.0));
    assert!(
        (fine.largest / coarse.largest - 1.0).abs() < 0.03,
        "{fine:?} {coarse:?}"
    );
    assert!(
        (fine.encoder / coarse.encoder - 1.0).abs() < 0.3,
        "{fine:?} {coarse:?}"
    );
}

/// A client that asks for mode torque with the torques that the joints carry, after so many cycles.
fn in_torque(bench: &mut Bench, after: usize) -> Reference {
    bench.run(after);
    let mut reference = bench.reference(Mode::Torque.number(), 1);
    let estimated = bench.cycle.record().estimated.joints;
    for (reference, joint) in reference.joints.iter_mut().zip(estimated) {
        reference.tau_d = joint.tau_whole_body.tau;
    }
    bench.step(&client_input(&reference));
    assert_eq!(bench.cycle.record().mode, Mode::Torque.number());
    reference
}

#[test]
fn a_lift_in_mode_torque_stands_where_nobody_pushes_it() {
    for (seed, after) in [(21, 500), (22, 2000), (23, 500), (24, 800), (25, 300)] {
        let mut bench = random_robot_alone(seed);
        let reference = in_torque(&mut bench, after);
        let from: Vec<f64> = bench.plant.truth().joints.iter().map(|j| j.q).collect();
        for k in 0..4000 {
            bench.step(&client_input(&reference));
            for (j, (joint, from)) in bench.plant.truth().joints.iter().zip(&from).enumerate() {
                let way = (joint.q - from).abs();
                // The threshold of motion of a slide is a tenth, in m, of that of a hinge.
                let most = [8.7e-4, 8.7e-3, 8.7e-4][j];
                assert!(way < most, "seed {seed}, joint {j}, cycle {k}: {way}");
            }
        }
        assert_eq!(bench.cycle.record().fault, 0, "seed {seed}");
    }
}

/// Asked for more force for a while, and then for the one before.
#[test]
fn a_lift_in_mode_torque_that_was_moved_comes_to_rest() {
    for (seed, more) in [(31, 40.0), (32, -40.0), (33, 60.0)] {
        let mut bench = random_robot_alone(seed);
        let mut reference = in_torque(&mut bench, 800);
        let (from, tau_d) = (bench.plant.truth().joints[0].q, reference.joints[0].tau_d);
        for k in 0..2500 {
            let more = if (500..700).contains(&k) { more } else { 0.0 };
            reference.joints[0].tau_d = tau_d + more;
            bench.step(&client_input(&reference));
        }
        let lift = bench.plant.truth().joints[0];
        assert!((lift.q - from).abs() > 1e-3, "seed {seed}: {lift:?}");
        assert!(lift.dq.abs() < 1e-3, "seed {seed}: {lift:?}");
    }
}
