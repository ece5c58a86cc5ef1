//! A robot without F/T sensors that a hand, a wall or a block touches: none of them is an encoder that errs. One that
//! does is found.

use crate::common;

use common::motion::Motion;
use common::{Bench, client_input, read, spoil};
use robot_config::slots;
use robot_state::{Event, Mode, Reference};
use test_support::Random;

const DT: f64 = 1e-3;
/// Stiffness and damping of what touches the joint, N·m/rad and N·m·s/rad.
const TOUCH: [f64; 2] = [2000.0, 20.0];

/// The shipped test joint with another friction, of which the configuration knows the sliding part within 15 %.
fn joint(seed: u64) -> Bench {
    let mut random = Random::new(seed);
    let mut between = |low: f64, high: f64| low * (high / low).powf(random.unit());
    let (sliding, known) = (between(0.5, 3.0), between(0.87, 1.15));
    let (breakaway, meshing, presliding) =
        (between(1.3, 1.8), between(0.02, 0.1), between(0.002, 0.02));
    let changed = |text: &str, pairs: &[(&str, f64)]| -> String {
        let mut section = "";
        let line = |line| {
            if str::starts_with(line, '[') {
                section = line;
            }
            let own = section.contains(".friction]");
            let pair = pairs.iter().find(|(key, _)| own && line.starts_with(key));
            match pair {
                Some((key, value)) => format!("{key}{value:?}\n"),
                None => format!("{line}\n"),
            }
        };
        text.lines().map(line).collect()
    };
    Bench::reading("test-joint", &|path| {
        let text = read(path)?;
        Ok(match path {
            "config/test-joint/sim.toml" => changed(
                &text,
                &[
                    ("coulomb_Nm = ", 0.015 * sliding),
                    ("static_ratio = ", breakaway),
                    ("meshing = ", meshing),
                    ("presliding_rad = ", presliding),
                ],
            ),
            "config/test-joint/robot.toml" => {
                changed(&text, &[("coulomb_Nm = ", 0.015 * sliding * known)])
            }
            _ => text,
        })
    })
}

/// Something stiff that has the joint by `grip` (rad, rad/s), if it touches it.
fn touch(bench: &mut Bench, grip: Option<[f64; 2]>) {
    let truth = &bench.plant.truth().joints[0];
    let [stiffness, damping] = TOUCH;
    let torque = grip.map_or(0.0, |[q, dq]| {
        stiffness * (q - truth.q) + damping * (dq - truth.dq)
    });
    bench.plant.robot_mut().set_load(0, torque);
}

/// Runs a mode for `seconds`, after one in hold; by time, what has the joint and the reference.
fn run(
    seed: u64,
    mode: Mode,
    seconds: f64,
    mut happens: impl FnMut(f64, &mut Bench, &mut Reference),
) {
    let mut bench = joint(seed);
    bench.run(1000);
    let mut reference = bench.reference(mode.number(), 1);
    for k in 0..(seconds / DT) as usize {
        reference.sequence += 1;
        happens(DT * k as f64, &mut bench, &mut reference);
        let record = bench.step(&client_input(&reference));
        let fault = Event::from_number(record.fault);
        assert_eq!(
            record.fault,
            0,
            "{seed}: {fault:?} after {:.3} s",
            DT * k as f64
        );
    }
}

#[test]
fn a_hand_that_turns_a_joint_round_is_no_fault() {
    for seed in 1..13 {
        let (mut q, mut dq) = (f64::NAN, 0.0_f64);
        run(seed, Mode::Torque, 6.0, |t, bench, _| {
            if q.is_nan() {
                q = bench.plant.truth().joints[0].q;
            }
            // Turned round within 50 ms.
            let goal = if (t + 0.5) % 2.0 < 1.0 { 0.5 } else { -0.5 };
            dq += (goal - dq).clamp(-0.02, 0.02);
            q += DT * dq;
            touch(bench, Some([q, dq]));
        });
    }
}

