//! Drives that refuse, fail, lose their power or hear nothing, in front of the cycle: the fault is
//! latched, the other joints are held, and nothing moves before an operator has enabled the robot.

use crate::common;

use common::motion::{Motion, engaged, state};
use common::{Bench, client_input};
use cycle::{ClientInput, OperatorRequest};
use plant::{DriveError, DriveStates};
use robot_config::slots;
use robot_state::{CycleRecord, DriveState, Event, Mode, RobotState};

const KNEE: usize = 3;

/// The robot with other words in its `robot.toml`, enabled by an operator only.
fn bench(robot: &str, changes: &[(&str, &str)]) -> Bench {
    let of_robot = format!("config/{robot}/robot.toml");
    Bench::reading(robot, &|path| {
        let text = common::read(path)?;
        Ok(if path.ends_with(&of_robot) {
            (changes.iter())
                .chain(&[("enable = \"automatic\"", "enable = \"operator\"")])
                .fold(text, |text, (from, to)| {
                    assert!(text.contains(from), "{from}");
                    text.replace(from, to)
                })
        } else {
            text
        })
    })
}

fn states(bench: &mut Bench, joint: usize) -> &mut DriveStates {
    bench.plant.drive_states(joint).unwrap()
}

fn each(bench: &mut Bench, change: impl Fn(&mut DriveStates)) {
    for joint in 0..bench.robot.parameters.joints.len() {
        change(states(bench, joint));
    }
}

fn drive_state(record: &CycleRecord, joint: usize) -> DriveState {
    DriveState::from_number(record.commanded.joints[joint].drive_state).unwrap()
}

fn run(bench: &mut Bench, motion: &mut Motion, cycles: usize) {
    for _ in 0..cycles {
        bench.step(&ClientInput::default());
        motion.take(bench);
    }
}

/// Until the operator has enabled the robot, and it holds.
fn enabled(robot: &str) -> Bench {
    let mut bench = bench(robot, &[]);
    let mut motion = Motion::of(&bench);
    run(&mut bench, &mut motion, 300);
    assert_eq!(state(bench.cycle.record()), RobotState::Ready);
    assert_eq!(engaged(bench.cycle.record()), 0);
    bench.ask(OperatorRequest::Enable);
    run(&mut bench, &mut motion, 300);
    assert_eq!(state(bench.cycle.record()), RobotState::Holding);
    motion.assert_small(&format!("{robot} is enabled"));
    bench
}

/// The operator's way back: nothing is sent to a drive that was lost before the robot is enabled.
fn recover(bench: &mut Bench, motion: &mut Motion, fault: Event, what: &str) {
    let joints = bench.robot.parameters.joints.len();
    let held = engaged(bench.cycle.record());
    assert!(held < joints, "{what}");
    bench.ask(OperatorRequest::Acknowledge(fault.number()));
    run(bench, motion, 300);
    let record = *bench.cycle.record();
    assert_eq!(state(&record), RobotState::Ready, "{what}");
    assert_eq!(engaged(&record), held, "{what}: acknowledged, not enabled");
    bench.ask(OperatorRequest::Enable);
    run(bench, motion, 300);
    let record = *bench.cycle.record();
    assert_eq!(
        (record.refusal, state(&record)),
        (0, RobotState::Holding),
        "{what}"
    );
    assert_eq!(engaged(&record), joints, "{what}");
    motion.assert_small(what);
}

#[test]
fn every_robot_stands_still_from_power_on_to_holding_and_through_disabling() {
    for robot in ["test-joint", "leg", "humanoid"] {
        let mut bench = enabled(robot);
        let mut motion = Motion::of(&bench);
        bench.ask(OperatorRequest::Disable);
        assert!(!bench.sent_set_points(|_| true));
        run(&mut bench, &mut motion, 500);
        assert_eq!(drive_state(bench.cycle.record(), 0), DriveState::Off);
        motion.assert_small(&format!("{robot} is disabled"));
    }
}

#[test]
fn control_words_wait_until_the_robot_is_ready_and_are_repeated() {
    let mut bench = bench("leg", &[]);
    let mut gaps = Vec::new();
    let mut since = None;
    for _ in 0..1000 {
        bench.step(&ClientInput::default());
        assert!(!bench.sent_set_points(|_| true));
        let boots = state(bench.cycle.record()) == RobotState::Boot;
        assert!(!boots || bench.tx.is_empty(), "boot listens only");
        if bench.tx.is_empty() {
            since = since.map(|cycles: u32| cycles + 1);
        } else {
            gaps.extend(since.replace(0));
        }
    }
    assert!(
        gaps.len() > 5 && gaps.iter().all(|&gap| gap < 100),
        "{gaps:?}"
    );
}

