//! Encoders and F/T sensors that drift slowly while nothing but a torque holds the joints, and hands, which are no drift.

use crate::common;

use common::motion::Motion;
use common::{Bench, client_input, spoil, spoil_ft};
use robot_config::slots;
use robot_state::{Event, Mode, Reference};

/// The leg, where it stands in a mode.
fn in_mode(mode: Mode) -> (Bench, Reference) {
    let mut bench = Bench::new("leg");
    bench.run(600);
    let hold = bench.reference(Mode::Hold.number(), 1);
    bench.step(&client_input(&hold));
    let mut reference = bench.reference(mode.number(), 2);
    let estimated = bench.cycle.record().estimated;
    for (joint, estimated) in reference.joints.iter_mut().zip(&estimated.joints) {
        joint.tau_d = estimated.tau_hat.tau;
    }
    // The level of F/T sensors is followed for 1.5 s after a motion.
    for _ in 0..1800 {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    assert_eq!(bench.cycle.record().mode, mode.number());
    (bench, reference)
}

/// Goes on while something changes with time, s.
fn go_on(mode: Mode, cycles: u32, change: impl Fn(&mut Bench, f64)) -> (Bench, Motion) {
    let (mut bench, mut reference) = in_mode(mode);
    let mut motion = Motion::of(&bench);
    for k in 0..cycles {
        reference.sequence += 1;
        bench.gather();
        change(&mut bench, 1e-3 * f64::from(k));
        bench.compute(&client_input(&reference));
        motion.take(&bench);
    }
    (bench, motion)
}

fn drifts(bench: &Bench) -> u64 {
    bench.cycle.record().events[Event::TorqueDrift.index()]
}

/// Drifts that nothing tells from a load within half a second. The slower one is, the further a joint without weight
/// has moved before its torque shows it: see docs/safety.md.
#[test]
fn an_encoder_that_drifts_slowly_moves_a_joint_by_a_few_degrees() {
    for mode in [Mode::Torque, Mode::Passive] {
        for (joint, rate) in [(2, -0.02), (3, 0.02), (3, -0.04), (5, 0.03)] {
            for side in ["link", "motor"] {
                let rate = f64::to_radians(rate);
                let (bench, motion) = go_on(mode, 1500, |bench, time| {
                    spoil(bench, joint, |values| match side {
                        "link" => values[slots::link_angle(joint)] += rate * time,
                        _ => values[slots::motor_angle(joint)] -= 100.0 * rate * time,
                    });
                });
                let (way, speed) = (motion.displacement_deg(), motion.speed_share());
                let what = format!("{mode:?}, joint {joint}, {side}: {way:.2} deg, {speed:.3}");
                assert!(way < 4.5 && speed < 0.1, "{what}");
                assert_eq!(bench.cycle.record().mode, Mode::Hold.number(), "{what}");
            }
        }
    }
}

#[test]
fn an_ft_sensor_that_drifts_moves_hardly_anything() {
    for mode in [Mode::Torque, Mode::Passive] {
        for axis in 0..6 {
            for (rate, cycles) in [(3.0, 800), (20.0, 3000)] {
                let (bench, motion) = go_on(mode, cycles, |bench, time| {
                    spoil_ft(bench, |values| values[axis] += rate * time);
                });
                let way = motion.displacement_deg();
                let what = format!("{mode:?}, axis {axis}: {rate} a second: {way:.3} deg");
                assert!(way < 0.5, "{what}");
                assert_eq!(bench.cycle.record().fault, 0, "{what}");
                // One that drifts faster is told by the change of its torque.
                assert!(drifts(&bench) > 0 || rate < 4.0 || axis > 2, "{what}");
            }
        }
    }
}

/// They move the joints as before: the motor's current shows that nothing drifts.
#[test]
fn hands_are_no_drifts() {
    // Share of the torque limit, and of it a second.
    for (mode, share, ramp) in [
        (Mode::Torque, 0.03, f64::INFINITY),
        (Mode::Torque, -0.1, f64::INFINITY),
        (Mode::Torque, 0.03, 0.1),
        (Mode::Passive, 0.03, f64::INFINITY),
        (Mode::Passive, 0.1, f64::INFINITY),
        (Mode::Passive, 0.03, 0.1),
        (Mode::Passive, 0.05, 0.05),
    ] {
        for joint in [3, 4] {
            let (bench, motion) = go_on(mode, 1500, |bench, time| {
                let limit = bench.robot.parameters.joints[joint].limits.torque;
                let load = f64::signum(share) * f64::abs(share).min(ramp * time) * limit;
                bench.plant.robot_mut().set_load(joint, load);
            });
            let what = format!("{mode:?}, joint {joint}, {share} by {ramp}");
            assert_eq!(drifts(&bench), 0, "{what}");
            let way = motion.displacement_deg();
            assert!(way > 5.0, "{what}: {way:.1} deg");
        }
    }
}