#[test]
fn a_blocked_joint_that_makes_torques_is_no_fault() {
    for seed in 1..13 {
        let mut q = f64::NAN;
        run(seed, Mode::Torque, 5.0, |t, bench, reference| {
            if q.is_nan() {
                q = bench.plant.truth().joints[0].q;
            }
            touch(bench, Some([q, 0.0]));
            reference.joints[0].tau_d = 9.0 * (std::f64::consts::TAU * 4.0 * t).sin();
        });
    }
}

#[test]
fn a_wall_is_no_fault() {
    for seed in 1..13 {
        let mut start = f64::NAN;
        run(seed, Mode::InverseDynamics, 4.0, |t, bench, reference| {
            let truth = &bench.plant.truth().joints[0];
            if start.is_nan() {
                start = truth.q;
            }
            // At 0.25 rad/s onto a wall 0.2 rad away, 0.005 rad into it, and back.
            let way = (0.25 * t).min(0.205) - (0.25 * (t - 2.0)).clamp(0.0, 0.205);
            let joint = &mut reference.joints[0];
            let moves = if way > joint.q_d - start { 0.25 } else { -0.25 };
            joint.dq_d = if (way - (joint.q_d - start)).abs() > 1e-9 {
                moves
            } else {
                0.0
            };
            joint.q_d = start + way;
            let wall = start + 0.2;
            touch(bench, (truth.q > wall).then_some([wall, 0.0]));
        });
    }
}

/// Which encoder drifts: as frames show it, or in the drive's own loop as well.
#[derive(Debug, Clone, Copy)]
enum Drifts {
    Link,
    Motor,
    Drive,
}

impl Drifts {
    /// So far, rad, at a rate, rad/s.
    fn spoil(self, bench: &mut Bench, way: f64, rate: f64) {
        match self {
            Self::Link => spoil(bench, 0, |values| values[slots::link_angle(0)] += way),
            Self::Motor => spoil(bench, 0, |values| {
                values[slots::motor_angle(0)] -= 100.0 * way;
            }),
            Self::Drive => {
                let faults = bench.plant.robot_mut().drive_faults(0);
                faults.unwrap().motor.rate = 100.0 * rate;
            }
        }
    }
}

/// On a robot without F/T sensors an encoder that drifts is found by the current alone, and late. Bounds are the worst of
/// 960 such runs (docs/safety.md) and a tenth more.
#[test]
fn an_encoder_that_drifts_is_found_though_late_in_mode_torque() {
    for (mode, most_deg, most_share) in [
        (Mode::Torque, 20.0, 0.44),
        (Mode::Passive, 3.7, 0.23),
        (Mode::InverseDynamics, 1.6, 0.23),
    ] {
        for drifts in [Drifts::Link, Drifts::Motor, Drifts::Drive] {
            for (rate, seed) in [
                (-0.6, 1),
                (0.6, 2),
                (-6.0, 3),
                (6.0, 4),
                (-60.0, 5),
                (200.0, 6),
            ] {
                let rate = f64::to_radians(rate);
                let mut bench = joint(seed);
                bench.run(1000);
                let mut reference = bench.reference(mode.number(), 1);
                for _ in 0..2000 {
                    reference.sequence += 1;
                    bench.step(&client_input(&reference));
                }
                let mut motion = Motion::of(&bench);
                for k in 0..1500 {
                    reference.sequence += 1;
                    bench.gather();
                    drifts.spoil(&mut bench, rate * DT * f64::from(k), rate);
                    bench.compute(&client_input(&reference));
                    motion.take(&bench);
                }
                let (way, share) = (motion.displacement_deg(), motion.speed_share());
                let fault = bench.cycle.record().fault;
                let what = format!(
                    "{mode:?}, {drifts:?}, {rate:.2} rad/s, seed {seed}: {way:.2} deg, {share:.3}, fault {fault}"
                );
                assert!(way < most_deg && share < most_share, "{what}");
                let causes = [Event::EncoderImplausible, Event::FollowingError];
                assert!(causes.map(Event::number).contains(&fault), "{what}");
            }
        }
    }
}
