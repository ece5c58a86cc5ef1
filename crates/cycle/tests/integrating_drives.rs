//! Drives whose velocity loop integrates (P-PI), in front of the whole cycle: known of, they follow motions as others
//! do, or are refused by name; unknown, they are named before anything moves.

use crate::common;

use common::{Bench, client_input, read};
use robot_config::torque_loops::refused_loops;
use robot_state::{Event, Mode};
use std::f64::consts::TAU;
use test_support::Random;

/// What is drawn of a kind of drive: integral time, s, and shares of stiffness and damping of the shipped position
/// loop.
#[derive(Clone, Copy, Debug)]
struct Drawn {
    time: f64,
    stiffness: f64,
    damping: f64,
}

/// T_i from 20 to 200 ms, gains from 0.3 to 3, both evenly by their logarithms. The velocity loop is the inner one of a
/// cascade: its gain is within 1.5 of what keeps the cascade's damping ratio.
fn draw(random: &mut Random) -> Drawn {
    let between = |x: f64, low: f64, high: f64| low * (high / low).powf(0.5 + 0.5 * x);
    let stiffness = between(random.symmetric(), 0.3, 3.0);
    Drawn {
        time: between(random.symmetric(), 0.02, 0.2),
        stiffness,
        damping: stiffness.sqrt() * between(random.symmetric(), 1.0 / 1.5, 1.5),
    }
}

/// A number of a line `key = number  # remark`, changed.
fn changed(line: &str, of: impl Fn(f64) -> f64) -> String {
    let (key, rest) = line.split_once(" = ").unwrap();
    let number: f64 = rest.split(' ').next().unwrap().parse().unwrap();
    format!("{key} = {}", of(number))
}

/// The text with the lines of each `[drive.NAME...]` changed by its number among the kinds of drives.
fn with_drives(text: &str, change: impl Fn(usize, &str) -> String) -> String {
    let mut names: Vec<String> = Vec::new();
    let mut lines = Vec::new();
    let mut of_drive = false;
    for line in text.lines() {
        if line.starts_with('[') {
            of_drive = line.starts_with("[drive.");
        }
        if let Some(name) = line.strip_prefix("[drive.") {
            let name = name.split(['.', ']']).next().unwrap().to_owned();
            if names.last() != Some(&name) {
                names.push(name);
            }
        }
        lines.push(if of_drive {
            change(names.len() - 1, line)
        } else {
            line.to_owned()
        });
    }
    lines.join("\n")
}

/// The leg with these drives; `known`: its configuration says what they are.
fn leg(drawn: &[Drawn], known: bool) -> Bench {
    Bench::reading("leg", &|path| {
        let text = read(path)?;
        Ok(match path {
            _ if path.ends_with("leg/sim.toml") => simulated(&text, drawn),
            _ if path.ends_with("leg/robot.toml") => configured(&text, drawn, known),
            _ => text,
        })
    })
}

fn simulated(text: &str, drawn: &[Drawn]) -> String {
    with_drives(text, |i, line| match line {
        _ if line.starts_with("K_4_A") => changed(line, |k| drawn[i].stiffness * k),
        _ if line.starts_with("K_5_A") => {
            let damped = changed(line, |d| drawn[i].damping * d);
            format!("{damped}\nintegral_time_ms = {}", 1e3 * drawn[i].time)
        }
        _ => line.to_owned(),
    })
}

/// The gear's part of K_tau stays. K_s and K_d are what the drive and its gear in series had of them.
fn configured(text: &str, drawn: &[Drawn], known: bool) -> String {
    let values = |key: &str| -> Vec<f64> {
        let lines = text.lines().filter(|line| line.starts_with(key));
        let number = |line: &str| line.split(' ').nth(2).unwrap().parse().unwrap();
        lines.map(number).collect()
    };
    let (gears, softness) = (values("K_fs0_Nm_per_rad"), values("K_tau_rad_per_Nm"));
    let k_tau = |i: usize| 1.0 / gears[i] + (softness[i] - 1.0 / gears[i]) / drawn[i].stiffness;
    let drives = with_drives(text, |i, line| match line {
        _ if line.starts_with("K_tau_rad") => changed(line, |_| k_tau(i)),
        _ if line.starts_with("K_v_s") => {
            let damped = changed(line, |k_v| k_v * drawn[i].damping / drawn[i].stiffness);
            if known {
                format!("{damped}\nintegral_time_ms = {}", 1e3 * drawn[i].time)
            } else {
                damped
            }
        }
        _ => line.to_owned(),
    });
    let mut joint = 0;
    let lines = drives.lines().map(
        |line| match line.strip_prefix("gains = { K_s_Nm_per_rad = ") {
            Some(rest) => {
                let k_s: f64 = rest.split(',').next().unwrap().parse().unwrap();
                let k_s = k_s * (softness[joint] / k_tau(joint)).min(1.0);
                joint += 1;
                format!(
                    "gains = {{ K_s_Nm_per_rad = {k_s}, K_d_Nms_per_rad = {} }}",
                    0.01 * k_s
                )
            }
            None => line.to_owned(),
        },
    );
    lines.collect::<Vec<_>>().join("\n")
}

