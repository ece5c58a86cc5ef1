//! References that ask for more than the robot can do or contradict themselves, and what the robot
//! does when a reference ends in motion: whole loop, true motion of the joints.

use crate::common;

use common::motion::{Motion, state};
use common::{Bench, client_input, current_drive};
use cycle::{ClientInput, OperatorRequest};
use robot_state::{CycleRecord, Event, Mode, Reference, RobotState, command_flags};
use std::f64::consts::PI;

type Change = fn(&mut Reference, usize);

/// The robot follows `mode` at rest, with the torques that it carries; then `change` is made to each
/// reference, with its number.
fn misled(mut bench: Bench, mode: Mode, change: Change) -> (Bench, Motion) {
    bench.run(400);
    let mut reference = bench.reference(Mode::Hold.number(), 1);
    reference.contact_wrench_given = 0;
    let carried = bench.cycle.record().estimated.joints;
    let by_sensors = bench.robot.parameters.torque_law.uses_sensors();
    for (joint, torques) in reference.joints.iter_mut().zip(carried) {
        joint.tau_d = if by_sensors {
            torques.tau_whole_body.tau
        } else {
            torques.tau_encoder.tau
        };
    }
    for k in 0..450 {
        if k == 5 {
            reference.mode = mode.number();
        }
        reference.sequence += 1;
        bench.step(&client_input(&reference));
    }
    assert_eq!(bench.cycle.record().mode, mode.number());
    let mut motion = Motion::of(&bench);
    for k in 0..700 {
        let mut misled = reference;
        misled.sequence += 1 + k as u64;
        change(&mut misled, k);
        bench.step(&client_input(&misled));
        motion.take(&bench);
    }
    (bench, motion)
}

#[test]
fn torques_within_their_limits_do_not_count_as_limited() {
    let (mut bench, _) = misled(Bench::new("leg"), Mode::InverseDynamics, |_, _| {});
    let mut reference = bench.reference(Mode::InverseDynamics.number(), 5000);
    for _ in 0..200 {
        reference.sequence += 1;
        let commanded = &bench.step(&client_input(&reference)).commanded;
        for joint in &commanded.joints {
            assert_eq!(joint.flags & command_flags::TORQUE_LIMITED, 0, "{joint:?}");
        }
    }
}

#[test]
fn references_that_ask_for_too_much_release_the_robot_and_move_nothing() {
    use Event::{ReferenceJump as Jump, ReferenceLimit as Limit};
    use Mode::{InverseDynamics as Id, Torque};
    let all: [(&str, Mode, Event, Change); 12] = [
        ("q_d zero", Id, Jump, |r, _| {
            r.joints.iter_mut().for_each(|j| j.q_d = 0.0);
        }),
        ("q_d 1e300", Id, Limit, |r, _| r.joints[0].q_d = 1e300),
        ("q_d steps", Id, Jump, |r, _| r.joints[0].q_d += 0.1),
        ("q_d runs", Id, Jump, |r, k| {
            r.joints[0].q_d += 0.02 * (k + 1) as f64;
        }),
        ("dq_d 1e6", Id, Limit, |r, _| r.joints[0].dq_d = 1e6),
        ("dq_d of half the limit, q_d stands", Id, Limit, |r, _| {
            r.joints[0].dq_d = -2.0;
        }),
        ("dq_d rises, q_d stands", Id, Limit, |r, k| {
            r.joints[0].dq_d = 0.01 * k as f64;
        }),
        ("ddq_d 1e6", Id, Limit, |r, _| r.joints[0].ddq_d = -1e6),
        ("ddq_d beyond torque over inertia", Id, Limit, |r, _| {
            r.joints[0].ddq_d = 2e3;
        }),
        ("a contact force of 1e6 N", Id, Limit, |r, _| {
            r.contact_wrench_given = 1;
            r.contact_wrench[0].force = [0.0, 0.0, 1e6];
        }),
        ("tau_d 1e6", Torque, Limit, |r, _| r.joints[0].tau_d = 1e6),
        ("three times the torque limit", Torque, Limit, |r, _| {
            r.joints[0].tau_d = -3.0 * 233.0;
        }),
    ];
    for (what, mode, event, change) in all {
        for (robot, bench) in [("leg", Bench::new("leg")), ("current", current_drive())] {
            // The test joint has no F/T sensor, and stands at zero.
            if robot == "current"
                && ["a contact", "q_d zero"]
                    .iter()
                    .any(|w| what.starts_with(w))
            {
                continue;
            }
            let (bench, motion) = misled(bench, mode, change);
            let record = bench.cycle.record();
            assert_eq!(state(record), RobotState::Holding, "{robot}: {what}");
            let counted = |event: Event| record.events[event.index()];
            let both = counted(Event::ReferenceJump) + counted(Event::ReferenceLimit);
            assert!(counted(event) > 0 && both <= 700, "{robot}: {what}");
            assert_eq!(record.fault, 0, "{robot}: {what}");
            motion.assert_small(&format!("{robot}: {what}"));
        }
    }
}

