//! One thing wrong at a time: nothing moves unless asked, and no single fault moves it.
//!
//! Each test drives the cycle in front of the simulated robot, spoils one input and measures what
//! the joints truly do.

use crate::common;

use can_codec::Frame;
use common::motion::{Motion, engaged, state};
use common::{Bench, client_input, current_drive, spoil};
use cycle::{ClientInput, OperatorRequest};
use robot_config::slots;
use robot_state::{Event, Mode, RobotState};

/// Runs `cycles` cycles with `change` on the joint's signals.
fn run_spoilt(
    bench: &mut Bench,
    motion: &mut Motion,
    cycles: usize,
    input: &ClientInput<'_>,
    joint: usize,
    change: impl Fn(&mut [f64]),
) {
    for _ in 0..cycles {
        bench.gather();
        spoil(bench, joint, &change);
        bench.compute(input);
        motion.take(bench);
    }
}

#[test]
fn a_lost_first_answer_delays_the_start_and_moves_nothing() {
    for robot in ["leg", "humanoid"] {
        for lost in [1, 500] {
            let mut bench = Bench::new(robot);
            let mut motion = Motion::of(&bench);
            let first = bench
                .robot
                .receive
                .message(0)
                .map(|m| (m.bus, m.id))
                .unwrap();
            for _ in 0..lost {
                bench.gather();
                bench.drop_answers(|f| (f.bus, f.id) == first);
                let record = *bench.compute(&ClientInput::default());
                assert_eq!((state(&record), engaged(&record)), (RobotState::Boot, 0));
                assert!(bench.tx.is_empty());
                motion.take(&bench);
            }
            for _ in 0..400 {
                bench.step(&ClientInput::default());
                motion.take(&bench);
            }
            assert_eq!(state(bench.cycle.record()), RobotState::Holding);
            motion.assert_small(&format!("{robot}, first answer lost for {lost} cycles"));
        }
    }
}

#[test]
fn a_false_first_reading_moves_nothing() {
    for joint in 0..6 {
        let mut bench = Bench::new("leg");
        let mut motion = Motion::of(&bench);
        run_spoilt(
            &mut bench,
            &mut motion,
            1,
            &ClientInput::default(),
            joint,
            |values| {
                values[slots::link_angle(joint)] = 0.0;
                values[slots::motor_angle(joint)] = 0.0;
            },
        );
        for _ in 0..600 {
            bench.step(&ClientInput::default());
            motion.take(&bench);
        }
        assert_eq!(state(bench.cycle.record()), RobotState::Holding);
        motion.assert_small(&format!("joint {joint} sends zeros in its first frame"));
    }
}

#[test]
fn false_first_readings_do_not_outlast_themselves() {
    // The link-side encoders' offsets choose the turn of a motor-side one, which wraps.
    for robot in ["leg", "lift-gripper"] {
        for (false_for, offset) in [(1, 0.3), (7, 0.3), (40, 0.3), (40, 0.02), (1000, -0.2)] {
            let mut bench = Bench::new(robot);
            let mut motion = Motion::of(&bench);
            let idle = ClientInput::default();
            run_spoilt(&mut bench, &mut motion, false_for, &idle, 0, |values| {
                values[slots::link_angle(0)] += offset;
                values[slots::motor_angle(0)] += 9.0 * offset;
            });
            bench.run(600);
            let case = format!("{robot}: readings {offset} off for {false_for} cycles");
            assert_eq!(state(bench.cycle.record()), RobotState::Holding, "{case}");
            motion.assert_small(&case);
        }
    }
}

#[test]
fn a_link_encoder_that_slips_moves_nothing() {
    for (mode, slip) in [
        (Mode::Hold, 0.06),
        (Mode::Hold, -0.004),
        (Mode::Torque, 0.0035),
        (Mode::Torque, -0.02),
        (Mode::InverseDynamics, 0.02),
        (Mode::InverseDynamics, 0.002),
    ] {
        for joint in 0..6 {
            let mut bench = Bench::new("leg");
            bench.run(400);
            let mut reference = bench.reference(mode.number(), 1);
            let tau = bench.cycle.record().estimated.joints;
            for (reference, tau) in reference.joints.iter_mut().zip(tau) {
                reference.tau_d = tau.tau_encoder.tau;
            }
            for _ in 0..20 {
                bench.step(&client_input(&reference));
            }
            assert_eq!(bench.cycle.record().mode, mode.number());
            let mut motion = Motion::of(&bench);
            run_spoilt(
                &mut bench,
                &mut motion,
                1000,
                &client_input(&reference),
                joint,
                |values| {
                    values[slots::link_angle(joint)] += slip;
                },
            );
            let fault = bench.cycle.record().fault;
            assert_eq!(
                fault,
                Event::EncoderImplausible.number(),
                "{mode:?}, joint {joint} slips by {slip} rad"
            );
            motion.assert_small(&format!("{mode:?}, joint {joint} slips by {slip} rad"));
        }
    }
}

