//! Configured reactions: an event ends the modes that need what failed, releases the robot, or
//! stops it, as `[safety.reactions]` says.

use crate::common;

use common::motion::{Motion, state};
use common::{Bench, client_input, read};
use cycle::ClientInput;
use robot_config::slots;
use robot_state::{CycleRecord, Event, Mode, Reference, RobotState};

/// A robot with another feedback of torque, other reactions, and a text at the end of its
/// simulation's file.
fn bench(robot: &str, feedback: &str, reactions: &str, simulation: &str) -> Bench {
    let of_robot = format!("config/{robot}/robot.toml");
    let of_sim = format!("config/{robot}/sim.toml");
    Bench::reading(robot, &|path| {
        let text = read(path)?;
        Ok(if path == of_robot {
            let wanted = format!("torque_feedback = \"{feedback}\"");
            let text = text
                .replace("law = \"predictive\"", "law = \"proportional_integral\"")
                .replace("torque_feedback = \"levelled\"", &wanted)
                .replace("gains = { ", "gains = { K_p = 0.0, ");
            assert!(text.contains(&wanted));
            format!("{text}\n[safety.reactions]\n{reactions}\n")
        } else if path == of_sim {
            text + simulation
        } else {
            text
        })
    })
}

fn mode(record: &CycleRecord) -> Mode {
    Mode::from_number(record.mode).unwrap()
}

/// Follows the reference in another mode for some cycles, without the answers that are `lost`.
fn follow(
    bench: &mut Bench,
    reference: &mut Reference,
    wanted: Mode,
    cycles: usize,
    lost: &[(u8, u32)],
) -> CycleRecord {
    reference.mode = wanted.number();
    for _ in 0..cycles {
        bench.gather();
        bench.drop_answers(|f| lost.contains(&(f.bus, f.id)));
        reference.sequence += 1;
        bench.compute(&client_input(reference));
    }
    *bench.cycle.record()
}

/// The messages that carry a receive slot.
fn messages(bench: &Bench, slot: usize) -> Vec<(u8, u32)> {
    let table = &bench.robot.receive;
    let carrying = (0..table.message_count()).filter(|&m| table.slots(m).any(|s| s == slot));
    carrying
        .filter_map(|m| table.message(m).map(|m| (m.bus, m.id)))
        .collect()
}

/// The robot holding, and a reference of the torques that it carries.
fn carried(bench: &mut Bench) -> Reference {
    bench.run(600);
    let mut reference = bench.reference(Mode::Hold.number(), 1);
    let estimated = bench.cycle.record().estimated.joints;
    for (joint, estimate) in reference.joints.iter_mut().zip(estimated) {
        joint.tau_d = estimate.tau_encoder.tau;
    }
    reference
}

#[test]
fn without_the_imu_only_modes_end_that_need_it() {
    let mut bench = bench("humanoid", "encoder", "", "");
    let imu = messages(&bench, slots::gyro(0, 0));
    let mut reference = carried(&mut bench);
    let record = follow(&mut bench, &mut reference, Mode::Torque, 20, &[]);
    assert_eq!(
        (mode(&record), record.possible_modes),
        (Mode::Torque, 0b11_0010_1111)
    );

    // Torque from encoders goes on without it.
    let record = follow(&mut bench, &mut reference, Mode::Torque, 100, &imu);
    assert_eq!(
        (mode(&record), record.possible_modes),
        (Mode::Torque, 0b0011)
    );
    assert_eq!(record.events[Event::SensorStale.index()], 1);
    let record = follow(&mut bench, &mut reference, Mode::InverseDynamics, 20, &imu);
    assert_eq!(mode(&record), Mode::Hold, "it needs the IMU");

    // Back again, it is possible.
    let record = follow(&mut bench, &mut reference, Mode::Hold, 300, &[]);
    assert_eq!(record.possible_modes, 0b11_0010_1111);
    let record = follow(&mut bench, &mut reference, Mode::InverseDynamics, 20, &[]);
    assert_eq!(mode(&record), Mode::InverseDynamics);
    follow(&mut bench, &mut reference, Mode::InverseDynamics, 100, &imu);
    let record = follow(&mut bench, &mut reference, Mode::InverseDynamics, 300, &[]);
    assert_eq!(
        (mode(&record), record.possible_modes),
        (Mode::Hold, 0b11_0010_1111),
        "the client has not asked for hold"
    );
    assert_eq!(record.fault, 0);
}