#[test]
fn values_that_a_mode_does_not_use_do_not_move_it() {
    for (mode, change) in [
        (
            Mode::Torque,
            (|r, _| {
                let joint = &mut r.joints[0];
                (joint.q_d, joint.dq_d, joint.ddq_d) = (7.0, -1e6, 1e6);
                r.contact_wrench_given = 1;
                r.contact_wrench[0].force = [1e6; 3];
            }) as Change,
        ),
        (Mode::InverseDynamics, |r, _| r.joints[0].tau_d = 1e6),
    ] {
        for bench in [Bench::new("leg"), current_drive()] {
            let (bench, motion) = misled(bench, mode, change);
            assert_eq!(bench.cycle.record().mode, mode.number());
            motion.assert_small(&format!("{mode:?}"));
        }
    }
}

#[test]
fn references_that_jump_or_ask_for_too_much_are_not_followed() {
    for (what, change) in [
        (
            "zeros",
            (|r| r.joints.iter_mut().for_each(|j| j.q_d = 0.0)) as fn(&mut Reference),
        ),
        ("1e300", |r| r.joints[3].q_d = 1e300),
    ] {
        let mut bench = Bench::new("leg");
        bench.run(400);
        let mut motion = Motion::of(&bench);
        let mut reference = bench.reference(Mode::InverseDynamics.number(), 1);
        change(&mut reference);
        for _ in 0..500 {
            reference.sequence += 1;
            bench.step(&client_input(&reference));
            motion.take(&bench);
        }
        let record = bench.cycle.record();
        let refused = [Event::ReferenceJump, Event::ReferenceLimit];
        assert!(refused.iter().any(|event| record.events[event.index()] > 0));
        assert_eq!(record.mode, Mode::Hold.number());
        motion.assert_small(&format!("reference of {what}"));
    }
}

#[test]
fn a_step_of_the_desired_torque_is_limited_in_rate() {
    let mut bench = Bench::new("leg");
    bench.run(400);
    let mut reference = bench.reference(Mode::Torque.number(), 1);
    bench.step(&client_input(&reference));
    let limits = bench.robot.parameters.joints[3].limits;
    reference.joints[3].tau_d = limits.torque;
    let mut last = bench.plant.truth().joints[3].tau;
    let mut greatest: f64 = 0.0;
    for _ in 0..20 {
        reference.sequence += 1;
        let record = *bench.step(&client_input(&reference));
        let flags = record.commanded.joints[3].flags;
        let tau = bench.plant.truth().joints[3].tau;
        greatest = greatest.max((tau - last).abs());
        last = tau;
        let moving = flags & (command_flags::TORQUE_RATE_LIMITED | command_flags::VELOCITY_LIMITED);
        assert!(moving != 0 || tau > 0.5 * limits.torque, "flags {flags}");
    }
    let rate = limits.torque_rate * 1e-3;
    assert!(
        greatest < 3.0 * rate,
        "{greatest} N·m in a cycle, rate {rate}"
    );
}

/// A motion of 0.25 rad at 0.5 Hz in mode inverse dynamics, as a client sends it every `every`
/// milliseconds; `then` acts from half a second on, and returns what the loop gets of the client.
struct Moving {
    bench: Bench,
    reference: Reference,
    q_0: Vec<f64>,
    every: usize,
    k: usize,
}

impl Moving {
    fn new(bench: Bench, every: usize) -> Self {
        let mut bench = bench;
        let mut reference = bench.follow();
        reference.contact_wrench_given = 0;
        let q_0 = reference.joints.iter().map(|joint| joint.q_d).collect();
        let mut this = Self {
            bench,
            reference,
            q_0,
            every,
            k: 0,
        };
        (0..500).for_each(|_| this.step(None));
        assert_eq!(
            this.bench.cycle.record().mode,
            Mode::InverseDynamics.number()
        );
        this
    }

    fn send(&mut self) {
        self.k += 1;
        if !self.k.is_multiple_of(self.every) {
            return;
        }
        let (w, t) = (PI, 1e-3 * self.k as f64);
        let joints = self.bench.robot.parameters.joints.len();
        for (joint, q_0) in self.reference.joints.iter_mut().zip(&self.q_0).take(joints) {
            joint.q_d = q_0 + 0.125 * (1.0 - (w * t).cos());
            joint.dq_d = 0.125 * w * (w * t).sin();
            joint.ddq_d = 0.125 * w * w * (w * t).cos();
        }
        self.reference.sequence += 1;
    }

    fn step(&mut self, request: Option<OperatorRequest>) {
        self.send();
        let input = ClientInput {
            request,
            ..client_input(&self.reference)
        };
        self.bench.step(&input);
    }

    fn taus(&self) -> Vec<f64> {
        self.bench
            .plant
            .truth()
            .joints
            .iter()
            .map(|j| j.tau)
            .collect()
    }

