//! Drives that do not follow their set-points are found and switched off; drives that do, at work,
//! stay far from the limits. Withdrawn joints do not silence others, and no drive keeps a current.

use crate::common;

use can_codec::{Frame, Frames};
use common::motion::state;
use common::{Bench, client_input, read, spoil};
use cycle::{ClientInput, OperatorRequest};
use robot_config::slots;
use robot_state::{DriveState, Event, Mode, Reference, RobotState, command_flags};

/// One cycle in which the drive of a joint takes another set-point than was sent.
fn step_altered(
    bench: &mut Bench,
    input: &ClientInput<'_>,
    joint: usize,
    alter: impl Fn(f64) -> f64,
) {
    bench.gather();
    bench.tx.clear();
    let at = bench.instants();
    bench.cycle.step(at, &bench.rx, input, &mut bench.tx);
    let table = &bench.robot.send;
    let mut values = vec![f64::NAN; slots::send_len(&bench.robot.parameters)];
    let mut heard = Frames::default();
    for mut frame in bench.tx.iter().copied() {
        values.fill(f64::NAN);
        let message = table.decode(&frame, &mut values).unwrap().unwrap();
        let slot = &mut values[slots::command(joint)];
        *slot = alter(*slot);
        assert!(table.encode(message, &values, &mut frame));
        heard.push(frame);
    }
    let mut answers = Frames::default();
    bench.plant.exchange(&heard, bench.now, &mut answers);
}

/// A reference that moves every joint but the humanoid's legs; `t` in s.
fn swing(bench: &Bench, reference: &mut Reference, q0: &[f64], t: f64, radians: f64) {
    let w = std::f64::consts::TAU * 0.5;
    let humanoid = bench.robot.parameters.name == "humanoid";
    for ((joint, q0), parameters) in
        (reference.joints.iter_mut().zip(q0)).zip(&bench.robot.parameters.joints)
    {
        let name = &parameters.name;
        if humanoid && !(name.contains("shoulder") || name.contains("elbow")) {
            continue;
        }
        joint.q_d = q0 + radians * (1.0 - (w * t).cos());
        joint.dq_d = radians * w * (w * t).sin();
        joint.ddq_d = radians * w * w * (w * t).cos();
    }
    reference.sequence += 1;
}

#[test]
fn a_drive_that_does_not_follow_ends_the_mode_and_one_that_runs_away_is_switched_off() {
    const KNEE: usize = 3;
    for what in ["deaf", "runaway"] {
        let mut bench = Bench::new("leg");
        let mut reference = bench.follow();
        let q0: Vec<f64> = reference.joints.iter().map(|j| j.q_d).collect();
        let mut deaf_at = None;
        let mut fault_at = None;
        for k in 0..1500 {
            swing(&bench, &mut reference, &q0, f64::from(k) * 1e-3, 0.15);
            let input = client_input(&reference);
            let sent = bench.cycle.record().commanded.joints[KNEE].q_c;
            let kept = *deaf_at.get_or_insert(sent);
            if k < 200 {
                deaf_at = None;
            }
            step_altered(&mut bench, &input, KNEE, |set_point| match what {
                _ if k < 200 || set_point.is_nan() => set_point,
                "deaf" => kept,
                _ => kept + 1e-3 * f64::from(k - 200),
            });
            if bench.cycle.record().fault != 0 {
                fault_at = fault_at.or(Some((k, bench.plant.truth().joints[KNEE].q)));
            }
        }
        let record = *bench.cycle.record();
        // First the mode ends; what then shows that the drive does not follow switches it off.
        let fault = Event::from_number(record.fault);
        assert_eq!(fault, Some(Event::FollowingDoubtful), "{what}");
        let events = record.events;
        assert!(events[Event::FollowingError.index()] > 0, "{what}");
        assert_eq!(record.fault_subject, 1 << 16 | KNEE as u32);
        let (k, _) = fault_at.unwrap();
        assert!(k < 400, "{what}: found after {} cycles", k - 200);
        let drive = |j: usize| DriveState::from_number(record.commanded.joints[j].drive_state);
        assert_eq!(drive(KNEE), Some(DriveState::Off));
        for other in [0, 1, 2, 4, 5] {
            assert_eq!(drive(other), Some(DriveState::Enabled));
        }
        // Ankle and knee share a message: the ankle is still held.
        assert!(bench.sent_set_points(|frame| frame.bus == 1));
    }
}

#[test]
fn drives_at_work_stay_far_from_a_following_error() {
    for (robot, mode) in [
        ("test-joint", Mode::InverseDynamics),
        ("leg", Mode::InverseDynamics),
        ("leg", Mode::Torque),
        ("humanoid", Mode::InverseDynamics),
    ] {
        let mut bench = Bench::new(robot);
        let mut reference = bench.follow();
        let q0: Vec<f64> = reference.joints.iter().map(|j| j.q_d).collect();
        let mut greatest: f64 = 0.0;
        for k in 0..4000 {
            swing(&bench, &mut reference, &q0, f64::from(k) * 1e-3, 0.15);
            reference.mode = mode.number();
            let record = *bench.step(&client_input(&reference));
            let joints = record.commanded.joints.iter().zip(&record.measured.joints);
            for ((commanded, measured), p) in joints.zip(&bench.robot.parameters.joints) {
                let limit = p.following.limit + p.following.per_velocity * measured.dq.abs();
                greatest = greatest.max(commanded.following_error.abs() / limit);
            }
        }
        let events = bench.cycle.record().events;
        assert_eq!(events[Event::FollowingError.index()], 0, "{robot} {mode:?}");
        assert!(greatest < 0.7, "{robot} {mode:?}: {greatest} of the limit");
    }
}

