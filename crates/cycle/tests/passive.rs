//! Mode passive where nobody touches the robot: no joint moves, whatever is known of its torque's level.

use crate::common;

use common::{Bench, client_input, read};
use robot_state::{Event, Mode};

/// A robot by its configuration, the calibrated one if so asked.
fn robot(name: &str, calibrated: bool, seed: u32) -> Bench {
    Bench::reading(name, &|path| {
        let uncalibrated = format!("config/{name}/robot.toml");
        if path.ends_with("sim.toml") {
            let text = read(path)?;
            assert!(text.contains("seed = 1\n"));
            return Ok(text.replace("seed = 1\n", &format!("seed = {seed}\n")));
        }
        if calibrated && path == uncalibrated {
            return read(&format!("config/{name}/calibrated.toml"));
        }
        read(path)
    })
}

/// Lets all joints go but those for whose names `is_held` is true; no joint moves by more than 1 degree.
fn assert_stays(mut bench: Bench, is_held: impl Fn(&str) -> bool, seconds: f64) {
    // The hand of the simulated lift has pushed by then.
    let name = bench.robot.parameters.name.clone();
    bench.run(if name == "lift-gripper" { 8000 } else { 1000 });
    let mut reference = bench.reference(Mode::Passive.number(), 1);
    let joints = bench.robot.parameters.joints.clone();
    let held = joints.iter().enumerate().filter(|(_, j)| is_held(&j.name));
    (reference.contact_wrench_given, reference.held_joints) =
        (0, held.fold(0, |bits, (j, _)| bits | 1 << j));
    let angles = |bench: &Bench| {
        bench
            .plant
            .truth()
            .joints
            .iter()
            .map(|j| j.q)
            .collect::<Vec<_>>()
    };
    let before = angles(&bench);
    let mut most = vec![0.0f64; before.len()];
    for _ in 0..(1000.0 * seconds) as usize {
        reference.sequence += 1;
        let record = bench.step(&client_input(&reference));
        let fault = Event::from_number(record.fault);
        assert_eq!(record.mode, Mode::Passive.number(), "{fault:?}");
        for ((most, now), before) in most.iter_mut().zip(angles(&bench)).zip(&before) {
            *most = most.max((now - before).abs());
        }
    }
    for (joint, most) in joints.iter().zip(&most) {
        let moved = joint.kind.threshold(1f64.to_radians());
        assert!(*most < moved, "{name} {}: {most} rad", joint.name);
    }
}

#[test]
fn a_joint_of_unknown_level_stays() {
    for seed in 1..=3 {
        assert_stays(robot("test-joint", false, seed), |_| false, 30.0);
    }
}

#[test]
fn a_calibrated_joint_stays() {
    assert_stays(robot("test-joint", true, 1), |_| false, 30.0);
}

#[test]
fn a_leg_stays() {
    assert_stays(robot("leg", false, 2), |_| false, 10.0);
}

#[test]
fn a_calibrated_leg_stays() {
    assert_stays(robot("leg", true, 2), |_| false, 10.0);
}

#[test]
fn a_lift_stays() {
    assert_stays(robot("lift-gripper", false, 2), |_| false, 10.0);
}

#[test]
fn a_calibrated_humanoids_arms_stay() {
    let is_arm = |name: &str| {
        ["shoulder", "elbow", "wrist"]
            .iter()
            .any(|part| name.contains(part))
    };
    assert_stays(robot("humanoid", true, 2), |name| !is_arm(name), 6.0);
}