    /// Greatest change of a true torque within 5 ms over 0.4 s, share of the limit, beyond that of
    /// the motion that goes on; `act` does one cycle.
    fn greatest_step(mut self, other: Self, mut act: impl FnMut(&mut Self, usize)) -> (Self, f64) {
        let mut without = other;
        let mut courses = vec![(self.taus(), without.taus())];
        let limits = self.bench.robot.parameters.joints.iter();
        let limits: Vec<f64> = limits.map(|joint| joint.limits.torque).collect();
        let mut greatest: f64 = 0.0;
        for k in 0..400 {
            act(&mut self, k);
            without.step(None);
            courses.push((self.taus(), without.taus()));
            let (then, now) = (&courses[courses.len().saturating_sub(6)], &courses[k + 1]);
            for (j, limit) in limits.iter().enumerate() {
                let change = now.0[j] - then.0[j];
                let expected = now.1[j] - then.1[j];
                let step = change.abs().min((change - expected).abs());
                greatest = greatest.max(step / limit);
            }
        }
        (self, greatest)
    }
}

#[test]
fn a_motion_that_ends_steps_no_torque() {
    type Act = fn(&mut Moving, usize);
    let all: [(&str, RobotState, Act); 4] = [
        ("the client is gone", RobotState::Holding, |moving, _| {
            _ = moving.bench.step(&ClientInput::default());
        }),
        (
            "the client asks for hold",
            RobotState::Holding,
            |moving, _| {
                moving.reference.mode = Mode::Hold.number();
                moving.step(None);
            },
        ),
        ("the operator stops it", RobotState::Holding, |moving, k| {
            moving.step((k == 0).then_some(OperatorRequest::Stop));
        }),
        ("one cycle is skipped", RobotState::Active, |moving, k| {
            if k == 0 {
                moving.bench.gather();
            }
            moving.step(None);
        }),
    ];
    for (what, end, act) in all {
        let new = || Moving::new(Bench::new("leg"), 1);
        let (moving, greatest) = new().greatest_step(new(), act);
        assert_eq!(state(moving.bench.cycle.record()), end, "{what}");
        assert!(greatest < 0.05, "{what}: {:.1} %", 100.0 * greatest);
    }
}

#[test]
fn a_client_is_lost_in_the_first_cycle_in_which_its_reference_is_too_old() {
    for timeout_ms in [2, 40, 1000] {
        let key = format!("reference_timeout_ms = {timeout_ms}");
        let read = |path: &str| {
            let text = common::read(path)?;
            Ok(if path.ends_with("config/leg/robot.toml") {
                text.replace("reference_timeout_ms = 40.0", &key)
            } else {
                text
            })
        };
        let mut bench = Bench::reading("leg", &read);
        let reference = bench.follow();
        let lost = (1..=timeout_ms + 5).find(|age_ms| {
            let input = ClientInput {
                age_s: 1e-3 * f64::from(*age_ms),
                ..client_input(&reference)
            };
            bench.step(&input).mode == Mode::Hold.number()
        });
        assert_eq!(lost, Some(timeout_ms + 1));
        let stale = bench.cycle.record().events[Event::ReferenceStale.index()];
        assert_eq!(stale, 1, "{timeout_ms} ms");
    }
}

/// A client may send its motion more slowly than the loop runs, up to the time after which it
/// counts as lost.
#[test]
fn slow_clients_are_followed() {
    for every in [1, 2, 5, 10, 40] {
        let mut moving = Moving::new(Bench::new("leg"), every);
        (0..1500).for_each(|_| moving.step(None));
        let record = moving.bench.cycle.record();
        assert_eq!(state(record), RobotState::Active, "every {every} ms");
    }
}

#[test]
fn skipped_cycles_do_not_step_the_torque() {
    for skipped in [1, 3, 10] {
        let mut bench = Bench::new("leg");
        let mut reference = bench.follow();
        let q0: Vec<f64> = reference.joints.iter().map(|j| j.q_d).collect();
        let mut last: Option<CycleRecord> = None;
        let mut greatest: f64 = 0.0;
        for k in 0..1000 {
            let t = f64::from(k) * 1e-3;
            let w = std::f64::consts::PI;
            for (joint, q0) in reference.joints.iter_mut().zip(&q0).take(6) {
                // 0.25 rad at 0.5 Hz, begun at rest.
                joint.q_d = q0 + 0.125 * (1.0 - (w * t).cos());
                joint.dq_d = 0.125 * w * (w * t).sin();
            }
            reference.sequence += 1;
            // The robot goes on while the loop sleeps, and its answers are lost.
            if k == 500 {
                for _ in 0..skipped {
                    bench.gather();
                }
            }
            let record = *bench.step(&client_input(&reference));
            if let Some(last) = last.filter(|_| k > 490 && k < 700) {
                let taus = |r: &CycleRecord| {
                    (r.estimated.joints).map(|j| [j.tau_encoder.tau, j.tau_whole_body.tau])
                };
                for (before, after) in taus(&last).iter().zip(taus(&record)).take(6) {
                    let steps = before.iter().zip(after).map(|(a, b)| (a - b).abs());
                    greatest = steps.fold(greatest, f64::max);
                }
            }
            last = Some(record);
        }
        assert_eq!(bench.cycle.record().fault, 0);
        let limit = bench.robot.parameters.joints[3].limits.torque;
        assert!(
            greatest < 0.05 * limit,
            "{skipped} skipped: {greatest} N·m in a cycle"
        );
    }
}