/// The test joint with a drive that takes currents, with another key in its drive's table.
fn current_drive(key: &str) -> Bench {
    let read = |path: &str| {
        let text = read(path)?;
        Ok(if path.ends_with("config/test-joint/robot.toml") {
            let from = text.find("K_tau_rad_per_Nm").unwrap();
            let to = text.find("sign_smoothing_rad_per_s").unwrap();
            let motor = "K_1_Nm_per_A = 5.0\nK_2_Nms_per_rad = 0.1\nK_3_Nm = 1.5\n";
            let text = format!("{}{motor}{}", &text[..from], &text[to..]);
            let current = format!("command = \"current\"\ncurrent_limit_A = 7.4\n{key}");
            text.replace("command = \"position\"", &current)
        } else if path.ends_with("drives.dbc") {
            let from = text.find("SG_ joint_position").unwrap();
            let line = text[from..].lines().next().unwrap();
            text.replace(
                line,
                "SG_ joint_position : 0|32@1- (1,0) [0|0] \"mA\" DRIVES",
            )
        } else {
            text
        })
    };
    Bench::reading("test-joint", &read)
}

#[test]
fn a_current_drive_that_falls_silent_is_sent_no_current_until_it_is_off() {
    for (key, zero) in [("", true), ("withdrawn = \"none\"", false)] {
        let mut bench = current_drive(key);
        bench.run(400);
        assert_eq!(state(bench.cycle.record()), RobotState::Holding);
        let mut sent = Vec::new();
        for _ in 0..100 {
            bench.gather();
            bench.drop_answers(|_| true);
            bench.compute(&ClientInput::default());
            if bench.cycle.record().fault == 0 {
                continue;
            }
            let table = &bench.robot.send;
            let mut values = vec![f64::NAN; slots::send_len(&bench.robot.parameters)];
            for frame in bench.tx.iter() {
                table.decode(frame, &mut values).unwrap();
            }
            sent.push(values[slots::command(0)]);
        }
        assert_eq!(bench.cycle.record().fault, Event::JointStale.number());
        assert!(sent.len() > 50);
        if zero {
            assert!(sent.iter().all(|current| *current == 0.0), "{sent:?}")
        } else {
            assert!(sent.iter().all(|current| current.is_nan()), "{sent:?}")
        }
        // Back again and off: nothing is sent any more.
        bench.run(300);
        assert!(!bench.sent_set_points(|_| true));
    }
}

#[test]
fn a_current_that_is_not_the_commanded_one_is_a_following_error() {
    let mut bench = current_drive("");
    bench.run(400);
    let mut reference = bench.reference(Mode::Torque.number(), 1);
    reference.joints[0].tau_d = 10.0;
    for k in 0..400 {
        reference.sequence += 1;
        let input = client_input(&reference);
        step_altered(&mut bench, &input, 0, |current| match k {
            0..20 => current,
            _ if current.is_nan() => current,
            _ => current + 1.2,
        });
    }
    assert_eq!(bench.cycle.record().fault, Event::FollowingError.number());
}

#[test]
fn a_withdrawn_joint_whose_encoders_contradict_each_other_does_not_withdraw_its_neighbours() {
    // Ankle pitch shares its message with knee and ankle roll; an answer of it is lost now and then.
    let mut bench = Bench::new("leg");
    bench.run(600);
    let idle = ClientInput::default();
    bench.plant.drive_states(4).unwrap().set_power(false);
    let spoilt = |bench: &mut Bench, input: &ClientInput<'_>| {
        bench.gather();
        spoil(bench, 4, |now| now[slots::link_angle(4)] += 0.3);
        *bench.compute(input)
    };
    let fault = (0..100).map(|_| spoilt(&mut bench, &idle).fault).last();
    let acknowledge = ClientInput {
        request: fault.map(OperatorRequest::Acknowledge),
        ..ClientInput::default()
    };
    assert_eq!(spoilt(&mut bench, &acknowledge).fault, 0);
    let before = bench.plant.truth().joints[5].q;
    let table = bench.robot.receive.clone();
    let own = |f: &Frame| {
        let message = table.classify(f);
        message.is_some_and(|m| table.slots(m).any(|slot| slot == slots::motor_angle(4)))
    };
    for k in 0..300 {
        bench.gather();
        spoil(&mut bench, 4, |now| now[slots::link_angle(4)] += 0.3);
        if k % 7 == 3 {
            bench.drop_answers(own);
        }
        let record = *bench.compute(&idle);
        for j in [3, 5] {
            let flags = record.commanded.joints[j].flags;
            assert_ne!(flags & command_flags::ENGAGED, 0, "joint {j}, cycle {k}");
        }
    }
    assert!((bench.plant.truth().joints[5].q - before).abs() < 1e-4);
}
