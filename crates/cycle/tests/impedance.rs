//! Stiffness and damping that a client chooses while the robot runs.

use crate::common;

use common::motion::Motion;
use common::{Bench, client_input};
use robot_state::{Event, Mode, Reference};

/// Joint that is pushed: the knee of the leg, the only one of the test joint.
fn pushed(bench: &Bench) -> usize {
    let joints = bench.robot.parameters.joints.iter();
    joints
        .map(|j| j.name.as_str())
        .position(|name| name == "knee")
        .unwrap_or(0)
}

/// A robot that follows its own pose by inverse dynamics, and the reference.
fn following(name: &str) -> (Bench, Reference) {
    let mut bench = Bench::new(name);
    let mut reference = bench.follow();
    reference.contact_wrench_given = 0;
    run(&mut bench, &mut reference, 500);
    (bench, reference)
}

/// Cycles; returns the greatest change of the joint's true torque within 5 ms, N·m.
fn run(bench: &mut Bench, reference: &mut Reference, cycles: usize) -> f64 {
    let joint = pushed(bench);
    let mut torques = Vec::new();
    for _ in 0..cycles {
        reference.sequence += 1;
        bench.step(&client_input(reference));
        torques.push(bench.plant.truth().joints[joint].tau);
        let record = bench.cycle.record();
        assert_eq!(record.fault, 0, "{:?}", Event::from_number(record.fault));
    }
    let step = |pair: &[f64]| (pair[5] - pair[0]).abs();
    torques.windows(6).map(step).fold(0.0, f64::max)
}

fn angle(bench: &Bench) -> f64 {
    bench.plant.truth().joints[pushed(bench)].q
}

/// Pushed by a known torque, the joint gives way as far as its stiffness says.
#[test]
fn a_joint_is_as_stiff_as_asked() {
    let (mut bench, mut reference) = following("test-joint");
    let p = &bench.robot.parameters.joints[0];
    let (gains, push) = (p.gains, 0.08 * p.limits.torque);
    reference.gains_given = 1;
    for share in [1.0, 0.3, 0.1] {
        let joint = &mut reference.joints[0];
        joint.stiffness = share * gains.k_s;
        joint.damping = share.sqrt() * gains.k_d;
        run(&mut bench, &mut reference, 1500);
        let before = angle(&bench);
        bench.plant.robot_mut().set_load(0, push);
        run(&mut bench, &mut reference, 2500);
        let stiffness = push / (angle(&bench) - before);
        let error = stiffness / (share * gains.k_s) - 1.0;
        assert!(error.abs() < 0.15, "{share}: {:.0} % off", 100.0 * error);
        bench.plant.robot_mut().set_load(0, 0.0);
        run(&mut bench, &mut reference, 2500);
    }
}

/// A joint that was pushed away while it had no stiffness gets it back without a step in its torque.
#[test]
fn stiffness_comes_back_without_a_step() {
    let (mut bench, mut reference) = following("leg");
    let joint = pushed(&bench);
    let limit = bench.robot.parameters.joints[joint].limits.torque;
    let start = angle(&bench);
    reference.gains_given = 1;
    for (desired, p) in reference
        .joints
        .iter_mut()
        .zip(&bench.robot.parameters.joints)
    {
        (desired.stiffness, desired.damping) = (p.gains.k_s, p.gains.k_d);
    }
    reference.joints[joint].stiffness = 0.0;
    run(&mut bench, &mut reference, 1000);
    bench.plant.robot_mut().set_load(joint, 0.05 * limit);
    run(&mut bench, &mut reference, 600);
    bench.plant.robot_mut().set_load(joint, 0.0);
    run(&mut bench, &mut reference, 1000);
    let away = angle(&bench) - start;
    assert!(
        away.abs() > 0.5f64.to_radians(),
        "{:.2} deg",
        away.to_degrees()
    );
    // Given up: the configured gains again.
    reference.gains_given = 0;
    let step = run(&mut bench, &mut reference, 3000);
    assert!(
        step < 0.05 * limit,
        "{:.1} % of the limit",
        100.0 * step / limit
    );
    let rest = angle(&bench) - start;
    assert!(
        rest.abs() < 0.05f64.to_radians(),
        "{:.3} deg",
        rest.to_degrees()
    );
}

#[test]
fn gains_beyond_the_configured_ones_are_refused() {
    let changes: [fn(&mut Reference); 5] = [
        // All stiffness, no damping: as a client that forgets it.
        |r| r.joints[3].damping = 0.0,
        |r| r.joints[1].stiffness = 1e6,
        |r| r.joints[1].stiffness = -1.0,
        |r| r.joints[2].damping = 1e4,
        |r| r.joints[0].damping = f64::NAN,
    ];
    for change in changes {
        let (mut bench, mut reference) = following("leg");
        let mut motion = Motion::of(&bench);
        reference.gains_given = 1;
        for (desired, p) in reference
            .joints
            .iter_mut()
            .zip(&bench.robot.parameters.joints)
        {
            (desired.stiffness, desired.damping) = (p.gains.k_s, p.gains.k_d);
        }
        change(&mut reference);
        for _ in 0..300 {
            reference.sequence += 1;
            bench.step(&client_input(&reference));
            motion.take(&bench);
        }
        assert_eq!(bench.cycle.record().mode, Mode::Hold.number());
        motion.assert_small("refused gains");
    }
}
