//! Mode position: the robot goes where it is sent, as planned, and comes to rest on the way there.

use crate::common;

use common::motion::Motion;
use common::{Bench, client_input, current_drive};
use cycle::ClientInput;
use robot_state::{Event, Mode, Reference, RobotState};

const POSITION: u32 = Mode::Position.number();

/// A robot that holds and has asked for hold, and its reference.
fn held(mut bench: Bench) -> (Bench, Reference) {
    bench.run(400);
    let mut reference = bench.reference(Mode::Hold.number(), 1);
    for _ in 0..20 {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    reference.mode = POSITION;
    (bench, reference)
}

/// One cycle with the reference sent anew.
fn step(bench: &mut Bench, reference: &mut Reference) {
    reference.sequence += 1;
    bench.step(&client_input(reference));
}

/// Follows the reference until the robot is there, and a little longer. Returns the greatest distance
/// of a joint from its planned place, rad, and the greatest speed over the velocity limit.
fn arrive(bench: &mut Bench, reference: &mut Reference) -> (f64, f64) {
    let (mut error, mut speed) = (0.0f64, 0.0f64);
    let mut after = 0;
    for cycle in 0.. {
        step(bench, reference);
        let record = bench.cycle.record();
        assert_eq!(record.mode, POSITION, "fault {}", record.fault);
        let joints = bench.plant.truth().joints.iter();
        for (joint, p) in joints.zip(&bench.robot.parameters.joints) {
            speed = speed.max(joint.dq.abs() / p.limits.velocity);
        }
        if record.commander.motion_left_s == 0.0 {
            after += 1;
        }
        if after > 300 {
            break;
        }
        assert!(cycle < 20_000, "it does not arrive");
    }
    let joints = bench.plant.truth().joints.iter();
    for (joint, asked) in joints.zip(&reference.joints) {
        error = error.max((joint.q - asked.q_d).abs());
    }
    (error, speed)
}

/// Far away, for every joint at once: there within a twentieth of a degree, never faster than
/// configured, and the torque does not step.
#[test]
fn the_leg_goes_where_it_is_sent_and_stays_there() {
    let (mut bench, mut reference) = held(Bench::new("leg"));
    let joints = bench.robot.parameters.joints.iter();
    let away: Vec<f64> = joints
        .map(|joint| {
            let (min, max) = (joint.limits.position_min, joint.limits.position_max);
            0.3 * min + 0.7 * max
        })
        .collect();
    for (joint, q) in reference.joints.iter_mut().zip(&away) {
        joint.q_d = 0.5 * *q;
    }
    let (error, speed) = arrive(&mut bench, &mut reference);
    assert!(
        error < 0.05f64.to_radians(),
        "{:.3} deg",
        error.to_degrees()
    );
    let share = bench.robot.parameters.motion.velocity;
    assert!(speed < 1.05 * share, "{speed:.2} of the velocity limit");
    assert!(speed > 0.3 * share, "{speed:.2}: nothing moved");
    // The client goes: the robot holds where it is.
    let mut motion = Motion::of(&bench);
    for _ in 0..500 {
        bench.step(&ClientInput::default());
        motion.take(&bench);
    }
    assert_eq!(bench.cycle.record().mode, Mode::Hold.number());
    motion.assert_small("holding at the target");
}

#[test]
fn a_slower_motion_and_a_new_target_on_the_way() {
    for bench in [Bench::new("test-joint"), current_drive()] {
        let (mut bench, mut reference) = held(bench);
        let slow = 0.1 * bench.robot.parameters.joints[0].limits.velocity;
        (reference.joints[0].q_d, reference.joints[0].dq_d) = (0.6, slow);
        let mut fastest = 0.0f64;
        for _ in 0..400 {
            step(&mut bench, &mut reference);
            fastest = fastest.max(bench.plant.truth().joints[0].dq);
        }
        assert!(bench.cycle.record().commander.motion_left_s > 0.0);
        assert!(
            fastest < 1.3 * slow && fastest > 0.8 * slow,
            "{fastest} of {slow}"
        );
        // Back again, at the configured speed.
        (reference.joints[0].q_d, reference.joints[0].dq_d) = (-0.3, 0.0);
        let (error, _) = arrive(&mut bench, &mut reference);
        assert!(error < 0.3f64.to_radians(), "{:.3} deg", error.to_degrees());
    }
}

#[test]
fn a_client_that_dies_on_the_way_leaves_the_robot_at_rest() {
    let (mut bench, mut reference) = held(Bench::new("leg"));
    reference.joints[3].q_d += 0.5;
    for _ in 0..400 {
        step(&mut bench, &mut reference);
    }
    assert!(bench.plant.truth().joints[3].dq.abs() > 0.1, "on its way");
    for _ in 0..600 {
        bench.step(&ClientInput::default());
    }
    let mut motion = Motion::of(&bench);
    for _ in 0..300 {
        bench.step(&ClientInput::default());
        motion.take(&bench);
    }
    let record = bench.cycle.record();
    assert_eq!((record.fault, record.mode), (0, Mode::Hold.number()));
    assert_eq!(record.commander.motion_left_s, 0.0);
    motion.assert_small("after the stop");
}

type Change = fn(&mut Reference);

/// Targets beyond a limit and speeds that are none release the robot and move nothing.
#[test]
fn targets_that_are_none_move_nothing() {
    let change: [(Change, Event); 6] = [
        (|r| r.joints[3].q_d = 9.0, Event::ReferenceLimit),
        (|r| r.joints[3].q_d = -1e300, Event::ReferenceLimit),
        (|r| r.joints[3].q_d = f64::NAN, Event::ReferenceNotFinite),
        (|r| r.joints[3].dq_d = 1e3, Event::ReferenceLimit),
        (|r| r.joints[3].dq_d = -0.5, Event::ReferenceLimit),
        (|r| r.joints[3].dq_d = 1e-9, Event::ReferenceLimit),
    ];
    for (change, event) in change {
        let (mut bench, mut reference) = held(Bench::new("leg"));
        let mut motion = Motion::of(&bench);
        change(&mut reference);
        for _ in 0..300 {
            step(&mut bench, &mut reference);
            motion.take(&bench);
        }
        let record = bench.cycle.record();
        let counted = record.events[Event::ALL.iter().position(|e| *e == event).unwrap()];
        assert!(counted > 0, "{event:?}");
        assert_eq!(record.mode, Mode::Hold.number());
        assert_eq!(record.state, RobotState::Holding.number());
        motion.assert_small(event.name());
    }
}
