//! Invalid frames and references are counted, and the robot holds its position.

use crate::common;

use can_codec::{EXTENDED_ID, Frame};
use common::{Bench, client_input};
use cycle::{ClientInput, OperatorRequest};
use proptest::prelude::*;
use robot_state::{CycleRecord, Event, Mode, Reference, RobotState, measured_flags, torque_flags};

fn count(record: &CycleRecord, event: Event) -> u64 {
    record.events[event.index()]
}

fn q_c(record: &CycleRecord) -> Vec<f64> {
    let joints = record
        .commanded
        .joints
        .iter()
        .take(record.joint_count as usize);
    joints.map(|j| j.q_c).collect()
}

/// Largest distance of the joints from an earlier pose, rad.
fn moved(bench: &Bench, from: &[f64]) -> f64 {
    let joints = bench.plant.truth().joints.iter();
    joints
        .zip(from)
        .map(|(joint, q)| (joint.q - q).abs())
        .fold(0.0, f64::max)
}

fn pose(bench: &Bench) -> Vec<f64> {
    bench.plant.truth().joints.iter().map(|j| j.q).collect()
}

#[test]
fn holds_still_without_a_client() {
    let mut bench = Bench::new("leg");
    bench.run(50);
    let start = pose(&bench);
    bench.run(500);
    assert!(moved(&bench, &start) < 1e-4, "{}", moved(&bench, &start));
    assert_eq!(bench.cycle.record().mode, Mode::Hold.number());
    assert_eq!(bench.cycle.record().fault, 0);
}

#[test]
fn unknown_frames_and_frames_of_wrong_length_are_only_counted() {
    let mut bench = Bench::new("leg");
    bench.run(100);
    let start = pose(&bench);
    for _ in 0..100 {
        bench.gather();
        let first = bench.rx.as_slice()[0];
        bench.rx.push(Frame::zeroed(0, 0x7ff, 8, false));
        bench
            .rx
            .push(Frame::zeroed(1, 0x1234_5678 | EXTENDED_ID, 3, false));
        bench.rx.push(Frame { len: 2, ..first });
        bench.rx.push(Frame {
            error: true,
            ..first
        });
        bench.compute(&ClientInput::default());
    }
    let record = bench.cycle.record();
    assert_eq!(count(record, Event::FrameUnknownId), 200);
    assert_eq!(count(record, Event::FrameWrongLength), 100);
    assert_eq!(count(record, Event::BusErrorFrame), 100);
    assert_eq!(count(record, Event::JointMissed), 0);
    assert_eq!(record.fault, 0);
    assert!(moved(&bench, &start) < 1e-4);
}

#[test]
fn a_lost_answer_is_bridged_without_a_step_in_torque_or_command() {
    let mut bench = Bench::new("leg");
    let reference = bench.follow();
    for _ in 0..600 {
        bench.step(&client_input(&reference));
    }
    let before = *bench.cycle.record();
    bench.gather();
    let knee = bench
        .robot
        .receive
        .message(3)
        .map(|m| (m.bus, m.id))
        .unwrap();
    bench.drop_answers(|f| (f.bus, f.id) == knee);
    let after = *bench.compute(&client_input(&reference));
    assert_eq!(count(&after, Event::JointMissed), 1);
    assert_eq!(after.mode, Mode::InverseDynamics.number());
    let missed = after
        .measured
        .joints
        .iter()
        .filter(|j| j.flags & measured_flags::MISSED != 0);
    assert_eq!(missed.count(), 1);
    for (before, after) in q_c(&before).iter().zip(q_c(&after)) {
        let step = after - before;
        assert!(step.abs() < 1e-4, "command steps by {step}");
    }
    let [before, after] = [before.estimated.joints, after.estimated.joints];
    for (before, after) in before.iter().zip(&after).take(6) {
        let limit = 0.01 * (1.0 + before.tau_whole_body.tau.abs());
        let step = after.tau_whole_body.tau - before.tau_whole_body.tau;
        assert!(step.abs() < limit, "whole-body torque steps by {step}");
        let step = after.tau_encoder.tau - before.tau_encoder.tau;
        assert!(
            step.abs() < 0.05 * (1.0 + before.tau_encoder.tau.abs()),
            "{step}"
        );
    }
}

