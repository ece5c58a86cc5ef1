//! The delay of commands, as the loop measures it.

use crate::common;

use common::{Bench, client_input, current_drive, read};
use robot_state::{Event, Mode};
use test_support::Random;

/// The leg, with another delay of its commands.
fn leg(delay: &str) -> Bench {
    Bench::reading("leg", &|path| {
        let text = read(path)?;
        Ok(if path.ends_with("leg/sim.toml") {
            format!("{text}\n[transport]\n{delay}\n")
        } else {
            text
        })
    })
}

/// Follows its own pose, swinging by an amplitude, rad, at a frequency, rad/s, for a time, s, or until the delays of
/// all joints are known; none if the robot does not stay in the mode.
fn moved(mut bench: Bench, (amplitude, w): (f64, f64), time: [f64; 2]) -> Option<Bench> {
    let mut reference = bench.follow();
    let joints = bench.robot.parameters.joints.len();
    let start: Vec<f64> = reference.joints.iter().map(|joint| joint.q_d).collect();
    let [least, most] = time.map(|t| (1e3 * t) as usize);
    for k in 0..most {
        let t = k as f64 * 1e-3;
        for (joint, start) in reference.joints.iter_mut().zip(&start) {
            joint.q_d = start + amplitude * (1.0 - (w * t).cos());
            joint.dq_d = amplitude * w * (w * t).sin();
        }
        reference.sequence += 1;
        bench.step(&client_input(&reference));
        let mut shown = bench.cycle.record().commanded.joints.iter().take(joints);
        if k >= least && shown.all(|joint| joint.command_delay_sigma_s > 0.0) {
            break;
        }
    }
    let record = bench.cycle.record();
    (record.mode == Mode::InverseDynamics.number()).then_some(bench)
}

/// So long that most joints have been measured twice.
fn measured(bench: Bench) -> Bench {
    moved(bench, (0.03, 4.0), [40.0, 60.0]).expect("the mode lasts")
}

fn raised(bench: &Bench) -> u64 {
    bench.cycle.record().events[Event::CommandDelay.index()]
}

/// Largest distance of a measured delay from the true one, in its standard deviations, over the joints whose delays
/// are known: most of them, as a joint that hardly moves its drive need not show it.
fn worst(bench: &Bench, truth: f64) -> f64 {
    let joints = bench.robot.parameters.joints.len();
    let shown = &bench.cycle.record().commanded.joints[..joints];
    let known = shown.iter().filter(|j| j.command_delay_sigma_s > 0.0);
    let count = known.clone().count();
    assert!(3 * count >= 2 * joints, "{count} of {joints} known");
    known.fold(0.0, |worst, joint| {
        let off = joint.command_delay_s - truth;
        worst.max(off.abs() / joint.command_delay_sigma_s)
    })
}

/// The configured delay is one period to the drive and 0.4 ms within it.
#[test]
fn the_delay_is_measured() {
    let bench = measured(leg("delay_us = 1000"));
    let worst = worst(&bench, 1.4e-3);
    assert!(worst < 2.5, "{worst:.1} standard deviations");
    assert_eq!(raised(&bench), 0);
}

#[test]
fn another_delay_is_noticed() {
    let bench = measured(leg("delay_us = 2500"));
    let worst = worst(&bench, 2.9e-3);
    assert!(worst < 2.5, "{worst:.1} standard deviations");
    assert!(raised(&bench) > 0);
}

/// Also of a drive that takes currents; lost commands are no delay.
#[test]
fn lost_commands_and_other_drives() {
    let bench = measured(leg("delay_us = 1000\nlost_per_cent = 1"));
    assert_eq!(raised(&bench), 0);
    let bench = measured(current_drive());
    assert!(worst(&bench, 1.1e-3) < 3.0);
    assert_eq!(raised(&bench), 0);
}

/// Every number of a key in the simulated drives, times a factor.
fn scaled(text: &str, key: &str, factor: f64) -> String {
    let line = |line: &str| match line.strip_prefix(&format!("{key} = ")) {
        Some(rest) => {
            let (number, comment) = rest.split_once(' ').unwrap_or((rest, ""));
            let number: f64 = number.parse().unwrap();
            format!("{key} = {} {comment}\n", factor * number)
        }
        None => format!("{line}\n"),
    };
    text.lines().map(line).collect()
}

/// Drives, delays and motions drawn at random: how many joints' delays were known, and how many of these are within
/// 1.96 standard deviations.
fn family(seeds: std::ops::Range<u64>) -> (usize, usize) {
    let (mut known, mut covered) = (0, 0);
    for seed in seeds {
        let mut random = Random::new(seed);
        let mut between = |low: f64, high: f64| low + (high - low) * random.unit();
        let delay = between(0.0, 3.0);
        let factors = [
            ("dead_zone_rad", between(0.0, 3.0)),
            ("coulomb_Nm", between(0.3, 3.0)),
            ("static_ratio", between(0.8, 1.5)),
            ("current_noise_A", between(0.2, 4.0)),
            ("motor_noise_counts", between(0.0, 4.0)),
            ("link_noise_counts", between(0.0, 3.0)),
            ("current_loop_us", between(0.5, 2.0)),
        ];
        let motion = (between(0.0, 0.05), between(0.5, 15.0));
        let robot = Bench::reading("leg", &|path| {
            let text = read(path)?;
            Ok(if path.ends_with("leg/sim.toml") {
                let text = text.replace("seed = 1\n", &format!("seed = {seed}\n"));
                let scale = |text: String, (key, factor): &(&str, f64)| scaled(&text, key, *factor);
                let text = factors.iter().fold(text, scale);
                format!("{text}\n[transport]\ndelay_us = {}\n", 1e3 * delay)
            } else {
                text
            })
        });
        let Some(bench) = moved(robot, motion, [12.0, 12.0]) else {
            continue;
        };
        let joints = bench.cycle.record().commanded.joints.iter();
        for joint in joints.take(bench.robot.parameters.joints.len()) {
            if joint.command_delay_sigma_s == 0.0 {
                continue;
            }
            known += 1;
            let off = (joint.command_delay_s - 1e-3 * (delay + 0.4)) / joint.command_delay_sigma_s;
            covered += usize::from(off.abs() < 1.96);
        }
    }
    (known, covered)
}

/// Intervals hold whatever the drives and the motion are like.
#[test]
fn intervals_cover_the_truth() {
    let (known, covered) = family(0..3);
    assert!(known >= 4, "{known} known");
    assert!(
        covered as f64 >= 0.95 * known as f64,
        "{covered} of {known}"
    );
}

/// More cases of the measured delay: minutes.
#[test]
#[ignore = "minutes"]
fn intervals_cover_the_truth_of_many() {
    let (known, covered) = family(100..160);
    assert!(
        covered as f64 >= 0.95 * known as f64,
        "{covered} of {known}"
    );
}
