//! Margins against simulations in time that turn gain or phase until the loop rings.

use control::margins::{JointLoop, Load, least_margins};
use control::predictive::{
    Design, DriveModel, FrictionModel, GearStiffness, LawParameters, PredictiveLaw, Sensed,
    TorqueTerms,
};

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
        drive: DriveModel::Position {
            stiffness,
            damping,
            dead_zone: 0.0,
        },
        rotor_inertia,
        gear: GearStiffness::constant(gear),
        friction: FrictionModel::NONE,
        torque_limit: 1e9,
        disturbance_limit: 1e9,
        design: Design::default(),
    };
    JointLoop::nominal(law, LAG, link_inertia)
}

/// A complex number as two real ones.
type Complex = [f64; 2];

/// Growth of the torsion within 1.5 s of the loop in which the motor's torque is multiplied by
/// `gain e^(i phase)`. Two copies of the law run side by side, one for each part: it is linear.
fn growth(joint: &JointLoop, load: Load, gain: f64, phase: f64) -> f64 {
    let p = joint.truth;
    let gear = p.gear.at(0.0);
    let gear_damping = 0.04 * (gear * p.rotor_inertia).sqrt();
    let DriveModel::Position {
        stiffness, damping, ..
    } = p.drive
    else {
        panic!("position-commanded");
    };
    let (inverse_inertia, spring) = match load {
        Load::Blocked | Load::Stuck => (0.0, 0.0),
        Load::Free => (1.0 / joint.link_inertia, 0.0),
        Load::Light => (5.0 / joint.link_inertia, 0.0),
        Load::Heavy => (0.2 / joint.link_inertia, 0.0),
        Load::Spring => (1.0 / joint.link_inertia, gear / 3.0),
    };
    let stick = if load == Load::Stuck { 2.0 * gear } else { 0.0 };
    let h = 1e-5;
    let mut laws = [0, 1].map(|_| PredictiveLaw::new(joint.law));
    let zero: Complex = [0.0; 2];
    let (mut theta, mut omega, mut q, mut dq) = (zero, zero, zero, zero);
    let (mut command, mut next, mut filtered) = (zero, zero, zero);
    let mut made = std::collections::VecDeque::from(vec![zero; (LAG / h).round() as usize]);
    let turn = [gain * phase.cos(), gain * phase.sin()];
    let mut energy = [0.0; 2];
    for cycle in 0..3200_usize {
        let arriving = std::mem::take(&mut next);
        for part in 0..2 {
            let law = &mut laws[part];
            law.observe(&Sensed {
                theta: theta[part],
                q: q[part],
                torque: Some(gear * (theta[part] - q[part])),
                fresh: true,
            });
            let wish = TorqueTerms {
                feedforward: -joint.stiffness * q[part] - joint.damping * law.link_velocity(),
                ..TorqueTerms::default()
            };
            let sent = law.command(&wish).command;
            law.sent(sent);
            next[part] = sent;
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
        match cycle {
            1300..1700 => energy[0] += torsion,
            2800..3200 => energy[1] += torsion,
            _ => {}
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
            let (degrees, db) = margins.in_degrees_and_db();
            let grows = |gain: f64, phase: f64| growth(&joint, load, gain, phase) > 1.0;
            let near = 1.06; // 0.5 dB
            if db < 20.0 {
                let (within, beyond) = (margins.gain / near, margins.gain * near);
                assert!(
                    !grows(within, 0.0) && !grows(1.0 / within, 0.0),
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
        }
    }
    assert!(checked > 15, "{checked}");
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