/// The torque by torsion alone changes: neither motor current nor F/T sensors do.
#[test]
fn a_link_encoder_that_drifts_moves_nothing() {
    for (mode, rate) in [
        (Mode::Hold, 0.01),
        (Mode::Torque, 0.01),
        (Mode::Torque, -0.03),
        (Mode::Torque, 0.1),
        (Mode::InverseDynamics, -0.01),
    ] {
        for joint in [2, 3, 5] {
            let mut bench = Bench::new("leg");
            bench.run(400);
            let mut reference = bench.reference(Mode::Hold.number(), 1);
            let carried = bench.cycle.record().estimated.joints;
            for (reference, tau) in reference.joints.iter_mut().zip(carried) {
                reference.tau_d = tau.tau_whole_body.tau;
            }
            for k in 0..400 {
                if k == 5 {
                    reference.mode = mode.number();
                }
                reference.sequence += 1;
                bench.step(&client_input(&reference));
            }
            let what = format!("{mode:?}, joint {joint} drifts by {rate} rad/s");
            assert_eq!(bench.cycle.record().mode, mode.number(), "{what}");
            assert_eq!(bench.cycle.record().fault, 0, "{what}");
            let mut motion = Motion::of(&bench);
            let mut drift = 0.0;
            for _ in 0..1000 {
                drift += rate * 1e-3;
                reference.sequence += 1;
                let input = client_input(&reference);
                run_spoilt(&mut bench, &mut motion, 1, &input, joint, |values| {
                    values[slots::link_angle(joint)] += drift;
                });
            }
            let record = bench.cycle.record();
            assert_eq!(record.fault, Event::EncoderImplausible.number(), "{what}");
            assert_eq!(record.fault_subject, 1 << 16 | joint as u32, "{what}");
            motion.assert_small(&what);
        }
    }
}

#[test]
fn outside_its_limits_a_robot_is_not_enabled() {
    let read = |path: &str| {
        let text = common::read(path)?;
        Ok(if path.ends_with("config/leg/robot.toml") {
            text.replace(
                "name = \"knee\"\nbus",
                "name = \"knee\"\nposition_min_deg = 80\nbus",
            )
        } else {
            text
        })
    };
    let mut bench = Bench::reading("leg", &read);
    let mut motion = Motion::of(&bench);
    for _ in 0..600 {
        bench.step(&ClientInput::default());
        assert!(!bench.sent_set_points(|_| true));
        motion.take(&bench);
    }
    assert_eq!(state(bench.cycle.record()), RobotState::Ready);
    let request = Some(OperatorRequest::Enable);
    let record = *bench.step(&ClientInput {
        request,
        ..ClientInput::default()
    });
    assert_eq!(
        (record.requests, record.refusal),
        (1, 3 << 16 | 3),
        "outside: joint 3"
    );
    motion.assert_small("the knee stands outside its limits");
}

#[test]
fn a_bus_that_was_cut_does_not_move_its_joints_when_it_is_back() {
    let mut bench = Bench::new("leg");
    bench.run(400);
    let cut = 1;
    for _ in 0..2000 {
        bench.gather();
        bench.drop_answers(|f| f.bus == cut);
        bench.compute(&ClientInput::default());
        let sent = bench.sent_set_points(|f| f.bus == cut);
        assert!(!sent || bench.cycle.record().fault == 0);
    }
    let record = *bench.cycle.record();
    assert_eq!(
        (state(&record), record.fault),
        (RobotState::Fault, Event::JointStale.number())
    );
    let mut motion = Motion::of(&bench);
    for _ in 0..1000 {
        bench.step(&ClientInput::default());
        assert!(
            !bench.sent_set_points(|f| f.bus == cut),
            "a set-point nobody asked for"
        );
        motion.take(&bench);
    }
    // Acknowledged, it holds where it stands now.
    let request = Some(OperatorRequest::Acknowledge(Event::JointStale.number()));
    bench.step(&ClientInput {
        request,
        ..ClientInput::default()
    });
    for _ in 0..500 {
        bench.step(&ClientInput::default());
        motion.take(&bench);
    }
    assert_eq!(state(bench.cycle.record()), RobotState::Holding);
    motion.assert_small("bus cut for 2 s");
}