#[test]
fn an_emergency_stop_with_live_encoders_needs_acknowledgement_and_enabling() {
    for robot in ["leg", "humanoid"] {
        let mut bench = enabled(robot);
        let mut motion = Motion::of(&bench);
        each(&mut bench, |drive| drive.set_power(false));
        run(&mut bench, &mut motion, 2000);
        let record = *bench.cycle.record();
        assert_eq!(state(&record), RobotState::Fault);
        assert_eq!(record.fault, Event::DriveLost.number());
        assert_eq!(drive_state(&record, KNEE), DriveState::Off);
        assert_eq!(engaged(&record), 0);
        each(&mut bench, |drive| drive.set_power(true));
        for _ in 0..1000 {
            bench.step(&ClientInput::default());
            assert!(!bench.sent_set_points(|_| true));
            motion.take(&bench);
            assert_eq!(drive_state(bench.cycle.record(), KNEE), DriveState::Off);
        }
        recover(&mut bench, &mut motion, Event::DriveLost, "emergency stop");
    }
}

#[test]
fn over_current_of_all_drives_is_latched_and_named() {
    for robot in ["leg", "humanoid"] {
        let mut bench = enabled(robot);
        let mut motion = Motion::of(&bench);
        each(&mut bench, |drive| {
            drive.set_cause(Some(DriveError::OverCurrent))
        });
        run(&mut bench, &mut motion, 3);
        let record = *bench.cycle.record();
        assert_eq!(record.fault, Event::DriveFault.number(), "within 3 cycles");
        run(&mut bench, &mut motion, 1000);
        each(&mut bench, |drive| drive.set_cause(None));
        run(&mut bench, &mut motion, 1000);
        let record = *bench.cycle.record();
        let joints = record.joint_count as usize;
        assert_eq!(record.fault, Event::DriveFault.number(), "latched");
        assert_eq!(record.events[Event::DriveFault.index()], joints as u64);
        for joint in 0..joints {
            assert_eq!(drive_state(&record, joint), DriveState::Fault);
            let status = record.measured.joints[joint].status;
            assert_eq!(status >> 8, DriveError::OverCurrent as u32);
        }
        recover(&mut bench, &mut motion, Event::DriveFault, "over-current");
    }
}

#[test]
fn a_fault_whose_cause_remains_is_latched_again() {
    let mut bench = enabled("leg");
    states(&mut bench, KNEE).set_cause(Some(DriveError::Encoder));
    bench.run(100);
    let acknowledge = OperatorRequest::Acknowledge(Event::DriveFault.number());
    assert_eq!(state(bench.ask(acknowledge)), RobotState::Ready);
    let refused = *bench.ask(OperatorRequest::Enable);
    assert_eq!(refused.refusal, 5 << 16 | KNEE as u32, "a drive in a fault");
    bench.run(1000);
    let record = *bench.cycle.record();
    assert_eq!(record.fault, Event::DriveFault.number());
    assert_eq!(record.events[Event::DriveFault.index()], 2);
}

#[test]
fn one_drive_that_fails_in_motion_stops_the_others() {
    for robot in ["leg", "humanoid"] {
        let mut bench = enabled(robot);
        // Whatever an operator did, a client has to ask for hold first.
        let hold = bench.reference(Mode::Hold.number(), 1);
        bench.step(&client_input(&hold));
        let mut reference = bench.reference(Mode::InverseDynamics.number(), 1);
        for _ in 0..50 {
            reference.sequence += 1;
            bench.step(&client_input(&reference));
        }
        assert_eq!(state(bench.cycle.record()), RobotState::Active);
        let mut motion = Motion::of(&bench);
        states(&mut bench, KNEE).set_cause(Some(DriveError::OverTemperature));
        for cycle in 0..1000 {
            if cycle == 500 {
                states(&mut bench, KNEE).set_cause(None);
            }
            reference.sequence += 1;
            bench.step(&client_input(&reference));
            motion.take(&bench);
        }
        let record = *bench.cycle.record();
        assert_eq!(record.fault, Event::DriveFault.number());
        assert_eq!(record.mode, Mode::Hold.number());
        assert_eq!(engaged(&record), record.joint_count as usize - 1);
        recover(
            &mut bench,
            &mut motion,
            Event::DriveFault,
            "one drive fails",
        );
    }
}

