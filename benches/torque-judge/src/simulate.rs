//! A run of a joint of the family: readings and true torque.
//!
//! Load and set point are prescribed; gear law, drive and sensors follow from them step by step.
//! Between the torque `tau` on the child link and the gear's torque stands the friction of the
//! output bearing.

use crate::course::Run;
use crate::random::Draw;
use crate::specimen::{Specimen, value};
use identification::log::LogRow;
use std::f64::consts::TAU;

/// Inertia of the load over its weight's torque when level, s²: an arm of 0.4 m.
const INERTIA_PER_WEIGHT: f64 = 1.1 * 0.4 / 9.81;
/// Way over which the bearing's friction turns round, rad.
const BEARING_STRETCH: f64 = 2e-4;
/// Lag of the drive's position control, s.
const DRIVE_LAG_S: f64 = 4e-3;

/// Damped oscillation of the load behind a torque from outside.
#[derive(Default)]
struct Resonance {
    value: f64,
    rate: f64,
}

impl Resonance {
    /// Steps of a tenth of a sample keep the explicit method stable up to some 100 Hz.
    fn follow(&mut self, input: f64, [omega, damping]: [f64; 2], dt: f64) -> f64 {
        const PARTS: usize = 10;
        let h = dt / PARTS as f64;
        for _ in 0..PARTS {
            let accelerated =
                omega * omega * (input - self.value) - 2.0 * damping * omega * self.rate;
            self.rate += h * accelerated;
            self.value += h * self.rate;
        }
        self.value
    }
}

/// True signals of a run, SI.
struct Truth {
    q: Vec<f64>,
    theta: Vec<f64>,
    gear: Vec<f64>,
    tau: Vec<f64>,
}

fn motion(joint: &Specimen, run: &Run, dt: f64) -> Truth {
    let n = (run.seconds / dt).round() as usize;
    let (rated, ratio) = (joint.sheet.rated_torque, joint.sheet.gear_ratio);
    let mut truth = Truth {
        q: Vec::with_capacity(n),
        theta: Vec::with_capacity(n),
        gear: Vec::with_capacity(n),
        tau: Vec::with_capacity(n),
    };
    let mut gear = joint.gear.clone();
    let (mut load, mut bearing) = (Resonance::default(), 0.0f64);
    let mut q = (run.q)(0.0);
    // The weight at the start is there from the first sample on: the gear has carried it for long.
    let first = run.weight * (run.q)(0.0).sin();
    for k in 0..200 {
        gear.load(first * f64::from(k) / 200.0);
    }
    let mut late = gear.load(first);
    let (mut felt, mut slow) = ([first; 2], first);
    for k in 0..n {
        let t = k as f64 * dt;
        let course = |t: f64| (run.q)(t);
        let rate = (course(t + dt) - course(t - dt)) / (2.0 * dt);
        let bend = (course(t + dt) - 2.0 * course(t) + course(t - dt)) / (dt * dt);
        let outside = load.follow((run.torque)(t), joint.resonance, dt);
        let tau = run.weight * (course(t).sin() + INERTIA_PER_WEIGHT * bend) + outside;
        // Carried by the gear: friction of the bearing acts between it and the link.
        let last = q;
        let carried = tau + joint.bearing[0] * bearing + joint.bearing[1] * rate;
        let elastic = gear.load(carried);
        late += (elastic - late) * dt / (dt + joint.creep[1]);
        let torsion = joint.torsion * (elastic + joint.creep[0] * late);
        for stage in 0..2 {
            let input = if stage == 0 { carried } else { felt[0] };
            felt[stage] += (input - felt[stage]) * dt / (dt + DRIVE_LAG_S);
        }
        slow += (felt[1] - slow) * dt / (dt + joint.drive[1]);
        let motor = course(t) + (slow - felt[1]) / joint.drive[0];
        let theta = ratio * motor;
        let [by_q, by_theta, by_both] = &joint.kinematic;
        let error = value(by_q, motor)
            + (1.0 + joint.loaded_error * carried) * value(by_theta, theta)
            + value(by_both, theta - motor);
        q = motor - torsion - error;
        if k > 0 {
            bearing = (bearing + (q - last) / BEARING_STRETCH).clamp(-1.0, 1.0);
        }
        truth.q.push(q);
        truth.theta.push(theta);
        truth.gear.push(rated * carried);
        truth.tau.push(rated * tau);
    }
    truth
}

/// Motor current without the sensor's errors, A.
fn current(joint: &Specimen, truth: &Truth, dt: f64) -> Vec<f64> {
    let sheet = &joint.sheet;
    let (rated, ratio) = (sheet.rated_torque, sheet.gear_ratio);
    let mut friction = joint.friction.clone();
    let n = truth.theta.len();
    let at = |k: usize| truth.theta[k.min(n - 1)];
    (0..n)
        .map(|k| {
            let (before, now, after) = (at(k.saturating_sub(1)), at(k), at(k + 1));
            let omega = (after - before) / (2.0 * dt);
            let alpha = (after - 2.0 * now + before) / (dt * dt);
            let ripple = 1.0
                + joint.ripple[0]
                    * ((2.0 * now + joint.ripple[1]).sin() + (truth.q[k] * 3.0).sin());
            let carried = truth.gear[k] / rated;
            let coulomb = joint.coulomb * ripple;
            let lost = friction.advance(now - before, omega, carried, coulomb, joint.viscous);
            let cogging = joint.sensors.cogging * (6.0 * now).sin();
            let torque = rated * (carried + lost + cogging) / ratio + sheet.rotor_inertia * alpha;
            torque / (sheet.torque_constant * joint.torque_constant)
        })
        .collect()
}

/// The log of a run and the true torque of each row.
#[must_use]
pub fn simulate(joint: &Specimen, run: &Run) -> Vec<(LogRow, f64)> {
    let dt = 1.0 / joint.sheet.sample_rate;
    let truth = motion(joint, run, dt);
    let current = current(joint, &truth, dt);
    let (s, sheet) = (&joint.sensors, &joint.sheet);
    let mut draw = Draw::new(joint.number, 100 + run.stream);
    let n = truth.theta.len();
    let quantised = |angle: f64, counts: f64| (angle * counts / TAU).round() * TAU / counts;
    // theta later by the skew, between samples by a straight line.
    let later = |k: usize| {
        let place = (k as f64 + s.skew / dt).clamp(0.0, (n - 1) as f64);
        let (whole, part) = (place as usize, place.fract());
        let next = truth.theta[(whole + 1).min(n - 1)];
        truth.theta[whole] + part * (next - truth.theta[whole])
    };
    let rated = sheet.rated_torque;
    (0..n)
        .map(|k| {
            let theta = later(k);
            let theta = theta + value(&s.motor_error, theta) + s.angle_noise[0] * draw.normal();
            let q = truth.q[k];
            let q = q + value(&s.link_error, q) + s.angle_noise[1] * draw.normal();
            let row = LogRow {
                t: (k + 1) as f64 * dt,
                theta: quantised(theta, sheet.motor_counts_per_turn),
                q: quantised(q, sheet.link_counts_per_turn),
                current: current[k] * s.current_gain
                    + s.current_offset
                    + s.current_noise * draw.normal(),
                tau_sensor: truth.tau[k] * s.torque_gain
                    + rated * (s.torque_offset + s.torque_noise * draw.normal()),
                feed_forward: f64::NAN,
            };
            (row, truth.tau[k])
        })
        .collect()
}
