//! Simulated sensors with clocks of their own: in lock-step with the loop, and refused on CAN.

use crate::common;

use cycle::ClientInput;
use robot_state::measured_flags;
use std::process::Command;
use test_support::{project_path, read_project_file};
use torqued::bus::LockStep;
use torqued::bus::in_process::{VirtualClock, VirtualDeadline};
use torqued::control_loop::ControlLoop;
use torqued::real_time::Pace;

#[test]
fn sensors_with_own_clocks_are_refused_on_can() {
    let sim = read_project_file("config/leg/sim.toml").expect("sim.toml");
    let path = std::env::temp_dir().join(format!("torqued-sim-{}.toml", std::process::id()));
    let own = "[ft_sensor.sampling]\nsampled = \"when_sent\"\n";
    std::fs::write(&path, format!("{sim}\n{own}")).expect("written");
    let out = Command::new(env!("CARGO_BIN_EXE_torqued-sim"))
        .arg(project_path("config/leg/robot.toml"))
        .arg("--sim")
        .arg(&path)
        .output()
        .expect("runs");
    std::fs::remove_file(&path).expect("removed");
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{error}");
    assert!(
        error.contains("ft_sensor.sampling.sampled: on a CAN bus"),
        "{error}"
    );
    assert!(error.contains("allowed: \"at_sync\""), "{error}");
}

#[test]
fn a_cycle_does_not_wait_for_sensors_with_own_clocks() {
    let read = |path: &str| {
        let text = read_project_file(path)?;
        let own = "[imu]\nsampled = \"when_sent\"\nperiod_us = 1500\n";
        let is_config = path.ends_with("humanoid/robot.toml");
        Ok(if is_config {
            text.replace("[imu]\n", own)
        } else {
            text
        })
    };
    let robot = robot_config::load("config/humanoid/robot.toml", &read).expect("a robot");
    let mut sim = common::sim("humanoid");
    sim.imu.sampling.sampled = plant::parameters::Sampled::WhenSent;
    sim.imu.sampling.period = Some(1.5e-3);
    let plant = common::plant(&robot, &sim);

    let clock = VirtualClock::new();
    clock.advance_to(1_000_000_000);
    let mut pace = VirtualDeadline::new(&clock, 1_000_000);
    let bus = LockStep::new(plant, &clock);
    let mut control_loop = ControlLoop::new(&robot, bus).expect("a loop");
    let mut ages = Vec::new();
    for cycle in 0..300 {
        let wake = pace.wait();
        let record = control_loop.run_cycle(&wake, &ClientInput::default());
        // With all answers there, no time passes in lock-step.
        assert_eq!(record.cycle.stamp_ns, wake.scheduled_ns);
        if cycle > 2 {
            assert_eq!(record.cycle.measured.imu.flags & measured_flags::MISSED, 0);
            ages.push(record.cycle.measured.imu.age_s);
        }
    }
    // Two samples in three cycles, with phases of 0 to 1.5 ms against SYNC.
    let newest = ages.iter().copied().fold(f64::INFINITY, f64::min);
    let oldest = ages.iter().copied().fold(0.0, f64::max);
    assert!(
        newest < 0.6e-3 && (0.9e-3..1.5e-3).contains(&oldest),
        "{newest} {oldest}"
    );
}
