//! Kinematic error from the unloaded turn each way (Z II-B3).
//!
//! Z averages both ways on a common grid of q, `err = (torsion_cw + torsion_ccw)/2`, and fits a
//! Fourier series to the mean. Here one least-squares problem holds the series, one constant for
//! each way, and terms in velocity and acceleration. Effects of the motion (friction, wave
//! generator, skew, inertia of the load) cancel just as in Z, without a grid, with every sample
//! used once and at any course of the speed.

use crate::blocks::{Blocks, Prior};
use crate::gear::past_known;
use crate::least_squares::Batch;
use crate::record::Record;
use estimators::hysteresis::{Gear, GearParameters};
use estimators::kinematic_error::KinematicErrorParameters;
use problem::Problem;
use std::f64::consts::TAU;

/// Share of the gear's stiffness below which a torque shows no angle.
const LEAST_SLOPE: f64 = 0.01;
/// Harmonics of the link-side angle that are fitted.
const LINK_HARMONICS: usize = 8;
/// Harmonics of the motor-side angle that are fitted.
const MOTOR_HARMONICS: usize = 8;
/// Samples used at most: the series has some thirty coefficients.
const MAX_SAMPLES: usize = 60_000;
/// Columns before the series: constant, direction, velocity, acceleration.
const MOTION: usize = 4;
/// Standard deviations, and rad, that a harmonic must reach to be kept.
const SIGNIFICANCE: f64 = 4.0;
const MIN_AMPLITUDE: f64 = 2e-7;

/// The error's series and the torsion that it leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct KinematicFit {
    /// The series.
    pub parameters: KinematicErrorParameters,
    /// Root mean square of the residual, rad.
    pub rms: f64,
}

/// Fits Z18 to unloaded motion both ways.
///
/// # Errors
/// Data that do not cover half a turn, or go one way only.
pub fn fit(record: &Record) -> Result<KinematicFit, Problem> {
    let speeds: Vec<f64> = record.motion.iter().map(|m| m[0].abs()).collect();
    let fastest = speeds.iter().fold(0.0f64, |m, v| m.max(*v));
    let moving: Vec<usize> = record
        .spread(MAX_SAMPLES)
        .filter(|&i| speeds[i] > 0.3 * fastest)
        .collect();
    for (way, name) in [(1.0, "positive"), (-1.0, "negative")] {
        let angles = moving.iter().filter(|&&i| record.motion[i][0] * way > 0.0);
        let (low, high) = angles.fold((f64::MAX, f64::MIN), |(low, high), &i| {
            (low.min(record.samples[i].q), high.max(record.samples[i].q))
        });
        if high - low < 0.5 * TAU {
            let covered = (high - low).max(0.0);
            return Err(Problem::new(
                format!("no-load turn: the {name} direction covers {covered:.2} rad of q"),
                "at least half a turn each way, better a whole one",
            ));
        }
    }
    let one = series(record, &moving, 1.0)
        .ok_or_else(|| Problem::new("no-load turn: the Fourier series is not determined", ""))?;
    // Z prints 0.9935 periods a turn for the motor side. Such a frequency is accepted only if it
    // fits clearly better than 1, as a gear has a whole number of lobes.
    let candidates = (-40..=40)
        .filter(|k| *k != 0)
        .map(|k| 1.0 + 5e-4 * f64::from(k));
    let other = candidates
        .filter_map(|w| series(record, &moving, w))
        .min_by(|a, b| a.rms.total_cmp(&b.rms));
    Ok(match other {
        Some(fit) if fit.rms < 0.9 * one.rms => fit,
        _ => one,
    })
}

/// Harmonics by order, and their amplitudes, rad.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct HigherHarmonics {
    /// Of q.
    pub link: Vec<(usize, (f64, f64))>,
    /// Of theta.
    pub motor: Vec<(usize, (f64, f64))>,
}

/// Orders of q and theta that the gear's fit leaves out, and the widths of their priors, rad.
const HIGHER_LINK: [(usize, f64); 1] = [(3, 1e-5)];
const HIGHER_MOTOR: [(usize, f64); 3] = [(3, 1e-5), (5, 3e-6), (6, 3e-6)];
/// Standard deviation of a constant torsion, rad: wide.
const CONSTANT: f64 = 1e-3;

