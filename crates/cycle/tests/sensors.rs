//! Sensors whose values stay the same or stand at the ends of their ranges end the modes that need
//! them; healthy ones, at rest and in motion, are never taken for such.

use crate::common;

use can_codec::Frame;
use common::motion::{Motion, state};
use common::{Bench, client_input, read};
use cycle::ClientInput;
use robot_config::slots;
use robot_state::{Event, Mode, Reference, RobotState};

/// The robot with another feedback of torque.
fn bench(robot: &str, feedback: &str) -> Bench {
    let of_robot = format!("config/{robot}/robot.toml");
    Bench::reading(robot, &|path| {
        let text = read(path)?;
        let wanted = format!("torque_feedback = \"{feedback}\"");
        Ok(if path == of_robot {
            text.replace("torque_feedback = \"whole_body\"", &wanted)
        } else {
            text
        })
    })
}

/// Runs the robot until it follows a reference of its pose and torques in this mode.
fn following(bench: &mut Bench, mode: Mode) -> Reference {
    bench.run(600);
    let mut reference = bench.reference(mode.number(), 1);
    let estimated = bench.cycle.record().estimated.joints;
    for (joint, estimate) in reference.joints.iter_mut().zip(estimated) {
        joint.tau_d = estimate.tau_encoder.tau;
    }
    for _ in 0..20 {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    assert_eq!(bench.cycle.record().mode, mode.number());
    reference
}

/// One cycle in which `change` sees every decoded answer with this slot, by its values.
fn step_with(
    bench: &mut Bench,
    input: &ClientInput<'_>,
    slot: usize,
    change: &mut dyn FnMut(&mut [f64]),
) {
    bench.gather();
    let table = bench.robot.receive.clone();
    let mut values = vec![0.0; slots::receive_len(&bench.robot.parameters)];
    let frames: Vec<Frame> = bench.rx.iter().copied().collect();
    bench.rx.clear();
    for mut frame in frames {
        if let Ok(Some(message)) = table.decode(&frame, &mut values)
            && table.slots(message).any(|s| s == slot)
        {
            let stamp_ns = frame.stamp_ns;
            change(&mut values);
            assert!(table.encode(message, &values, &mut frame));
            frame.stamp_ns = stamp_ns;
        }
        bench.rx.push(frame);
    }
    bench.compute(input);
}

fn count(bench: &Bench, event: Event) -> u64 {
    bench.cycle.record().events[event.index()]
}

/// Cycles until the robot no longer follows, while the slot keeps the value that it first has.
fn freeze(bench: &mut Bench, reference: &mut Reference, slot: usize, cycles: usize) -> usize {
    let mut frozen = None;
    let mut ended = cycles;
    for cycle in 0..cycles {
        reference.sequence += 1;
        let input = client_input(reference);
        step_with(bench, &input, slot, &mut |values| {
            values[slot] = *frozen.get_or_insert(values[slot]);
        });
        if bench.cycle.record().mode == Mode::Hold.number() {
            ended = ended.min(cycle);
        }
    }
    ended
}

#[test]
fn a_flat_sensor_ends_the_modes_that_need_it() {
    for (robot, slot, subject) in [
        ("leg", slots::ft(0, 2), 2 << 16),
        ("humanoid", slots::ft(1, 4), 2 << 16 | 1),
        ("humanoid", slots::gyro(0, 1), 3 << 16),
        ("humanoid", slots::accelerometer(0, 2), 3 << 16),
    ] {
        let mut bench = bench(robot, "whole_body");
        let mut reference = following(&mut bench, Mode::InverseDynamics);
        let mut motion = Motion::of(&bench);
        let all = bench.cycle.record().possible_modes;
        assert_eq!(all & 0b1111, 0b1111, "{all:b}");
        let ended = freeze(&mut bench, &mut reference, slot, 3000);
        motion.take(&bench);
        let what = format!("{robot}, slot {slot} flat, subject {subject:#x}");
        assert!(ended < 500, "{what}: followed for {ended} cycles");
        assert_eq!(count(&bench, Event::SensorFlat), 1, "{what}");
        assert_eq!(bench.cycle.record().possible_modes, 0b0001, "{what}");
        assert_eq!(bench.cycle.record().fault, 0, "{what}");
        motion.assert_small(&what);
        // Alive again.
        bench.run(300);
        assert_eq!(bench.cycle.record().possible_modes, all, "{what}");
    }
}

#[test]
fn a_saturated_sensor_ends_the_modes_that_need_it() {
    for (robot, slot, end) in [
        ("leg", slots::ft(0, 2), 1e9),
        ("humanoid", slots::ft(0, 3), -1e9),
        ("humanoid", slots::accelerometer(0, 0), 1e9),
    ] {
        let mut bench = bench(robot, "whole_body");
        let mut reference = following(&mut bench, Mode::InverseDynamics);
        let mut motion = Motion::of(&bench);
        for _ in 0..300 {
            reference.sequence += 1;
            let input = client_input(&reference);
            step_with(&mut bench, &input, slot, &mut |values| values[slot] = end);
            motion.take(&bench);
        }
        let what = format!("{robot}, slot {slot} saturated");
        assert_eq!(count(&bench, Event::SensorSaturated), 1, "{what}");
        assert_eq!(count(&bench, Event::SensorFlat), 0, "{what}");
        let record = bench.cycle.record();
        assert_eq!(state(record), RobotState::Holding, "{what}");
        let cause = record.commander.cause;
        assert_eq!(cause, Event::SensorSaturated.number(), "{what}");
        motion.assert_small(&what);
    }
}

#[test]
fn a_flat_current_ends_the_modes_that_feed_back_the_torque_from_encoders() {
    let mut bench = bench("leg", "encoder");
    let mut reference = following(&mut bench, Mode::Torque);
    let ended = freeze(&mut bench, &mut reference, slots::current(3), 1000);
    assert!(ended < 500, "followed for {ended} cycles");
    assert_eq!(count(&bench, Event::CurrentImplausible), 1);
    assert_eq!(bench.cycle.record().fault, 0);
}

#[test]
fn healthy_sensors_are_never_flat_or_saturated() {
    for robot in ["test-joint", "leg", "humanoid"] {
        let mut bench = bench(robot, "whole_body");
        bench.run(1000);
        let mut reference = bench.follow();
        let q0: Vec<f64> = reference.joints.iter().map(|j| j.q_d).collect();
        let w = std::f64::consts::TAU;
        for k in 0..2000 {
            let t = f64::from(k) * 1e-3;
            let names = bench.robot.parameters.joints.iter().map(|j| &j.name);
            for ((joint, q0), name) in reference.joints.iter_mut().zip(&q0).zip(names) {
                // The humanoid stands on its legs.
                if robot == "humanoid" && !(name.contains("shoulder") || name.contains("elbow")) {
                    continue;
                }
                joint.q_d = q0 + 0.02 * (1.0 - (w * t).cos());
                joint.dq_d = 0.02 * w * (w * t).sin();
            }
            reference.sequence += 1;
            bench.step(&client_input(&reference));
        }
        let record = bench.cycle.record();
        let counted = Event::ALL.iter().filter(|e| record.events[e.index()] > 0);
        let counted: Vec<&str> = counted.map(|e| e.name()).collect();
        let mode = Mode::InverseDynamics.number();
        assert_eq!(record.mode, mode, "{robot}: {counted:?}");
        for event in [
            Event::SensorFlat,
            Event::SensorSaturated,
            Event::CurrentImplausible,
        ] {
            assert_eq!(count(&bench, event), 0, "{robot}: {}", event.name());
        }
    }
}