/// Swings every joint for some seconds, then stands. Returns the fault, the largest error of the torque within the last
/// second of the motion over the torque limit, that of the position, rad, and the largest change of the torque while it
/// stands over the limit.
fn swing(bench: &mut Bench) -> (u32, f64, f64, f64) {
    bench.run(200);
    let mut reference = bench.reference(Mode::InverseDynamics.number(), 1);
    reference.contact_wrench_given = 0;
    let start: Vec<f64> = reference.joints.iter().map(|joint| joint.q_d).collect();
    let limits: Vec<f64> = (bench.robot.parameters.joints.iter())
        .map(|joint| joint.limits.torque)
        .collect();
    let (mut torque, mut angle) = (0.0_f64, 0.0_f64);
    let mut stands = vec![[f64::INFINITY, f64::NEG_INFINITY]; limits.len()];
    for k in 0..7000 {
        let t = (f64::from(k) * 1e-3).min(TAU);
        for (joint, start) in reference.joints.iter_mut().zip(&start) {
            joint.q_d = start + 0.05 * (1.0 - (2.0 * t).cos());
            joint.dq_d = if t < TAU { 0.1 * (2.0 * t).sin() } else { 0.0 };
            joint.ddq_d = if t < TAU { 0.2 * (2.0 * t).cos() } else { 0.0 };
        }
        reference.sequence += 1;
        bench.step(&client_input(&reference));
        let record = bench.cycle.record();
        let truth = bench.plant.truth();
        for (j, limit) in limits.iter().enumerate() {
            let (truth, asked) = (&truth.joints[j], &record.commanded.joints[j]);
            if (5000..6000).contains(&k) {
                torque = torque.max((truth.tau - asked.tau_d).abs() / limit);
                angle = angle.max((truth.q - reference.joints[j].q_d).abs());
            }
            if k >= 6600 {
                let [low, high] = &mut stands[j];
                (*low, *high) = (low.min(truth.tau / limit), high.max(truth.tau / limit));
            }
        }
    }
    let moved = stands.iter().map(|[low, high]| high - low);
    (
        bench.cycle.record().fault,
        torque,
        angle,
        moved.fold(0.0, f64::max),
    )
}

fn draws(seeds: std::ops::Range<u64>) -> Vec<Vec<Drawn>> {
    let of_leg = |seed| {
        let mut random = Random::new(seed);
        (0..6).map(|_| draw(&mut random)).collect()
    };
    seeds.map(of_leg).collect()
}

/// 42 drives on seven legs: none is refused here, and all are as good as those without an integral.
#[test]
fn drives_that_integrate_follow_motions() {
    for drawn in draws(1..8) {
        let mut bench = leg(&drawn, true);
        let refused = refused_loops(&bench.robot, "robot.toml");
        assert!(refused.is_empty(), "{drawn:.3?}: {refused:?}");
        let (fault, torque, angle, rest) = swing(&mut bench);
        let figures = format!("{drawn:.3?}: {fault}, {torque:.4}, {angle:.5} rad, {rest:.4}");
        assert_eq!(fault, 0, "{figures}");
        assert!(torque < 0.02 && angle < 1e-3 && rest < 0.006, "{figures}");
    }
}

/// Integrating drives of whose integral nothing is configured, held for a second: the leg is not let into a mode.
#[test]
fn drives_of_whose_integral_nobody_knows_are_named_before_anything_moves() {
    for drawn in draws(1..8) {
        let mut bench = leg(&drawn, false);
        let pose = |bench: &Bench| -> Vec<f64> {
            let joints = bench.plant.truth().joints.iter();
            joints.map(|joint| joint.q).collect()
        };
        bench.run(300);
        let before = pose(&bench);
        bench.run(700);
        let record = bench.cycle.record();
        let limits = bench
            .robot
            .parameters
            .joints
            .iter()
            .map(|joint| joint.limits.torque);
        let truth = bench.plant.truth();
        let loads: Vec<f64> = truth
            .joints
            .iter()
            .zip(limits)
            .map(|(joint, limit)| joint.tau / limit)
            .collect();
        let named = Event::DriveIntegrates.number();
        assert_eq!(record.fault, named, "{drawn:.3?}, loads {loads:.3?}");
        let _ = swing(&mut bench);
        let moved = pose(&bench)
            .iter()
            .zip(&before)
            .map(|(q, q_0)| (q - q_0).abs())
            .fold(0.0, f64::max);
        assert!(moved < 0.2_f64.to_radians(), "{drawn:.3?}: {moved} rad");
    }
}