#[test]
fn a_drive_that_refuses_or_is_too_slow_switches_all_off_again() {
    for slow in [false, true] {
        let mut bench = bench("leg", &[]);
        let mut motion = Motion::of(&bench);
        run(&mut bench, &mut motion, 300);
        if slow {
            states(&mut bench, KNEE).set_step_time(0.7)
        } else {
            states(&mut bench, KNEE).set_refuses(true)
        }
        bench.ask(OperatorRequest::Enable);
        run(&mut bench, &mut motion, 1000);
        let record = *bench.cycle.record();
        assert_eq!(record.fault, Event::EnableTimeOut.number());
        assert_eq!(engaged(&record), 0);
        for joint in [0, 1, 2, 4, 5] {
            assert_eq!(drive_state(&record, joint), DriveState::Off);
        }
        states(&mut bench, KNEE).set_step_time(0.02);
        states(&mut bench, KNEE).set_refuses(false);
        recover(
            &mut bench,
            &mut motion,
            Event::EnableTimeOut,
            "a drive refuses",
        );
    }
}

/// The drives of the plant warn by bit 7 where nothing stops them.
#[test]
fn a_drive_that_nothing_would_stop_on_a_broken_bus_is_not_enabled() {
    let guarded = "profile = \"cia402\"\ntime_out_set = { mask = 0x80, value = 0 }";
    for while_enabled in [false, true] {
        let mut bench = bench("leg", &[("profile = \"cia402\"", guarded)]);
        let mut motion = Motion::of(&bench);
        each(&mut bench, |drive| drive.set_command_timeout(Some(0.02)));
        if !while_enabled {
            states(&mut bench, KNEE).set_command_timeout(None);
        }
        run(&mut bench, &mut motion, 300);
        bench.ask(OperatorRequest::Enable);
        run(&mut bench, &mut motion, 300);
        if while_enabled {
            assert_eq!(state(bench.cycle.record()), RobotState::Holding);
            states(&mut bench, KNEE).set_command_timeout(None);
            run(&mut bench, &mut motion, 300);
        }
        let record = *bench.cycle.record();
        assert_eq!(record.fault, Event::DriveUnguarded.number());
        assert_eq!(engaged(&record), 0);
        assert_eq!(drive_state(&record, KNEE), DriveState::Off);
        states(&mut bench, KNEE).set_command_timeout(Some(0.02));
        recover(
            &mut bench,
            &mut motion,
            Event::DriveUnguarded,
            "a drive without time limit",
        );
    }
}

#[test]
fn a_drive_that_hears_nothing_faults_by_itself() {
    for cut_answers in [true, false] {
        let mut bench = enabled("leg");
        let mut motion = Motion::of(&bench);
        each(&mut bench, |drive| drive.set_command_timeout(Some(0.02)));
        let bus = bench.robot.parameters.joints[KNEE].bus as u8;
        for _ in 0..1000 {
            bench.gather();
            if cut_answers {
                bench.drop_answers(|f| f.bus == bus);
            }
            bench.compute_deaf(&ClientInput::default(), |f| f.bus == bus);
            motion.take(&bench);
        }
        let fault = Event::from_number(bench.cycle.record().fault).unwrap();
        assert_eq!(
            fault,
            if cut_answers {
                Event::JointStale
            } else {
                Event::DriveFault
            }
        );
        run(&mut bench, &mut motion, 300);
        let record = *bench.cycle.record();
        assert_eq!(drive_state(&record, KNEE), DriveState::Fault);
        let status = record.measured.joints[KNEE].status;
        assert_eq!(status >> 8, DriveError::SetPointTimeOut as u32);
        recover(&mut bench, &mut motion, fault, "a drive hears nothing");
    }
}

