//! Margins against simulations in time that turn gain or phase until the loop rings.

mod design;

use control::JointGains;
use control::margins::{JointLoop, Load, Margins, MotorSideLoop, least_margins};
use control::predictive::{
    Design, DriveLoop, FrictionModel, GearStiffness, LawParameters, PredictiveLaw, Sensed,
    TorqueTerms,
};
use std::f64::consts::TAU;

const DT: f64 = 1e-3;
/// Of the drive: half a period of its own loop, and its current loop.
const LAG: f64 = 0.3e-3;

/// Rotor inertia, gear, drive's stiffness and damping, inertia of the link: the test joint and the
/// leg's six, as another program's linear model had them.
const JOINTS: [[f64; 5]; 7] = [
    [0.114, 9000.0, 8350.0, 58.0, 0.13],
    [0.2, 13_000.0, 7380.0, 96.0, 0.08],
    [1.5, 61_000.0, 73_440.0, 464.0, 1.2],
    [0.5, 27_000.0, 12_080.0, 84.0, 1.2],
    [1.5, 61_000.0, 28_920.0, 188.0, 0.35],
    [0.5, 27_000.0, 7144.0, 54.5, 0.03],
    [0.2, 13_000.0, 6120.0, 36.6, 0.015],
];

fn joint([rotor_inertia, gear, stiffness, damping, link_inertia]: [f64; 5]) -> JointLoop {
    let law = LawParameters {
        sample_period: DT,
        delay: DT + LAG,
        drive: DriveLoop::Position {
            stiffness,
            damping,
            dead_zone: 0.0,
            integral: 0.0,
        },
        rotor_inertia,
        gear: GearStiffness::constant(gear),
        friction: FrictionModel::NONE,
        torque_limit: 1e9,
        disturbance_limit: 1e9,
        // Margins are those of the law without what depends on evidence.
        design: Design {
            assist: 0.0,
            ..Design::default()
        },
    };
    JointLoop::nominal(law, LAG, link_inertia)
}

/// A complex number as two real ones.
type Complex = [f64; 2];

/// A law: the command for the angles of rotor and link, for a cycle each.
type Law<'a> = Box<dyn FnMut(f64, f64) -> f64 + 'a>;

fn predictive(joint: &JointLoop) -> Law<'_> {
    let mut law = PredictiveLaw::new(joint.law);
    let gear = joint.truth.gear.at(0.0);
    Box::new(move |theta, q| {
        law.observe(&Sensed {
            theta,
            q,
            torque: Some(gear * (theta - q)),
            motor_torque: None,
            fresh: true,
        });
        let wish = TorqueTerms {
            feedforward: -joint.stiffness * q - joint.damping * law.link_velocity(),
            ..TorqueTerms::default()
        };
        let sent = law.command(&wish).command;
        law.sent(sent);
        sent
    })
}

/// The feedback of a late torque, step by step.
fn late(joint: &MotorSideLoop) -> Law<'_> {
    let gear = joint.law.gear.at(0.0);
    let DriveLoop::Position {
        stiffness, damping, ..
    } = joint.law.drive
    else {
        panic!("position-commanded");
    };
    let share = |time: f64| DT / (DT + time);
    let shares = [
        share(joint.law.torque_lag()),
        share(1.0 / joint.torsion_bandwidth),
    ];
    let mut torques = vec![0.0; joint.smoothing.len()];
    let mut desired = torques.clone();
    let mut angles = vec![[0.0; 2]; joint.velocity.len()];
    let (mut lagged, mut integral, mut torsion) = (0.0, 0.0, [0.0; 2]);
    let g = joint.gains;
    let weighted = |of: &[f64], by: &[f64]| of.iter().zip(by).map(|(a, b)| a * b).sum::<f64>();
    Box::new(move |theta, q| {
        torques.remove(0);
        torques.push(gear * (theta - q));
        let tau_hat = weighted(&torques, &joint.smoothing);
        let seen = theta - torsion[1];
        torsion[0] += shares[1] * (tau_hat / gear - torsion[0]);
        torsion[1] += shares[1] * (torsion[0] - torsion[1]);
        angles.remove(0);
        angles.push([theta, seen]);
        let rate = |part: usize| {
            let angles: Vec<f64> = angles.iter().map(|both| both[part]).collect();
            weighted(&angles, &joint.velocity)
        };
        let tau_d = -g.k_s * seen - g.k_d * rate(1);
        lagged += shares[0] * (tau_d - lagged);
        desired.remove(0);
        desired.push(lagged);
        let error = weighted(&desired, &joint.smoothing) - tau_hat;
        integral += g.k_i * error * DT;
        let tau = tau_d + g.k_p * error + integral;
        theta + tau / stiffness + damping / stiffness * rate(0)
    })
}