/// Else it would be brought to rest from a velocity that is the filters' alone: the step by which it
/// moved in silence.
#[test]
fn a_joint_that_was_silent_is_not_enabled_before_it_has_proved_itself_again() {
    const SAMPLES_TO_TRUST: usize = 100;
    let mut bench = Bench::new("leg");
    bench.run(400);
    for _ in 0..200 {
        bench.gather();
        bench.drop_answers(|f| f.bus == 1);
        bench.compute(&ClientInput::default());
    }
    assert_eq!(bench.cycle.record().fault, Event::JointStale.number());
    let mut motion = Motion::of(&bench);
    for k in 0..400 {
        let fault = bench.cycle.record().fault;
        let request = (k >= 5 && fault != 0).then_some(OperatorRequest::Acknowledge(fault));
        bench.step(&ClientInput {
            request,
            ..ClientInput::default()
        });
        let sent = bench.sent_set_points(|f| f.bus == 1);
        assert!(
            !sent || k >= SAMPLES_TO_TRUST - 1,
            "enabled after {k} samples"
        );
        motion.take(&bench);
    }
    let record = bench.cycle.record();
    assert_eq!((state(record), record.fault), (RobotState::Holding, 0));
    motion.assert_small("enabled at once after a silence");
}

#[test]
fn sensors_that_fall_silent_end_the_modes_that_need_them() {
    let mut bench = Bench::new("humanoid");
    bench.run(400);
    let mut reference = bench.reference(Mode::InverseDynamics.number(), 1);
    for _ in 0..50 {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    assert_eq!(state(bench.cycle.record()), RobotState::Active);
    let table = bench.robot.receive.clone();
    let imu: Vec<(u8, u32)> = (0..table.message_count())
        .filter(|&m| table.slots(m).any(|slot| slot == slots::gyro(0, 0)))
        .filter_map(|m| table.message(m).map(|m| (m.bus, m.id)))
        .collect();
    let mut motion = Motion::of(&bench);
    for _ in 0..1000 {
        bench.gather();
        bench.drop_answers(|f| imu.contains(&(f.bus, f.id)));
        reference.sequence += 1;
        bench.compute(&client_input(&reference));
        motion.take(&bench);
    }
    let record = bench.cycle.record();
    assert_eq!(record.mode, Mode::Hold.number());
    assert_eq!(record.events[Event::SensorStale.index()], 1);
    motion.assert_small("IMU silent");
}

#[test]
fn a_fault_of_an_earlier_run_keeps_the_robot_off_until_it_is_acknowledged() {
    let mut bench = Bench::new("leg");
    bench.cycle.start_with_fault(Event::EncoderImplausible);
    let mut motion = Motion::of(&bench);
    for _ in 0..600 {
        let record = *bench.step(&ClientInput::default());
        assert_eq!(state(&record), RobotState::Fault);
        assert_eq!(record.fault, Event::EncoderImplausible.number());
        assert!(!bench.sent_set_points(|_| true));
        motion.take(&bench);
    }
    let number = Event::EncoderImplausible.number();
    let request = Some(OperatorRequest::Acknowledge(number));
    bench.step(&ClientInput {
        request,
        ..ClientInput::default()
    });
    for _ in 0..400 {
        bench.step(&ClientInput::default());
        motion.take(&bench);
    }
    assert_eq!(state(bench.cycle.record()), RobotState::Holding);
    motion.assert_small("started with a fault");
}

#[test]
fn a_current_drive_whose_encoders_contradict_each_other_stays_where_it_is() {
    for (mode, slip) in [
        (Mode::Hold, 0.06),
        (Mode::Hold, -0.003),
        (Mode::InverseDynamics, 0.02),
    ] {
        let mut bench = current_drive();
        bench.run(600);
        let mut reference = bench.reference(mode.number(), 1);
        for _ in 0..400 {
            reference.sequence += 1;
            bench.step(&client_input(&reference));
        }
        let mut motion = Motion::of(&bench);
        let input = client_input(&reference);
        run_spoilt(&mut bench, &mut motion, 1000, &input, 0, |values| {
            values[slots::link_angle(0)] += slip;
        });
        let fault = bench.cycle.record().fault;
        assert_eq!(
            fault,
            Event::EncoderImplausible.number(),
            "{mode:?} {slip} rad"
        );
        motion.assert_small(&format!("current drive, {mode:?}, slips by {slip} rad"));
    }
}

#[test]
fn answers_that_are_always_too_late_latch_a_fault() {
    let mut bench = Bench::new("leg");
    bench.run(400);
    let knee = bench.robot.receive.message(3);
    let knee = knee.map(|m| (m.bus, m.id)).unwrap();
    let mut reference = bench.reference(Mode::InverseDynamics.number(), 1);
    for _ in 0..20 {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    let mut motion = Motion::of(&bench);
    let mut late: Option<Frame> = None;
    for _ in 0..200 {
        bench.gather();
        let answer = bench.rx.iter().find(|f| (f.bus, f.id) == knee).copied();
        bench.drop_answers(|f| (f.bus, f.id) == knee);
        // It arrives with the next cycle's answers, with a stamp of its own.
        if let Some(frame) = late.take() {
            bench.rx.push(frame);
        }
        late = answer;
        reference.sequence += 1;
        bench.compute(&client_input(&reference));
        motion.take(&bench);
    }
    let record = bench.cycle.record();
    assert_eq!(record.fault, Event::JointStale.number());
    motion.assert_small("the knee answers too late");
}

#[test]
fn a_joint_without_a_usable_sample_latches_a_fault() {
    let mut bench = Bench::new("leg");
    bench.run(400);
    let knee = bench.robot.receive.message(3);
    let knee = knee.map(|m| (m.bus, m.id)).unwrap();
    let mut motion = Motion::of(&bench);
    for _ in 0..1000 {
        bench.gather();
        bench.drop_answers(|f| (f.bus, f.id) == knee);
        bench.compute(&ClientInput::default());
        motion.take(&bench);
    }
    let record = bench.cycle.record();
    assert_eq!(record.fault, Event::JointStale.number());
    assert!(record.measured.joints[3].age_s > 0.9);
    motion.assert_small("no usable sample of the knee");
}

#[test]
fn an_older_frame_after_a_newer_one_is_not_used() {
    let mut bench = Bench::new("leg");
    bench.run(400);
    let mut motion = Motion::of(&bench);
    let mut kept: Option<Frame> = None;
    for _ in 0..500 {
        bench.gather();
        let newest = bench.rx.iter().next().copied();
        if let Some(older) = kept.take() {
            bench.rx.push(older);
        }
        kept = newest;
        bench.compute(&ClientInput::default());
        motion.take(&bench);
    }
    let record = bench.cycle.record();
    assert_eq!(record.fault, 0);
    assert_eq!(record.events[Event::FrameOutOfOrder.index()], 499);
    motion.assert_small("frames out of order");
}

#[test]
fn an_event_of_the_process_that_latches_stops_the_robot() {
    for (event, latches) in [
        (Event::LateCycle, false),
        (Event::BusDown, true),
        (Event::SendFailing, true),
        (Event::LatenessLasts, true),
        (Event::PublisherGone, true),
        (Event::LoopEnded, true),
    ] {
        let mut bench = Bench::new("leg");
        bench.run(400);
        let mut motion = Motion::of(&bench);
        bench.cycle.note(event, 3);
        let record = *bench.step(&ClientInput::default());
        assert_eq!(record.events[event.index()], 3);
        let expected = if latches { event.number() } else { 0 };
        assert_eq!(record.fault, expected, "{event:?}");
        for _ in 0..100 {
            bench.step(&ClientInput::default());
            if event != Event::LoopEnded {
                motion.take(&bench);
            }
        }
        motion.assert_small(event.name());
    }
}
