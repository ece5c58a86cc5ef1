//! The delay of commands, as the loop measures it.

mod common;

use common::{Bench, client_input, current_drive, read};
use robot_state::{Event, Mode};

/// The leg, with another delay of its commands.
fn leg(delay: &str) -> Bench {
    Bench::reading("leg", &|path| {
        let text = read(path)?;
        Ok(match path.ends_with("leg/sim.toml") {
            true => format!("{text}\n[transport]\n{delay}\n"),
            false => text,
        })
    })
}

/// Follows its own pose for so long that every joint has been measured twice.
fn measured(mut bench: Bench) -> Bench {
    let mut reference = bench.follow();
    let joints = bench.robot.parameters.joints.len();
    let start: Vec<f64> = reference.joints.iter().map(|joint| joint.q_d).collect();
    for k in 0..2050 * joints {
        let t = k as f64 * 1e-3;
        for (joint, start) in reference.joints.iter_mut().zip(&start) {
            joint.q_d = start + 0.03 * (1.0 - (2.0 * t).cos());
            joint.dq_d = 0.06 * (2.0 * t).sin();
        }
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    assert_eq!(
        bench.cycle.record().mode,
        Mode::InverseDynamics.number(),
        "{}",
        bench.cycle.record().fault
    );
    bench
}

fn raised(bench: &Bench) -> u64 {
    bench.cycle.record().events[Event::CommandDelay.index()]
}

/// Largest distance of a measured delay from the true one, in its standard deviations, over the joints.
fn worst(bench: &Bench, truth: f64) -> f64 {
    let record = bench.cycle.record();
    let joints = bench
        .robot
        .parameters
        .joints
        .iter()
        .zip(&record.commanded.joints);
    joints.fold(0.0, |worst, (p, joint)| {
        assert!(joint.command_delay_sigma_s > 0.0, "{}: not known", p.name);
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