/// Harmonics that loaded motion shows beside those of the gear's fit: what is left of the torque by a gear,
/// over its stiffness. What the log does not show stays at zero.
#[must_use]
pub fn higher(
    record: &Record,
    error: &KinematicErrorParameters,
    gear: &GearParameters,
) -> HigherHarmonics {
    let orders = || HIGHER_LINK.iter().chain(&HIGHER_MOTOR);
    let columns = 1 + 2 * orders().count();
    let mut priors = vec![Prior::new(0.0, CONSTANT)];
    priors.extend(orders().flat_map(|(_, width)| [Prior::new(0.0, *width); 2]));
    let raw: Vec<f64> = (record.samples.iter())
        .map(|s| s.theta / record.gear_ratio - s.q - error.error(s.q, s.theta))
        .collect();
    // Noise would work the springs; the harmonics are looked for in what is not smoothed.
    let (torsion, tau) = (record.smooth(&raw, 0), record.smooth(&record.tau, 0));
    let seconds = tau.len() as f64 * record.sample_period;
    let alike = Blocks::alike(record.sample_period);
    let mut blocks = Blocks::new(columns, Blocks::count(seconds), alike);
    let least = LEAST_SLOPE * gear.linear;
    let known = past_known(record, error, gear);
    let mut gear = Gear::new(gear.clone(), record.sample_period);
    let mut row = vec![0.0; columns];
    for (i, s) in record.samples.iter().enumerate() {
        if record.log_begins().binary_search(&i).is_ok() {
            gear.reset();
        }
        let carried = gear.update(torsion[i]) - gear.bearing(s.q, record.motion[i][0]);
        let slope = gear.stiffness(torsion[i]);
        // A fit with little load may have a gear that yields without end where it carried nothing.
        if !record.usable(i) || !known[i] || slope <= least {
            continue;
        }
        row[0] = 1.0;
        let link = HIGHER_LINK.map(|(n, _)| n as f64 * error.w_link * s.q);
        let motor = HIGHER_MOTOR.map(|(n, _)| n as f64 * s.theta);
        for (pair, angle) in row[1..]
            .chunks_exact_mut(2)
            .zip(link.into_iter().chain(motor))
        {
            (pair[1], pair[0]) = angle.sin_cos();
        }
        let left = (carried - tau[i]) / slope + raw[i] - torsion[i];
        blocks.add(i as f64 / tau.len() as f64, &row, left);
    }
    let Some(posterior) = blocks.fit(&priors) else {
        return HigherHarmonics::default();
    };
    let waves = |orders: &[(usize, f64)], first: usize| {
        let wave = |(k, (order, _)): (usize, &(usize, f64))| {
            let at = first + 2 * k;
            (*order, (posterior.x[at], posterior.x[at + 1]))
        };
        orders.iter().enumerate().map(wave).collect()
    };
    HigherHarmonics {
        link: waves(&HIGHER_LINK, 1),
        motor: waves(&HIGHER_MOTOR, 1 + 2 * HIGHER_LINK.len()),
    }
}

fn series(record: &Record, moving: &[usize], w_motor: f64) -> Option<KinematicFit> {
    let columns = MOTION + 2 * LINK_HARMONICS + 2 * MOTOR_HARMONICS;
    let mut batch = Batch::new(columns);
    let mut row = vec![0.0; columns];
    for &i in moving {
        let s = &record.samples[i];
        let [dq, ddq] = record.motion[i];
        row[..MOTION].copy_from_slice(&[1.0, dq.signum(), dq, ddq]);
        let mut at = MOTION;
        for (angle, harmonics) in [(s.q, LINK_HARMONICS), (w_motor * s.theta, MOTOR_HARMONICS)] {
            for n in 1..=harmonics {
                let (sin, cos) = (n as f64 * angle).sin_cos();
                (row[at], row[at + 1]) = (cos, sin);
                at += 2;
            }
        }
        batch.add(&row, s.theta / record.gear_ratio - s.q);
    }
    let solution = batch.solve(1e-9)?;
    // Harmonics up to the highest that the data show; the loop pays for each.
    let pairs = |from: usize, count: usize| {
        let at = |n: usize| (from + 2 * n, from + 2 * n + 1);
        let shown = |n: &usize| {
            let (i, j) = at(*n);
            let amplitude = solution.x[i].hypot(solution.x[j]);
            amplitude > MIN_AMPLITUDE.max(SIGNIFICANCE * solution.sigma[i].max(solution.sigma[j]))
        };
        let kept = (0..count).rev().find(shown).map_or(0, |n| n + 1);
        let pair = |n: usize| (solution.x[at(n).0], solution.x[at(n).1]);
        (0..kept).map(pair).collect::<Vec<_>>()
    };
    Some(KinematicFit {
        parameters: KinematicErrorParameters {
            a0: solution.x[0],
            w_link: 1.0,
            link: pairs(MOTION, LINK_HARMONICS),
            w_motor,
            motor: pairs(MOTION + 2 * LINK_HARMONICS, MOTOR_HARMONICS),
        },
        rms: solution.rms,
    })
}
