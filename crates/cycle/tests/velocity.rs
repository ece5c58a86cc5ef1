//! Mode velocity: joints follow streamed velocities, and come to rest before their position limits.

use crate::common;

use common::{Bench, client_input};
use robot_state::{Event, Mode, Reference, RobotState};

/// A robot that holds and has asked for hold, and its reference.
fn held(mut bench: Bench) -> (Bench, Reference) {
    bench.run(400);
    let mut reference = bench.reference(Mode::Hold.number(), 1);
    for _ in 0..20 {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    reference.mode = Mode::Velocity.number();
    for joint in &mut reference.joints {
        joint.dq_d = 0.0;
    }
    (bench, reference)
}

/// Cycles with the reference sent anew; greatest speed of a joint over its velocity limit.
fn run(bench: &mut Bench, reference: &mut Reference, cycles: usize) -> f64 {
    let mut speed = 0.0_f64;
    for _ in 0..cycles {
        reference.sequence += 1;
        bench.step(&client_input(reference));
        let joints = bench.plant.truth().joints.iter();
        for (joint, p) in joints.zip(&bench.robot.parameters.joints) {
            speed = speed.max(joint.dq.abs() / p.limits.velocity);
        }
    }
    speed
}

/// The true velocity of a joint as a mean over 50 ms, rad/s.
fn velocity(bench: &mut Bench, reference: &mut Reference, joint: usize) -> f64 {
    let before = bench.plant.truth().joints[joint].q;
    run(bench, reference, 50);
    (bench.plant.truth().joints[joint].q - before) / 0.05
}

#[test]
fn a_joint_moves_as_fast_as_it_is_asked_to_and_the_others_stand() {
    for robot in ["leg", "hrp2-like"] {
        let (mut bench, mut reference) = held(Bench::new(robot));
        let start: Vec<f64> = bench.plant.truth().joints.iter().map(|j| j.q).collect();
        let p = &bench.robot.parameters.joints[0];
        let asked = 0.1 * p.limits.velocity;
        let sign = if p.limits.position_max - start[0] > start[0] - p.limits.position_min {
            1.0
        } else {
            -1.0
        };
        reference.joints[0].dq_d = sign * asked;
        run(&mut bench, &mut reference, 300);
        assert_eq!(
            bench.cycle.record().mode,
            Mode::Velocity.number(),
            "{robot}"
        );
        let moves = velocity(&mut bench, &mut reference, 0);
        assert!(
            (moves / (sign * asked) - 1.0).abs() < 0.1,
            "{robot}: {moves} of {asked}"
        );
        for (j, q) in start.iter().enumerate().skip(1) {
            let moved = (bench.plant.truth().joints[j].q - q).abs();
            assert!(moved < 0.01, "{robot}, joint {j}: {moved}");
        }
        // Back to rest, where it stays.
        reference.joints[0].dq_d = 0.0;
        run(&mut bench, &mut reference, 500);
        let before = bench.plant.truth().joints[0].q;
        run(&mut bench, &mut reference, 500);
        assert!(
            (bench.plant.truth().joints[0].q - before).abs() < 1e-3,
            "{robot}"
        );
        assert_eq!(bench.cycle.record().fault, 0, "{robot}");
    }
}

#[test]
fn every_joint_comes_to_rest_before_its_position_limit_and_leaves_it_again() {
    for sign in [1.0, -1.0] {
        let (mut bench, mut reference) = held(Bench::new("leg"));
        let n = bench.robot.parameters.joints.len();
        for (joint, p) in reference
            .joints
            .iter_mut()
            .zip(&bench.robot.parameters.joints)
        {
            joint.dq_d = sign * 0.3 * p.limits.velocity;
        }
        let speed = run(&mut bench, &mut reference, 6000);
        assert!(speed < 0.36, "{speed}");
        let record = *bench.cycle.record();
        assert_eq!((record.mode, record.fault), (Mode::Velocity.number(), 0));
        for j in 0..n {
            let limits = &bench.robot.parameters.joints[j].limits;
            let q = bench.plant.truth().joints[j].q;
            let left = if sign > 0.0 {
                limits.position_max - q
            } else {
                q - limits.position_min
            };
            assert!((-0.002..0.2).contains(&left), "joint {j}: {left} left");
        }
        for (joint, p) in reference
            .joints
            .iter_mut()
            .zip(&bench.robot.parameters.joints)
        {
            joint.dq_d = -sign * 0.1 * p.limits.velocity;
        }
        run(&mut bench, &mut reference, 500);
        for j in 0..n {
            let moves = velocity(&mut bench, &mut reference, j);
            assert!(-sign * moves > 0.0, "joint {j}: {moves}");
        }
    }
}

#[test]
fn velocities_that_jump_move_the_joints_smoothly_and_raise_no_event() {
    let (mut bench, mut reference) = held(Bench::new("leg"));
    let before = bench.cycle.record().events;
    for k in 0..40 {
        for (j, joint) in reference.joints.iter_mut().enumerate() {
            let limit = bench.robot.parameters.joints[j.min(5)].limits.velocity;
            joint.dq_d = if (k + j) % 2 == 0 { 0.2 } else { -0.2 } * limit;
        }
        run(&mut bench, &mut reference, 37);
    }
    let record = bench.cycle.record();
    assert_eq!(record.state, RobotState::Active.number());
    for event in [
        Event::ReferenceJump,
        Event::ReferenceLimit,
        Event::FollowingError,
    ] {
        assert_eq!(
            record.events[event.index()],
            before[event.index()],
            "{}",
            event.name()
        );
    }
}

#[test]
fn a_velocity_beyond_the_limit_is_refused_and_a_client_that_falls_silent_leaves_the_robot_holding()
{
    let (mut bench, mut reference) = held(Bench::new("leg"));
    let limit = bench.robot.parameters.joints[0].limits.velocity;
    reference.joints[0].dq_d = 1.1 * limit;
    run(&mut bench, &mut reference, 5);
    let record = bench.cycle.record();
    assert_eq!(record.mode, Mode::Hold.number());
    assert!(record.events[Event::ReferenceLimit.index()] > 0);

    let (mut bench, mut reference) = held(Bench::new("leg"));
    reference.joints[0].dq_d = 0.1 * limit;
    run(&mut bench, &mut reference, 300);
    bench.run(200);
    let before = bench.plant.truth().joints[0].q;
    bench.run(300);
    assert_eq!(bench.cycle.record().mode, Mode::Hold.number());
    assert!((bench.plant.truth().joints[0].q - before).abs() < 1e-3);
}

#[test]
fn a_joint_that_is_held_back_is_waited_for() {
    let (mut bench, mut reference) = held(Bench::new("leg"));
    let limits = bench.robot.parameters.joints[0].limits;
    let start = bench.plant.truth().joints[0].q;
    reference.joints[0].dq_d = 0.1 * limits.velocity;
    // Something stands in its way: as stiff as a load that is set once a cycle may be.
    let hold = |bench: &mut Bench, reference: &mut Reference, cycles: usize| {
        for _ in 0..cycles {
            let joint = &bench.plant.truth().joints[0];
            let load = -3e3 * (joint.q - start).max(0.0) - 20.0 * joint.dq;
            bench.plant.robot_mut().set_load(0, load);
            run(bench, reference, 1);
        }
    };
    hold(&mut bench, &mut reference, 3000);
    reference.joints[0].dq_d = 0.0;
    hold(&mut bench, &mut reference, 300);
    assert_eq!(bench.cycle.record().mode, Mode::Velocity.number());
    // Where it was led to meanwhile: in 3 s the desired position alone would have gone on by 0.3 s at the velocity limit.
    bench.plant.robot_mut().set_load(0, 0.0);
    run(&mut bench, &mut reference, 1000);
    let way = bench.plant.truth().joints[0].q - start;
    assert!(way < 0.02 * limits.velocity, "{way} rad");
}
