//! Drives that take currents: whatever one sensor shows, a joint is held where it is, and one that
//! moves is brought to rest and left to its brake.

use crate::common;

use common::motion::{Motion, state};
use common::{Bench, client_input, current_drive, read_with_current_drive, spoil};
use cycle::ClientInput;
use robot_config::slots;
use robot_state::{DriveState, Event, Mode, Reference, RobotState};

/// Natural frequency and damping ratio of the joint under its position feedback.
const FREQUENCY: f64 = std::f64::consts::TAU * 3.0;
const RATIO: f64 = 1.0;

/// The test joint with a drive that takes currents, and a brake; without torque feedback.
fn braked() -> Bench {
    let joint = &current_drive().robot.parameters.joints[0];
    let rotor = joint.rotor_inertia * joint.encoders.gear_ratio.powi(2);
    let inertia = rotor + joint.link_inertia;
    let k_s = inertia * FREQUENCY.powi(2);
    let k_d = 2.0 * RATIO * FREQUENCY * inertia;
    Bench::reading("test-joint", &|path| {
        let text = read_with_current_drive(path)?;
        let profile = "profile = \"cia402\"";
        let text = text.replace(profile, &format!("{profile}\nbrake = \"while_off\""));
        let gains = "K_p = 2.0, K_s_Nm_per_rad = 1389.0, K_d_Nms_per_rad = 13.9";
        let mine = format!("K_p = 0.0, K_s_Nm_per_rad = {k_s}, K_d_Nms_per_rad = {k_d}");
        Ok(text.replace(gains, &mine))
    })
}

/// Reading of a sensor, from its values at the beginning, its values now and the cycle.
type Lie = fn(&mut [f64], &[f64], usize);

const LINK: usize = slots::link_angle(0);
const MOTOR: usize = slots::motor_angle(0);

const LIES: [(&str, Lie); 10] = [
    ("link encoder drifts slowly", |now, _, k| {
        now[LINK] += 1e-5 * k as f64
    }),
    ("link encoder drifts", |now, _, k| {
        now[LINK] += 1e-4 * k as f64
    }),
    ("motor encoder drifts", |now, _, k| {
        now[MOTOR] += 1e-2 * k as f64
    }),
    ("link encoder flat", |now, first, _| now[LINK] = first[LINK]),
    ("motor encoder flat", |now, first, _| {
        now[MOTOR] = first[MOTOR]
    }),
    ("link encoder reversed", |now, first, _| {
        now[LINK] = 2.0 * first[LINK] - now[LINK]
    }),
    ("link encoder slips", |now, _, _| now[LINK] += 0.03),
    ("motor encoder slips", |now, _, _| now[MOTOR] -= 1.0),
    // 8 % of the torque limit: found by nobody.
    ("link encoder slips a little", |now, _, _| {
        now[LINK] += 0.0004
    }),
    ("link encoder trembles", |now, _, k| {
        now[LINK] += if k % 2 == 0 { 0.01 } else { -0.01 }
    }),
];

/// One cycle with a lie from cycle 0 on.
fn step(bench: &mut Bench, input: &ClientInput<'_>, lie: Lie, first: &mut Vec<f64>, k: usize) {
    bench.gather();
    if first.is_empty() {
        *first = vec![0.0; slots::receive_len(&bench.robot.parameters)];
        for frame in bench.rx.iter() {
            bench.robot.receive.decode(frame, first).unwrap();
        }
    }
    spoil(bench, 0, |now| lie(now, first, k));
    bench.compute(input);
}

#[test]
fn a_hold_follows_no_single_encoder() {
    for (what, lie) in LIES {
        let mut bench = braked();
        bench.run(900);
        assert_eq!(state(bench.cycle.record()), RobotState::Holding);
        let mut motion = Motion::of(&bench);
        let mut first = Vec::new();
        for k in 0..2500 {
            step(&mut bench, &ClientInput::default(), lie, &mut first, k);
            motion.take(&bench);
        }
        motion.assert_small(what);
        let fault = bench.cycle.record().fault;
        if fault != 0 {
            assert_eq!(fault, Event::EncoderImplausible.number(), "{what}");
            let drive = bench.cycle.record().commanded.joints[0].drive_state;
            assert_eq!(
                drive,
                DriveState::Off.number(),
                "{what}: its brake holds it"
            );
        }
    }
}

/// The joint at about 1.5 rad/s under a client's torque.
fn moving(bench: &mut Bench) -> Reference {
    bench.run(600);
    let mut reference = bench.reference(Mode::Hold.number(), 1);
    bench.step(&client_input(&reference));
    (reference.mode, reference.joints[0].tau_d) = (Mode::Torque.number(), 12.0);
    for _ in 0..2000 {
        reference.sequence += 1;
        bench.step(&client_input(&reference));
        if bench.plant.truth().joints[0].dq > 1.5 {
            return reference;
        }
    }
    panic!("{} rad/s", bench.plant.truth().joints[0].dq);
}

#[test]
fn a_joint_that_moves_is_brought_to_rest_whichever_encoder_has_failed() {
    for (what, lie) in LIES {
        let mut bench = braked();
        let mut reference = moving(&mut bench);
        let before = bench.plant.truth().joints[0];
        let (mut first, mut fastest, mut faulty) = (Vec::new(), before.dq.abs(), None);
        for k in 0..2500 {
            reference.sequence += 1;
            reference.mode = Mode::Hold.number();
            let input = client_input(&reference);
            step(&mut bench, &input, lie, &mut first, k);
            fastest = fastest.max(bench.plant.truth().joints[0].dq.abs());
            if bench.cycle.record().fault != 0 {
                faulty.get_or_insert(k);
            }
        }
        let joint = &bench.plant.truth().joints[0];
        assert!(joint.dq.abs() < 0.01, "{what}: {} rad/s", joint.dq);
        assert!(fastest < 1.3 * before.dq, "{what}: {fastest} rad/s");
        let way = (joint.q - before.q).abs();
        assert!(
            way < 0.6 * before.dq,
            "{what}: {way} rad, fault after {faulty:?} ms"
        );
    }
}