#[test]
fn a_silent_sensor_may_latch_a_fault_that_names_it() {
    let mut bench = bench("leg", "whole_body", "sensor_stale = \"stop\"", "");
    let foot = messages(&bench, slots::ft(0, 0));
    let mut reference = carried(&mut bench);
    follow(&mut bench, &mut reference, Mode::Hold, 10, &[]);
    let mut motion = Motion::of(&bench);
    let record = follow(&mut bench, &mut reference, Mode::Hold, 100, &foot);
    assert_eq!(state(&record), RobotState::Fault);
    assert_eq!(record.fault, Event::SensorStale.number());
    assert_eq!(record.fault_subject, 2 << 16, "the first F/T sensor");
    // Acknowledged without being mended, it is latched again.
    bench.gather();
    bench.drop_answers(|f| foot.contains(&(f.bus, f.id)));
    let request = cycle::OperatorRequest::Acknowledge(record.fault);
    bench.compute(&ClientInput {
        request: Some(request),
        ..ClientInput::default()
    });
    let record = follow(&mut bench, &mut reference, Mode::Hold, 10, &foot);
    assert_eq!(record.fault, Event::SensorStale.number());
    assert_eq!(record.events[Event::SensorStale.index()], 1);
    motion.take(&bench);
    motion.assert_small("F/T sensor silent, reaction stop");
}

/// Somebody pushes the elbow, where no contact is declared.
const PUSHED: &str = "\n[[push]]\nlink = \"left_elbow_link\"\nstart_s = 0.8\nduration_s = 0.8\n\
                      force_N = [60.0, 0.0, 0.0]\n";

#[test]
fn a_contact_may_warn_release_or_stop_the_robot() {
    for (reaction, expected) in [
        ("warn", (RobotState::Active, 0)),
        ("release", (RobotState::Holding, 0)),
        ("stop", (RobotState::Fault, Event::ExternalContact.number())),
    ] {
        let chosen = format!("external_contact = {reaction:?}");
        let mut bench = bench("humanoid", "whole_body", &chosen, PUSHED);
        let mut reference = carried(&mut bench);
        let record = follow(&mut bench, &mut reference, Mode::InverseDynamics, 190, &[]);
        assert_eq!(state(&record), RobotState::Active, "{reaction}");
        let record = follow(&mut bench, &mut reference, Mode::InverseDynamics, 300, &[]);
        assert!(record.events[Event::ExternalContact.index()] > 0);
        assert_eq!((state(&record), record.fault), expected, "{reaction}");
        let of_joint = record.fault_subject >> 16 == 1;
        assert_eq!(of_joint, record.fault != 0, "{reaction}");
    }
}

#[test]
fn a_limit_that_acts_may_switch_the_robot_off_and_no_set_point_leaves_with_it() {
    let mut bench = bench("leg", "encoder", "torque_limit = \"off\"", "");
    let mut reference = carried(&mut bench);
    follow(&mut bench, &mut reference, Mode::Torque, 20, &[]);
    reference.joints[3].tau_d = 1.5 * bench.robot.parameters.joints[3].limits.torque;
    let record = follow(&mut bench, &mut reference, Mode::Torque, 1, &[]);
    assert_eq!(record.fault, Event::TorqueLimit.number());
    assert_eq!(record.fault_subject, 1 << 16 | 3, "the knee");
    assert!(!bench.sent_set_points(|_| true));
}
