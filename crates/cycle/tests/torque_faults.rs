//! Mode torque, in which nothing but the torque that is believed holds a joint: faults that change what
//! is believed, and loads that are let go.

use crate::common;

use common::motion::Motion;
use common::{Bench, client_input, spoil, spoil_ft};
use robot_config::slots;
use robot_state::{Event, Mode, Reference};

const KNEE: usize = 3;
const ANKLE_ROLL: usize = 5;

/// A leg in mode torque with the torques that it carries; `load`: share of the knee's torque limit.
fn in_torque(load: f64) -> (Bench, Reference) {
    let mut bench = Bench::new("leg");
    let limit = bench.robot.parameters.joints[KNEE].limits.torque;
    bench.plant.robot_mut().set_load(KNEE, load * limit);
    bench.run(500);
    let mut reference = bench.reference(Mode::Torque.number(), 1);
    let estimated = bench.cycle.record().estimated.joints;
    for (reference, joint) in reference.joints.iter_mut().zip(estimated) {
        reference.tau_d = joint.tau_whole_body.tau;
    }
    for _ in 0..350 {
        bench.step(&client_input(&reference));
    }
    assert_eq!(bench.cycle.record().mode, Mode::Torque.number());
    (bench, reference)
}

fn fault(bench: &Bench) -> Option<Event> {
    Event::from_number(bench.cycle.record().fault)
}

#[test]
fn encoders_that_slip_as_one_are_found_before_the_drive_answers() {
    for joint in [KNEE, ANKLE_ROLL] {
        for slip in [0.003, -0.0015] {
            let (mut bench, reference) = in_torque(0.0);
            let mut motion = Motion::of(&bench);
            for _ in 0..500 {
                bench.gather();
                spoil(&mut bench, joint, |values| {
                    values[slots::link_angle(joint)] += slip;
                    values[slots::motor_angle(joint)] += 100.0 * slip;
                });
                bench.compute(&client_input(&reference));
                motion.take(&bench);
            }
            let what = format!("joint {joint} slips by {slip} rad");
            assert_eq!(fault(&bench), Some(Event::EncoderImplausible), "{what}");
            motion.assert_small(&what);
        }
    }
}

#[test]
fn encoders_that_drift_as_one_are_found_by_the_drives_torque() {
    for joint in [KNEE, ANKLE_ROLL] {
        for rate in [0.1, -0.05] {
            let (mut bench, reference) = in_torque(0.0);
            let mut motion = Motion::of(&bench);
            for k in 0..500 {
                bench.gather();
                let drift = rate * 1e-3 * f64::from(k);
                spoil(&mut bench, joint, |values| {
                    values[slots::link_angle(joint)] += drift;
                    values[slots::motor_angle(joint)] += 100.0 * drift;
                });
                bench.compute(&client_input(&reference));
                motion.take(&bench);
            }
            let what = format!("joint {joint} drifts by {rate} rad/s");
            assert!(fault(&bench).is_some(), "{what}");
            motion.assert_small(&what);
        }
    }
}

/// A change of the F/T sensor's axes in the `k`-th cycle.
type Lie = fn(&mut [f64; 6], usize);

#[test]
fn an_ft_sensor_that_fails_does_not_move_a_joint_that_stands() {
    let lies: [(&str, Lie); 4] = [
        ("reversed", |axes, _| axes.iter_mut().for_each(|x| *x = -*x)),
        ("steps", |axes, _| {
            (axes[2], axes[4]) = (axes[2] + 50.0, axes[4] - 5.0)
        }),
        ("drifts", |axes, k| axes[4] += 4e-3 * k as f64),
        ("exchanged", |axes, _| axes.rotate_left(1)),
    ];
    for (what, lie) in lies {
        let (mut bench, reference) = in_torque(0.0);
        let mut motion = Motion::of(&bench);
        for k in 0..1000 {
            bench.gather();
            spoil_ft(&mut bench, |axes| lie(axes, k));
            bench.compute(&client_input(&reference));
            motion.take(&bench);
        }
        motion.assert_small(&format!("F/T sensor {what}"));
    }
}

/// The joint has to move, as the torque that carried the load is still asked for.
#[test]
fn a_load_that_is_let_go_moves_the_joint_no_faster_than_mode_torque_may() {
    let (mut bench, reference) = in_torque(0.2);
    let most = bench.robot.parameters.joints[KNEE].torque_velocity;
    assert_eq!(most, 1.0, "a quarter of the velocity limit");
    bench.plant.robot_mut().set_load(KNEE, 0.0);
    let mut fastest: f64 = 0.0;
    for _ in 0..500 {
        bench.step(&client_input(&reference));
        fastest = fastest.max(bench.plant.truth().joints[KNEE].dq.abs());
    }
    assert!(fastest > 0.5 * most, "{fastest} rad/s");
    assert!(fastest < 1.2 * most, "{fastest} rad/s");
    assert!(bench.cycle.record().events[Event::VelocityLimit.index()] > 0);
}
