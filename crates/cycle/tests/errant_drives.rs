//! Drives that err themselves: the drive's own loop, its frames and the loop see the same, and several err in
//! one cycle. True motion is judged.

use crate::common;

use common::motion::{Motion, state};
use common::{Bench, client_input, read, spoil};
use cycle::{ClientInput, OperatorRequest};
use plant::DriveFaults;
use robot_config::slots;
use robot_state::{DriveState, Event, Mode, Reference, RobotState, refusal};

/// The leg, in front of an operator.
fn leg() -> Bench {
    robot("leg")
}

fn robot(name: &str) -> Bench {
    Bench::reading(name, &|path| {
        let text = read(path)?;
        Ok(text.replace("enable = \"automatic\"", "enable = \"operator\""))
    })
}

/// Changes the faults of some joints' drives.
fn err(bench: &mut Bench, joints: &[usize], change: impl Fn(&mut DriveFaults)) {
    for &joint in joints {
        change(bench.plant.robot_mut().drive_faults(joint).unwrap());
    }
}

/// A robot that holds, or that follows a client in a mode where it stands.
fn in_mode(mode: Mode) -> (Bench, Option<Reference>) {
    bring_into(mode, leg())
}

fn bring_into(mode: Mode, mut bench: Bench) -> (Bench, Option<Reference>) {
    bench.run(300);
    bench.ask(OperatorRequest::Enable);
    bench.run(600);
    assert_eq!(state(bench.cycle.record()), RobotState::Holding);
    if mode == Mode::Hold {
        return (bench, None);
    }
    let hold = bench.reference(Mode::Hold.number(), 1);
    bench.step(&client_input(&hold));
    let mut reference = bench.reference(mode.number(), 2);
    let estimated = bench.cycle.record().estimated;
    if mode == Mode::Torque {
        for (joint, estimated) in reference.joints.iter_mut().zip(&estimated.joints) {
            joint.tau_d = estimated.tau_hat.tau;
        }
    }
    for _ in 0..2000 {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    assert_eq!(state(bench.cycle.record()), RobotState::Active);
    (bench, Some(reference))
}

/// Goes on for so many cycles; the true motion since the beginning.
fn go_on(bench: &mut Bench, mut reference: Option<Reference>, cycles: usize) -> Motion {
    let mut motion = Motion::of(bench);
    for _ in 0..cycles {
        match &mut reference {
            Some(reference) => {
                reference.sequence += 1;
                bench.step(&client_input(reference));
            }
            None => _ = bench.step(&ClientInput::default()),
        }
        motion.take(bench);
    }
    motion
}

/// Every pair of the leg's joints, and all of them.
fn pairs_and_all() -> Vec<Vec<usize>> {
    let mut sets = vec![(0..6).collect()];
    for a in 0..6 {
        for b in a + 1..6 {
            sets.push(vec![a, b]);
        }
    }
    sets
}

/// Goes wrong in one cycle.
type Change = fn(&mut DriveFaults);

/// What drives make of their set-points.
const STRAYING: [(&str, Change); 3] = [
    ("go to 0", |f| f.set_point.scale = 0.0),
    ("mirror", |f| f.set_point.scale = -1.0),
    ("are offset", |f| f.set_point.offset = 0.1),
];

/// Whatever joints stray in one cycle, each is switched off by its own condition. What they move until then is
/// what one that strays alone does: a millisecond until it shows, one or two samples, the drive's step, its brake.
fn each_is_switched_off((name, change): (&str, Change)) {
    for joints in pairs_and_all() {
        let (mut bench, reference) = in_mode(Mode::Hold);
        let stand_at_0 = |j: &usize| bench.cycle.record().measured.joints[*j].q.abs() < 0.01;
        // A joint that stands at 0 does not stray by going there.
        let unmoved: Vec<bool> = joints.iter().map(stand_at_0).collect();
        err(&mut bench, &joints, change);
        let motion = go_on(&mut bench, reference, 400);
        let what = format!("{joints:?} {name}");
        assert!(
            motion.displacement_deg() < 1.0,
            "{what}: {:.2} deg",
            motion.displacement_deg()
        );
        assert!(
            motion.speed_share() < 0.35,
            "{what}: {:.2}",
            motion.speed_share()
        );
        let record = bench.cycle.record();
        for (&j, unmoved) in joints.iter().zip(unmoved) {
            let state = DriveState::from_number(record.commanded.joints[j].drive_state);
            let off = state == Some(DriveState::Off);
            assert!(
                off || unmoved && name != "are offset",
                "{what}: joint {j} is {state:?}"
            );
        }
    }
}

#[test]
fn of_drives_that_go_to_zero_in_one_cycle_each_is_switched_off() {
    each_is_switched_off(STRAYING[0]);
}

#[test]
fn of_drives_that_mirror_their_set_points_in_one_cycle_each_is_switched_off() {
    each_is_switched_off(STRAYING[1]);
}

#[test]
fn of_drives_whose_set_points_are_offset_in_one_cycle_each_is_switched_off() {
    each_is_switched_off(STRAYING[2]);
}

/// Within 1 degree and 10 % of the velocity limit, and by a fault.
fn assert_stopped(bench: &Bench, motion: &Motion, what: &str) {
    motion.assert_small(what);
    assert_eq!(state(bench.cycle.record()), RobotState::Fault, "{what}");
}

/// The drive's loop runs on the motor encoder that errs: a set-point that stands moves the joint.
#[test]
fn a_joint_whose_motor_encoder_drifts_in_its_own_drive_is_left_to_its_brake() {
    for (mode, drifts) in [
        (Mode::Hold, &[0.6, 2.0, 6.0][..]),
        (Mode::Torque, &[0.6, 6.0]),
        (Mode::Passive, &[2.0]),
    ] {
        for &drift in drifts {
            for joint in [3, 5] {
                let (mut bench, reference) = in_mode(mode);
                let rate = 100.0 * f64::to_radians(drift);
                err(&mut bench, &[joint], |f| f.motor.rate = rate);
                let motion = go_on(&mut bench, reference, 1500);
                let what = format!("{mode:?}, joint {joint} drifts at {drift} deg/s");
                assert_stopped(&bench, &motion, &what);
            }
        }
    }
}

/// A screw is so stiff that a drive's encoder that drifts leaves what it can wind up within 10 ms: there is no torque
/// by torsion then, and yet it is at least the greatest.
#[test]
fn a_lift_whose_drives_encoder_drifts_quickly_is_left_to_its_brake() {
    for mode in [Mode::Passive, Mode::InverseDynamics] {
        let mut bench = robot("lift-gripper");
        // The simulated hand has pushed by then.
        bench.run(8000);
        let (mut bench, reference) = bring_into(mode, bench);
        let rate = 100.0 * f64::to_radians(6.0);
        err(&mut bench, &[0], |f| f.motor.rate = rate);
        let motion = go_on(&mut bench, reference, 1500);
        // Its velocity is the drive's own until that is switched off (docs/safety-limits.md).
        let (way, share) = (motion.displacement_deg(), motion.speed_share());
        assert!(
            way < 1.0 && share < 0.12,
            "{mode:?}: {way:.2} deg, {share:.3}"
        );
        assert_eq!(state(bench.cycle.record()), RobotState::Fault, "{mode:?}");
    }
}

#[test]
fn joints_whose_motor_encoders_are_stuck_in_their_own_drives_do_not_run_away() {
    for mode in [Mode::Torque, Mode::Passive] {
        for joints in [vec![3], (0..6).collect()] {
            let (mut bench, reference) = in_mode(mode);
            for &joint in &joints {
                let theta = bench.plant.truth().joints[joint].theta;
                err(&mut bench, &[joint], |f| f.motor.stuck = Some(theta));
            }
            let motion = go_on(&mut bench, reference, 1500);
            // The drive presses with what its loop asked for last, and has no damping: it moves until 210 is latched.
            let (way, share) = (motion.displacement_deg(), motion.speed_share());
            let what = format!("{mode:?}, {joints:?} stuck: {way:.2} deg, {share:.3}");
            assert!(way < 1.5 && share < 0.25, "{what}");
        }
    }
}

/// Its own time-out ends a drive that hears no control words, as its frame ends. Until then it runs: 5 ms in which it
/// may only be slow to switch off, and its time limit.
#[test]
fn a_drive_that_runs_away_and_hears_no_control_words_is_left_to_its_time_out() {
    let (mut bench, _) = in_mode(Mode::Hold);
    for joint in 0..6 {
        let states = bench.plant.drive_states(joint).unwrap();
        states.set_command_timeout(Some(0.02));
    }
    err(&mut bench, &[3], |f| {
        (f.deaf, f.set_point.scale) = (true, 0.0)
    });
    let started = bench.plant.truth().joints[3].q;
    let ended = (0..400).find(|_| {
        bench.step(&ClientInput::default());
        !bench.sent_set_points(|frame| frame.bus == 1)
    });
    assert!(
        ended.is_some_and(|k| k < 15),
        "its frame ends after {ended:?}"
    );
    bench.run(300);
    let status = bench.plant.drive_states(3).unwrap().status();
    assert_eq!(status & 0x4f, 0x08, "the drive has stopped by itself");
    let way = (bench.plant.truth().joints[3].q - started).to_degrees();
    assert!(way.abs() < 15.0, "{way:.1} deg of the 50 to where it goes");
}

#[test]
fn drives_that_keep_a_target_of_their_own_are_sent_where_they_stand_before_they_are_enabled() {
    let mut bench = leg();
    err(&mut bench, &[0, 1, 2, 3, 4, 5], |f| f.keeps_target = true);
    bench.run(300);
    bench.ask(OperatorRequest::Enable);
    let motion = go_on(&mut bench, None, 600);
    motion.assert_small("targets kept");
    assert_eq!(state(bench.cycle.record()), RobotState::Holding);
}

#[test]
fn at_the_first_enabling_drives_that_follow_something_else_are_switched_off_and_none_is_said_to_hold()
 {
    for scale in [0.0, -1.0] {
        let mut bench = leg();
        let all = [0, 1, 2, 3, 4, 5];
        err(&mut bench, &all, |f| f.set_point.scale = scale);
        bench.run(300);
        bench.ask(OperatorRequest::Enable);
        let mut motion = Motion::of(&bench);
        for _ in 0..600 {
            bench.step(&ClientInput::default());
            motion.take(&bench);
            assert_ne!(state(bench.cycle.record()), RobotState::Holding, "{scale}");
        }
        assert_stopped(&bench, &motion, &format!("set-points times {scale}"));
        let fault = bench.cycle.record().fault;
        assert_eq!(fault, Event::FollowingError.number());
    }
}

/// A zero that is lost within the gear's wind-up while the drive was silent: the torsion is one that the gear can
/// have, but not under this weight.
#[test]
fn a_joint_whose_torsion_does_not_fit_its_weight_is_not_enabled() {
    for error in [0.003, -0.003, 0.002] {
        let (mut bench, _) = in_mode(Mode::Hold);
        for k in 0..5 {
            bench.gather();
            if k == 1 {
                bench.plant.drive_states(3).unwrap().set_power(false);
                err(&mut bench, &[3], |f| f.motor.offset = 100.0 * error);
            }
            if k == 3 {
                bench.plant.drive_states(3).unwrap().set_power(true);
            }
            bench.drop_answers(|frame| frame.bus == 1);
            bench.compute(&ClientInput::default());
        }
        bench.run(300);
        let fault = bench.cycle.record().fault;
        assert_eq!(fault, Event::DriveLost.number());
        bench.ask(OperatorRequest::Acknowledge(fault));
        bench.run(300);
        bench.ask(OperatorRequest::Enable);
        let motion = go_on(&mut bench, None, 600);
        motion.assert_small(&format!("zero lost by {error}"));
        let record = bench.cycle.record();
        assert_eq!(state(record), RobotState::Ready, "{error}");
        assert_eq!(record.refusal, refusal::UNFIT << 16 | 3, "{error}");
    }
}

#[test]
fn a_status_word_that_is_wrong_once_switches_nothing_off() {
    let (mut bench, _) = in_mode(Mode::Hold);
    for k in 0..200 {
        bench.gather();
        if k % 50 == 0 {
            spoil(&mut bench, 3, |now| now[slots::status(3)] = 8.0);
        }
        bench.compute(&ClientInput::default());
    }
    assert_eq!(state(bench.cycle.record()), RobotState::Holding);
}

/// Both encoders of joints stop in their drives as well, whose loops then press on. In motion the frames show a motor
/// that stands at once, which no torque can make it do; where it turns back, a torque that winds no gear up.
#[test]
fn joints_in_motion_whose_encoders_both_stop_are_switched_off() {
    let of_a_period = [(0.25, 0.8), (0.5, 0.0), (0.95, 0.0)];
    let joints: [(&[usize], f64); 6] = [
        (&[2], 0.5),
        (&[3], 0.3),
        (&[3], 1.0),
        (&[5], 0.5),
        (&[2, 3, 4], 0.5),
        (&[0, 1, 2, 3, 4, 5], 0.3),
    ];
    for (joints, speed) in joints {
        for when in of_a_period {
            stop_both_encoders(joints, speed, when);
        }
    }
}

fn stop_both_encoders(joints: &[usize], speed: f64, (part, least): (f64, f64)) {
    let mut bench = leg();
    bench.run(300);
    bench.ask(OperatorRequest::Enable);
    bench.run(600);
    let hold = bench.reference(Mode::Hold.number(), 1);
    bench.step(&client_input(&hold));
    let mut reference = bench.reference(Mode::InverseDynamics.number(), 2);
    reference.contact_wrench_given = 1;
    let start = reference.joints;
    let mut now = 0.0;
    let rate = 4.0 * speed;
    let mut step = |bench: &mut Bench| {
        now += 1e-3;
        for &joint in joints {
            // Half a radian back and forth.
            let asked = &mut reference.joints[joint];
            asked.q_d = start[joint].q_d + speed / rate * (1.0 - f64::cos(rate * now));
            asked.dq_d = speed * f64::sin(rate * now);
            asked.ddq_d = speed * rate * f64::cos(rate * now);
        }
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    };
    let when = part * std::f64::consts::TAU / rate;
    (0..(1e3 * when) as usize).for_each(|_| step(&mut bench));
    let before = bench.plant.truth().joints.clone();
    for &joint in joints {
        let dq = before[joint].dq;
        assert!(dq.abs() >= least * speed, "{joint}: {dq}");
        err(&mut bench, &[joint], |f| {
            (f.motor.stuck, f.link.stuck) = (Some(before[joint].theta), Some(before[joint].q));
        });
    }
    let (mut way, mut faster) = (0.0_f64, 0.0_f64);
    for _ in 0..1000 {
        step(&mut bench);
        for (j, now) in bench.plant.truth().joints.iter().enumerate() {
            let limit = bench.robot.parameters.joints[j].limits.velocity;
            way = way.max((now.q - before[j].q).abs().to_degrees());
            faster = faster.max((now.dq.abs() - before[j].dq.abs()) / limit);
        }
    }
    let record = bench.cycle.record();
    let what = format!("joints {joints:?} at {speed}, {part}: {way:.2} deg, {faster:.3} faster");
    assert_eq!(record.fault, Event::EncoderImplausible.number(), "{what}");
    // A torque that friction bears moves nothing.
    for &joint in joints {
        let is_off = record.commanded.joints[joint].drive_state == DriveState::Off.number();
        let stands = bench.plant.truth().joints[joint].dq.abs() < 1e-4;
        assert!(is_off || joints.len() > 1 && stands, "{joint}: {what}");
    }
    // Without a brake that acts at once they go on at the speed that they had.
    assert!(way < 1.5 && faster < 0.25, "{what}");
}

/// Both encoders slip as one while samples stay away. Their filters see a joint that has run, and whoever believed them
/// would move it by more than the slip.
#[test]
fn encoders_that_slip_as_one_in_a_gap_of_samples_are_no_motion() {
    const KNEE: usize = 3;
    const SLIP: f64 = 0.05;
    for mode in [Mode::Torque, Mode::InverseDynamics, Mode::Passive] {
        let (mut bench, reference) = in_mode(mode);
        let mut reference = reference.unwrap();
        let ratio = bench.robot.parameters.joints[KNEE].encoders.gear_ratio;
        let mut motion = Motion::of(&bench);
        for cycle in 0..400 {
            bench.gather();
            if cycle < 10 {
                bench.drop_answers(|_| true);
            }
            spoil(&mut bench, KNEE, |now| {
                now[slots::link_angle(KNEE)] += SLIP;
                now[slots::motor_angle(KNEE)] += SLIP * ratio;
            });
            reference.sequence += 1;
            bench.compute(&client_input(&reference));
            motion.take(&bench);
        }
        assert_ne!(bench.cycle.record().fault, 0, "{mode:?}");
        let (way, speed) = (motion.displacement_deg(), motion.speed_share());
        assert!(way < 1.0 && speed < 0.35, "{mode:?}: {way} deg, {speed}");
    }
}