/// Growth of the torsion, within `cycles` after the first ones, of the loop in which the motor's torque is
/// multiplied by `gain e^(i phase)`. Two copies of the law run side by side, one for each part: it is linear.
fn growth(
    (p, link_inertia): (LawParameters, f64),
    mut laws: [Law<'_>; 2],
    load: Load,
    turn: [f64; 2],
    cycles: usize,
) -> f64 {
    let gear = p.gear.at(0.0);
    let gear_damping = 0.04 * (gear * p.rotor_inertia).sqrt();
    let DriveLoop::Position {
        stiffness, damping, ..
    } = p.drive
    else {
        panic!("position-commanded");
    };
    let (inverse_inertia, spring) = match load {
        Load::Blocked | Load::Stuck => (0.0, 0.0),
        Load::Free => (1.0 / link_inertia, 0.0),
        Load::Light => (5.0 / link_inertia, 0.0),
        Load::Heavy => (0.2 / link_inertia, 0.0),
        Load::Spring => (1.0 / link_inertia, gear / 3.0),
    };
    let stick = if load == Load::Stuck { 2.0 * gear } else { 0.0 };
    let h = 1e-5;
    let zero: Complex = [0.0; 2];
    let (mut theta, mut omega, mut q, mut dq) = (zero, zero, zero, zero);
    let (mut command, mut next, mut filtered) = (zero, zero, zero);
    let mut made = std::collections::VecDeque::from(vec![zero; (LAG / h).round() as usize]);
    let mut energy = [0.0; 2];
    for cycle in 0..1700 + cycles {
        let arriving = std::mem::take(&mut next);
        for part in 0..2 {
            next[part] = laws[part](theta[part], q[part]);
        }
        if cycle > 0 {
            command = arriving;
        }
        if cycle == 20 {
            omega = [0.01, 0.0];
        }
        for _ in 0..100 {
            for i in 0..2 {
                filtered[i] += (omega[i] - filtered[i]) * h / (h + 2.0 * LAG);
            }
            let drive = |i: usize| stiffness * (command[i] - theta[i]) - damping * filtered[i];
            made.push_back([drive(0), drive(1)]);
            let motor = made.pop_front().unwrap();
            let motor = [
                motor[0] * turn[0] - motor[1] * turn[1],
                motor[0] * turn[1] + motor[1] * turn[0],
            ];
            for i in 0..2 {
                let torque = gear * (theta[i] + h * omega[i] - q[i] - h * dq[i])
                    + gear_damping * (omega[i] - dq[i]);
                omega[i] += h * (motor[i] - torque - stick * theta[i]) / p.rotor_inertia;
                let outside = spring * (q[i] + 1e-3 * dq[i]);
                dq[i] += h * inverse_inertia * (torque - outside);
                theta[i] += h * omega[i];
                q[i] += h * dq[i];
            }
        }
        let torsion = (theta[0] - q[0]).hypot(theta[1] - q[1]);
        if (1300..1700).contains(&cycle) {
            energy[0] += torsion;
        } else if cycle >= 1300 + cycles {
            energy[1] += torsion;
        }
    }
    energy[1] / energy[0].max(1e-300)
}

#[test]
fn simulations_in_time_ring_where_the_margins_end() {
    let mut checked = 0;
    for numbers in [JOINTS[0], JOINTS[3], JOINTS[5]] {
        let joint = joint(numbers);
        for load in Load::ALL {
            let margins = joint.with(load).margins();
            checked += ends_at(load, &margins, |turn| {
                let laws = [predictive(&joint), predictive(&joint)];
                growth((joint.truth, joint.link_inertia), laws, load, turn, 1500) > 1.0
            });
        }
    }
    assert!(checked > 15, "{checked}");
}

/// Asserts that a loop rings from 0.5 dB and 2 degrees beyond its margins on, and not that much within; returns
/// the number of margins that it has. `rings`: with the motor's torque multiplied by a complex number.
fn ends_at(load: Load, margins: &Margins, rings: impl Fn([f64; 2]) -> bool) -> usize {
    let (degrees, db) = margins.in_degrees_and_db();
    let grows = |gain: f64, phase: f64| rings([gain * phase.cos(), gain * phase.sin()]);
    let mut checked = 0;
    let near = 1.06; // 0.5 dB
    if db < 20.0 {
        let (within, beyond) = (margins.gain / near, margins.gain * near);
        assert!(
            !grows(within, 0.0) && (margins.reduction < within || !grows(1.0 / within, 0.0)),
            "{load:?} {db}"
        );
        assert!(
            grows(beyond, 0.0) || grows(1.0 / beyond, 0.0),
            "{load:?} {db}"
        );
        checked += 1;
    }
    let near = 2.0_f64.to_radians();
    let (within, beyond) = (margins.phase - near, margins.phase + near);
    if degrees < 170.0 {
        assert!(
            !grows(1.0, within) && !grows(1.0, -within),
            "{load:?} {degrees}"
        );
        assert!(
            grows(1.0, beyond) || grows(1.0, -beyond),
            "{load:?} {degrees}"
        );
        checked += 1;
    }
    checked
}

/// A joint without a link-side encoder: a bell of 80 samples smooths its torque, the slope of a line through 16
/// is its velocity.
fn late_joint(numbers: [f64; 5], k_i: f64, k_6: f64) -> MotorSideLoop {
    let JointLoop {
        law,
        drive_lag,
        link_inertia,
        ..
    } = joint(numbers);
    let k_s = k_6 * law.drive_stiffness();
    let bell = |k: i32| {
        let x = (f64::from(k) - 39.5) / 40.0;
        (1.0 - x * x).powi(2)
    };
    let sum: f64 = (0..80).map(bell).sum();
    let middle = |k: i32| f64::from(k) - 7.5;
    let squares: f64 = (0..16).map(|k| middle(k).powi(2)).sum();
    MotorSideLoop {
        law,
        drive_lag,
        link_inertia,
        torque: 0.0,
        gains: JointGains {
            k_p: 0.0,
            k_i,
            k_s,
            k_d: 0.01 * k_s,
        },
        smoothing: (0..80).map(|k| bell(k) / sum).collect(),
        velocity: (0..16).map(|k| middle(k) / squares / DT).collect(),
        torsion_bandwidth: 22.0,
    }
}

#[test]
fn simulations_in_time_of_a_late_torque_ring_where_its_margins_end() {
    let mut checked = 0;
    for (numbers, k_i) in [(JOINTS[1], 4.0), (JOINTS[3], 8.0), (JOINTS[4], 8.0)] {
        for (k_6, loads) in [(0.0, &Load::ALL[..]), (0.2, &Load::MOVING)] {
            let joint = late_joint(numbers, k_i, k_6);
            for &load in loads {
                let margins = joint.margins(load);
                assert!(margins != Margins::NONE, "{numbers:?} {load:?} {k_6}");
                checked += ends_at(load, &margins, |turn| {
                    let laws = [late(&joint), late(&joint)];
                    growth((joint.law, joint.link_inertia), laws, load, turn, 8000) > 1.0
                });
            }
        }
    }
    assert!(checked > 30, "{checked}");
}

#[test]
fn a_late_torque_that_rings_has_no_margins() {
    let joint = late_joint(JOINTS[3], 60.0, 0.0);
    for load in Load::ALL {
        let laws = [late(&joint), late(&joint)];
        let grows = growth(
            (joint.law, joint.link_inertia),
            laws,
            load,
            [1.0, 0.0],
            4000,
        ) > 1.0;
        assert_eq!(joint.margins(load) == Margins::NONE, grows, "{load:?}");
    }
}

/// Another program's least phase margins of these joints, by eigenvalues of a linear model that holds
/// the drive's loop for 2.5 kHz instead of delaying it, degrees. Its least gain margin is 10.7 dB.
const OTHER: [f64; 7] = [40.0, 49.0, 43.0, 52.0, 42.0, 50.0, 51.0];

#[test]
fn another_program_finds_the_same_margins() {
    let mut least_db = f64::INFINITY;
    for (numbers, other) in JOINTS.into_iter().zip(OTHER) {
        let (margins, at) = least_margins(&joint(numbers), &Load::ALL);
        let (degrees, db) = margins.in_degrees_and_db();
        assert!(
            (degrees - other).abs() < 6.0,
            "{numbers:?} {at:?}: {degrees}, {other}"
        );
        least_db = least_db.min(db);
    }
    assert!((least_db - 10.7).abs() < 1.0, "{least_db}");
}

/// With stiffness in space and K_d / K_s = 10 ms: the other program had 41 degrees and 8.6 dB at
/// K6 = 1/3, 34 degrees, 6.8 dB and 4.3 dB less gain at K6 = 0.5, and an unstable loop at K6 = 1.
#[test]
fn stiffness_in_space_costs_margin() {
    let k_tau = [2.4e-4, 2.12e-4, 3e-5, 1.2e-4, 5.1e-5, 1.77e-4, 2.4e-4];
    let margins = |k6: f64| {
        let margins = JOINTS.iter().zip(k_tau).map(|(numbers, k_tau)| {
            let closed = JointLoop {
                stiffness: k6 / k_tau,
                damping: 0.01 * k6 / k_tau,
                ..joint(*numbers)
            };
            least_margins(&closed, &Load::MOVING).0
        });
        margins.reduce(|a, b| a.least(b)).unwrap()
    };
    let (third, half, one) = (margins(1.0 / 3.0), margins(0.5), margins(1.0));
    let (degrees, db) = third.in_degrees_and_db();
    assert!(
        (degrees - 41.0).abs() < 4.0 && (db - 8.6).abs() < 1.0,
        "{third:?}"
    );
    let (degrees, db) = half.in_degrees_and_db();
    assert!(
        (degrees - 34.0).abs() < 4.0 && (db - 6.8).abs() < 1.0,
        "{half:?}"
    );
    // Less torque of the motor than thought: 4.3 dB.
    assert!(
        (20.0 * half.reduction.log10() - 4.3).abs() < 1.0,
        "{half:?}"
    );
    assert!(one.phase < 0.1, "{one:?}");
}

/// The carried torque fed back (Z IV-B) with the bandwidth that the loop uses, every joint with K6 = 0.5 and
/// K_d / K_s = 10 ms, as configured: every link, the heaviest too, stays stable and keeps nearly all of its
/// phase and gain margin, and what less gain would do to it stays away.
#[test]
fn carried_torque_keeps_the_margins() {
    let k_tau = [2.4e-4, 2.12e-4, 3e-5, 1.2e-4, 5.1e-5, 1.77e-4, 2.4e-4];
    for (numbers, k_tau) in JOINTS.iter().zip(k_tau) {
        let (k_s, k_d) = (0.5 / k_tau, 0.005 / k_tau);
        let without = JointLoop {
            stiffness: k_s,
            damping: k_d,
            ..joint(*numbers)
        };
        let gains = JointGains {
            k_s,
            k_d,
            ..JointGains::default()
        };
        let follow = control::largest_follow(&gains, &without.law, without.link_inertia);
        assert!(follow > 0.5 * TAU, "{numbers:?}: {follow} rad/s");
        let with = JointLoop {
            load_follow: follow,
            ..without
        };
        for load in Load::MOVING {
            let (before, after) = (without.with(load).margins(), with.with(load).margins());
            let case = format!("{numbers:?}, {follow:.1} rad/s, {load:?}: {before:?} {after:?}");
            assert!(after.phase > before.phase - 5f64.to_radians(), "{case}");
            assert!(after.gain > 0.8 * before.gain, "{case}");
            assert!(after.reduction > 1.2, "{case}");
        }
    }
}