#[test]
fn a_stale_joint_latches_a_fault_and_all_joints_hold_until_an_operator_acknowledges() {
    let mut bench = Bench::new("leg");
    let mut reference = bench.follow();
    let start = pose(&bench);
    let missed = bench
        .robot
        .receive
        .message(0)
        .map(|m| (m.bus, m.id))
        .unwrap();
    for _ in 0..100 {
        bench.gather();
        bench.drop_answers(|f| (f.bus, f.id) == missed);
        bench.compute(&client_input(&reference));
    }
    let record = *bench.cycle.record();
    assert_eq!(record.fault, Event::JointStale.number());
    assert_eq!(record.mode, Mode::Hold.number());
    assert_eq!(count(&record, Event::JointStale), 1);
    let stale = record
        .measured
        .joints
        .iter()
        .any(|j| j.flags & measured_flags::STALE != 0);
    assert!(stale);
    let valid =
        |r: &CycleRecord| r.estimated.joints[0].tau_whole_body.flags & torque_flags::VALID != 0;
    assert!(!valid(&record));
    let held = q_c(&record);

    // Answers again: the fault stays latched, and the robot holds.
    for _ in 0..200 {
        bench.step(&client_input(&reference));
    }
    assert_eq!(bench.cycle.record().fault, Event::JointStale.number());
    let still = q_c(bench.cycle.record());
    let drift = held
        .iter()
        .zip(&still)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    assert!(drift < 2e-3, "{drift}");
    assert!(moved(&bench, &start) < 2e-3, "{}", moved(&bench, &start));

    // Another fault's number changes nothing; this one's leads back to ready, and the simulated
    // robot, which enables by itself, to holding. The client asks for hold once.
    let operator = |bench: &mut Bench, number| {
        let request = Some(OperatorRequest::Acknowledge(number));
        let input = ClientInput {
            request,
            ..client_input(&reference)
        };
        *bench.step(&input)
    };
    let record = operator(&mut bench, Event::CommandNotFinite.number());
    assert_eq!(record.fault, Event::JointStale.number());
    assert_ne!(record.refusal, 0);
    let record = operator(&mut bench, Event::JointStale.number());
    assert_eq!((record.fault, record.refusal), (0, 0));
    for mode in [Mode::InverseDynamics, Mode::Hold] {
        reference.sequence += 1;
        reference.mode = mode.number();
        // Long enough for every drive to prove that it follows.
        for _ in 0..20 {
            assert_eq!(
                bench.step(&client_input(&reference)).mode,
                Mode::Hold.number()
            );
        }
    }
    assert_eq!(bench.cycle.record().state, RobotState::Holding.number());
    reference.sequence += 1;
    reference.mode = Mode::InverseDynamics.number();
    assert_eq!(
        bench.step(&client_input(&reference)).mode,
        Mode::InverseDynamics.number()
    );
    assert_eq!(bench.cycle.record().state, RobotState::Active.number());
}

/// After `flaw` the robot holds, and follows again only after the client has asked for hold.
fn assert_holds(flaw: impl Fn(&mut Reference), event: Event) {
    let mut bench = Bench::new("leg");
    let mut reference = bench.follow();
    let start = pose(&bench);
    reference.sequence += 1;
    let mut flawed = reference;
    flaw(&mut flawed);
    for _ in 0..200 {
        let record = bench.step(&client_input(&flawed));
        assert_eq!(record.mode, Mode::Hold.number());
        assert!(q_c(record).iter().all(|q| q.is_finite()));
    }
    // Counted once for the message, not once for each cycle.
    assert_eq!(count(bench.cycle.record(), event), 1);
    assert_eq!(bench.cycle.record().fault, 0);
    assert!(moved(&bench, &start) < 2e-3);
    reference.sequence += 1;
    assert_eq!(
        bench.step(&client_input(&reference)).mode,
        Mode::Hold.number()
    );
    reference.sequence += 1;
    reference.mode = Mode::Hold.number();
    bench.step(&client_input(&reference));
    reference.sequence += 1;
    reference.mode = Mode::InverseDynamics.number();
    assert_eq!(
        bench.step(&client_input(&reference)).mode,
        Mode::InverseDynamics.number()
    );
}

