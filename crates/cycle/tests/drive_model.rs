//! A drive whose position loop is not the configured one, as the loop notices it.

use crate::common;

use common::{Bench, client_input, read};
use robot_state::{Event, Mode};

/// The leg, whose drives' position loops are stiffer than configured by a factor, swinging gently for some seconds.
/// Its events 413.
fn events(factor: f64) -> u64 {
    let mut bench = Bench::reading("leg", &|path| {
        let text = read(path)?;
        Ok(if path.ends_with("leg/sim.toml") {
            text.lines().map(|line| stiffer(line, factor)).collect()
        } else {
            text
        })
    });
    let mut reference = bench.follow();
    let start: Vec<f64> = reference.joints.iter().map(|joint| joint.q_d).collect();
    for k in 0..8000 {
        let t = f64::from(k) * 1e-3;
        for (joint, start) in reference.joints.iter_mut().zip(&start) {
            joint.q_d = start + 0.05 * (1.0 - (2.0 * t).cos());
            joint.dq_d = 0.05 * 2.0 * (2.0 * t).sin();
        }
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    assert_eq!(bench.cycle.record().mode, Mode::InverseDynamics.number());
    bench.cycle.record().events[Event::DriveUnlike.index()]
}

fn stiffer(line: &str, factor: f64) -> String {
    match line.strip_prefix("K_4_A_per_rad = ") {
        Some(rest) => {
            let number: f64 = rest.split(' ').next().unwrap_or(rest).parse().unwrap();
            format!("K_4_A_per_rad = {}\n", factor * number)
        }
        None => format!("{line}\n"),
    }
}

/// A fifth is corrected; twice the stiffness is named, of every joint that shows it.
#[test]
fn a_drive_that_no_correction_makes_of_the_configured_one_is_named() {
    for factor in [0.8, 1.0, 1.2] {
        assert_eq!(events(factor), 0, "{factor}");
    }
    assert!(events(2.0) >= 1);
}