/// The client's next millisecond: up to 0.3 rad/s within 0.2 s.
fn ramp(reference: &mut Reference) {
    let joint = &mut reference.joints[0];
    joint.dq_d = (joint.dq_d + 0.3 / 200.0).min(0.3);
    joint.q_d += 1e-3 * joint.dq_d;
}

#[test]
fn encoders_that_are_both_flat_are_found_by_a_torque_that_moves_nothing() {
    let mut bench = braked();
    let mut reference = bench.follow();
    let flat: Lie = |now, first, _| (now[LINK], now[MOTOR]) = (first[LINK], first[MOTOR]);
    let (mut first, mut fastest, mut found) = (Vec::new(), 0.0_f64, None);
    for k in 0..1500 {
        reference.sequence += 1;
        ramp(&mut reference);
        let input = client_input(&reference);
        if k < 500 {
            bench.step(&input);
            continue;
        }
        let mode = bench.cycle.record().mode;
        assert!(k > 500 || mode == Mode::InverseDynamics.number());
        step(&mut bench, &input, flat, &mut first, k);
        fastest = fastest.max(bench.plant.truth().joints[0].dq.abs());
        if bench.cycle.record().fault == Event::EncoderImplausible.number() {
            found.get_or_insert(k - 500);
        }
    }
    let fault = bench.cycle.record().fault;
    assert!(
        found.is_some_and(|ms| ms < 100),
        "{found:?} ms, fault {fault}"
    );
    assert!(fastest < 0.3 + 0.1 * 6.0, "{fastest} rad/s");
    assert!(bench.plant.truth().joints[0].dq.abs() < 0.01);
}

#[test]
fn a_client_that_ends_in_motion_leaves_no_step_of_torque() {
    let mut bench = braked();
    let mut reference = bench.follow();
    let limit = bench.robot.parameters.joints[0].limits.torque;
    let mut taus = Vec::new();
    for k in 0..1500 {
        reference.sequence += 1;
        ramp(&mut reference);
        if k < 1000 {
            bench.step(&client_input(&reference))
        } else {
            bench.step(&ClientInput::default())
        };
        let moves = bench.plant.truth().joints[0].dq > 0.25;
        assert!(k != 999 || moves, "it moves until the client ends");
        taus.push(bench.plant.truth().joints[0].tau);
    }
    let step = |from: usize, to: usize| {
        let pairs = (from..to).map(|k| (taus[k + 5] - taus[k]).abs() / limit);
        pairs.fold(0.0, f64::max)
    };
    let (before, after) = (step(700, 990), step(990, 1490));
    assert!(
        after < before + 0.05,
        "{after}, {before} of the torque limit"
    );
    assert_eq!(state(bench.cycle.record()), RobotState::Holding);
    assert!(bench.plant.truth().joints[0].dq.abs() < 0.01);
}

#[test]
fn a_withdrawn_drive_keeps_no_current_though_its_status_was_wrong_for_two_cycles() {
    // Without control words nothing but a set-point of zero ends the last one.
    for lost in [0, 1, 3, 50] {
        let mut bench = Bench::reading("test-joint", &|path| {
            let text = read_with_current_drive(path)?;
            let lines = text.split_inclusive('\n');
            let kept = lines.filter(|line| !line.starts_with("control = {"));
            Ok(kept.collect())
        });
        bench.run(600);
        assert_eq!(state(bench.cycle.record()), RobotState::Holding);
        assert!(
            bench.plant.robot_mut().set_point(0).abs() > 0.5,
            "it bears a load"
        );
        for k in 0..=lost + 1 {
            bench.gather();
            if k < 2 {
                // A CiA 402 drive in fault; one such word alone may be wrong.
                spoil(&mut bench, 0, |now| now[slots::status(0)] = 8.0);
            }
            bench.compute_deaf(&ClientInput::default(), |_| k > 0 && k <= lost);
        }
        assert_ne!(bench.cycle.record().fault, 0);
        bench.run(2);
        let left = bench.plant.robot_mut().set_point(0);
        assert_eq!(left, 0.0, "{lost} cycles of commands lost");
    }
}

#[test]
fn a_current_drive_under_a_constant_torque_stays_within_its_limits() {
    for tau_d in [30.0, -30.0] {
        let mut bench = current_drive();
        bench.run(400);
        assert_eq!(state(bench.cycle.record()), RobotState::Holding);
        let limits = bench.robot.parameters.joints[0].limits;
        let mut reference = bench.reference(Mode::Torque.number(), 1);
        reference.joints[0].tau_d = tau_d;
        let mut fastest: f64 = 0.0;
        for _ in 0..4000 {
            reference.sequence += 1;
            bench.step(&client_input(&reference));
            let joint = &bench.plant.truth().joints[0];
            fastest = fastest.max(joint.dq.abs());
            let margin = 2f64.to_radians();
            let inside =
                joint.q < limits.position_max + margin && joint.q > limits.position_min - margin;
            assert!(inside, "{tau_d} N·m: {} rad", joint.q);
        }
        assert!(
            fastest < 1.2 * limits.velocity,
            "{tau_d} N·m: {fastest} rad/s"
        );
        let rest = bench.plant.truth().joints[0].dq;
        assert!(rest.abs() < 0.1, "{tau_d} N·m: {rest} rad/s at the end");
        assert_eq!(bench.cycle.record().fault, 0);
    }
}