#[test]
fn nan_from_a_client_makes_the_robot_hold() {
    assert_holds(|r| r.joints[2].q_d = f64::NAN, Event::ReferenceNotFinite);
    assert_holds(
        |r| r.contact_wrench[0].force[1] = f64::INFINITY,
        Event::ReferenceNotFinite,
    );
}

#[test]
fn an_unknown_mode_or_joint_count_makes_the_robot_hold() {
    assert_holds(|r| r.mode = 77, Event::ReferenceRejected);
    assert_holds(|r| r.joint_count = 5, Event::ReferenceRejected);
    assert_holds(|r| r.joint_count = u32::MAX, Event::ReferenceRejected);
}

#[test]
fn a_client_that_stops_sending_makes_the_robot_hold() {
    let mut bench = Bench::new("leg");
    let reference = bench.follow();
    let start = pose(&bench);
    for age_ms in 0..300 {
        let client = ClientInput {
            reference: Some(&reference),
            age_s: f64::from(age_ms) * 1e-3,
            ..ClientInput::default()
        };
        bench.step(&client);
    }
    assert_eq!(bench.cycle.record().mode, Mode::Hold.number());
    assert_eq!(count(bench.cycle.record(), Event::ReferenceStale), 1);
    assert!(moved(&bench, &start) < 2e-3);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn commands_stay_finite_and_within_limits_for_any_input(
        frames in prop::collection::vec((0u8..3, any::<u32>(), 0u8..70, any::<[u8; 8]>(), any::<bool>()), 0..40),
        flips in prop::collection::vec((any::<prop::sample::Index>(), 0usize..8, any::<u8>()), 0..6),
        q_d in prop::collection::vec(prop::num::f64::ANY, 6),
        tau_d in prop::collection::vec(-1e9..1e9f64, 6),
        torque_mode in any::<bool>(),
    ) {
        let mut bench = Bench::new("leg");
        let mut reference = bench.follow();
        reference.mode = if torque_mode { Mode::Torque.number() } else { Mode::InverseDynamics.number() };
        for (j, (q_d, tau_d)) in q_d.iter().zip(&tau_d).enumerate() {
            reference.joints[j].q_d = *q_d;
            reference.joints[j].tau_d = *tau_d;
        }
        for _ in 0..30 {
            bench.gather();
            let mut answers: Vec<Frame> = bench.rx.iter().copied().collect();
            for (index, byte, value) in &flips {
                index.get_mut(&mut answers).data[*byte] ^= value;
            }
            for (bus, id, len, data, error) in &frames {
                let mut frame = Frame::zeroed(*bus, id & 0x9fff_ffff, 8, false);
                frame.len = *len;
                frame.error = *error;
                frame.data[..8].copy_from_slice(data);
                answers.push(frame);
            }
            bench.rx.clear();
            for frame in answers {
                bench.rx.push(frame);
            }
            reference.sequence += 1;
            let record = *bench.compute(&client_input(&reference));
            for (j, parameters) in bench.robot.parameters.joints.iter().enumerate() {
                let limits = parameters.limits;
                let (joint, q_c) = (&record.estimated.joints[j], record.commanded.joints[j].q_c);
                prop_assert!(q_c.is_finite());
                prop_assert!(q_c >= limits.position_min);
                prop_assert!(q_c <= limits.position_max);
                prop_assert!(joint.tau_encoder.tau.abs() <= limits.torque);
                prop_assert!(joint.tau_whole_body.tau.abs() <= limits.torque);
            }
        }
    }
}

/// A joint that answers now and then is bridged by its last velocity most of the time, and would never stop by itself.
#[test]
fn a_joint_that_answers_every_second_time_is_stale() {
    for (every, stale) in [(2, true), (7, false)] {
        let mut bench = Bench::new("leg");
        bench.run(400);
        for k in 0..400 {
            bench.gather();
            bench.drop_answers(|f| k % every == 0 && f.bus == 1);
            bench.compute(&ClientInput::default());
        }
        let expected = if stale { Event::JointStale.number() } else { 0 };
        assert_eq!(bench.cycle.record().fault, expected, "every {every}");
    }
}