#[test]
fn a_drive_without_control_words_is_only_watched() {
    let control = "control = { signal = \"CONTROL_B.knee_control\" }\n";
    let mut bench = bench("leg", &[(control, "")]);
    let mut motion = Motion::of(&bench);
    run(&mut bench, &mut motion, 300);
    assert!(bench.plant.drive_states(KNEE).is_none(), "others switch it");
    bench.ask(OperatorRequest::Enable);
    run(&mut bench, &mut motion, 300);
    let record = *bench.cycle.record();
    assert_eq!(state(&record), RobotState::Holding);
    assert_eq!(drive_state(&record, KNEE), DriveState::Enabled);
    let table = &bench.robot.send;
    let mut slots = (0..table.message_count()).flat_map(|message| table.slots(message));
    assert!(slots.all(|slot| slot != slots::control(KNEE)));
    motion.assert_small("only watched");
}

#[test]
fn a_silent_drive_is_acknowledged_once_and_enabled_when_it_is_back() {
    let mut bench = enabled("leg");
    let mut motion = Motion::of(&bench);
    let knee = bench.robot.receive.message(KNEE).map(|m| (m.bus, m.id));
    let silent = |bench: &mut Bench, motion: &mut Motion, request, cycles: usize| {
        for _ in 0..cycles {
            bench.gather();
            bench.drop_answers(|f| Some((f.bus, f.id)) == knee);
            bench.compute(&ClientInput {
                request,
                ..ClientInput::default()
            });
            motion.take(bench);
        }
        bench.cycle.record().fault
    };
    let stale = Event::JointStale.number();
    assert_eq!(silent(&mut bench, &mut motion, None, 100), stale);
    let acknowledged = Some(OperatorRequest::Acknowledge(stale));
    silent(&mut bench, &mut motion, acknowledged, 1);
    // Longer than its step's time limit: it cannot confirm that it is off.
    assert_eq!(silent(&mut bench, &mut motion, None, 1500), 0);
    run(&mut bench, &mut motion, 300);
    assert_eq!(state(bench.cycle.record()), RobotState::Ready);
    bench.ask(OperatorRequest::Enable);
    run(&mut bench, &mut motion, 300);
    assert_eq!(state(bench.cycle.record()), RobotState::Holding);
    motion.assert_small("a silent drive");
}

/// A joint whose frame ends because another one's set-point in it was withdrawn hears nothing, wherever it goes
/// meanwhile: it begins where it then stands.
#[test]
fn a_joint_whose_frame_ended_begins_where_it_stands() {
    let mut bench = Bench::reading("leg", &|path| {
        let text = common::read(path)?;
        if !path.ends_with("leg/robot.toml") {
            return Ok(text);
        }
        let text = text.replace("enable = \"automatic\"", "enable = \"operator\"");
        let lines = text.split_inclusive('\n');
        Ok(lines
            .filter(|line| !line.starts_with("control = {"))
            .collect())
    });
    bench.run(300);
    bench.ask(OperatorRequest::Enable);
    bench.run(50);
    assert_eq!(engaged(bench.cycle.record()), 6);
    // The ankle falls silent, and shares a frame with the knee.
    let ankle = KNEE + 1;
    let is_ankles = |slot| slot == slots::motor_angle(ankle);
    let table = bench.robot.receive.clone();
    let held = bench.cycle.record().commanded.joints[KNEE].q_c;
    for k in 0..300 {
        bench.gather();
        if k < 50 {
            bench.drop_answers(|frame| {
                let message = table.classify(frame);
                message.is_some_and(|message| table.slots(message).any(is_ankles))
            });
        }
        bench.compute(&ClientInput::default());
        if k > 60 {
            assert!(!bench.sent_set_points(|frame| frame.bus == 1), "cycle {k}");
            assert_eq!(engaged(bench.cycle.record()), 3);
            // Others move the knee.
            let to = held - 0.3 * f64::from(k - 60) / 239.0;
            bench.plant.robot_mut().command(KNEE, to);
        }
    }
    bench.run(50);
    let stands = bench.plant.truth().joints[KNEE].q;
    assert!((stands - held).abs() > 0.2, "{stands} {held}");
    let fault = bench.cycle.record().fault;
    assert_eq!(fault, Event::JointStale.number());
    bench.ask(OperatorRequest::Acknowledge(fault));
    bench.ask(OperatorRequest::Enable);
    let mut motion = Motion::of(&bench);
    run(&mut bench, &mut motion, 300);
    assert_eq!(state(bench.cycle.record()), RobotState::Holding);
    assert_eq!(engaged(bench.cycle.record()), 6);
    motion.assert_small("enabled again");
}
