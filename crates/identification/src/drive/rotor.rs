//! The rotor's equation: inertia, friction, and where within a period a set-point's current rises.
//!
//! ```text
//! K_t N i = J x'' + g T + d T' + hysteresis + friction + offset - c K_t N step
//! ```
//! Every term is averaged over the same time: x'' as the second difference of the angle is exactly the
//! acceleration's mean with a triangle of two periods, so the others take that triangle, and all of them
//! one Gaussian. Between samples the current is a straight line but for the set-points' steps: one
//! that rises at a share s of the period adds `(1/2 - s)` of itself to the mean, which `c` measures.
//!
//! Friction is a sum of elements that stick and slip (stop operators: of any shape from bristles to Coulomb,
//! H), the finest damped while they stick, one that grows with the load, and viscous ones by direction. `g`
//! is free around one: a gear is stiffer within its hysteresis loop, a sum of such elements too, than
//! its data sheet.

use super::position_loop::{Law, zone};
use super::smooth::{Gaussian, stop};
use super::{
    DriveKnowledge, DriveLog, DriveStretch, ENOUGH, Value, angle_sigma, blocks, range, rms, value,
};
use crate::blocks::{Blocks, Prior};
use std::f64::consts::PI;

/// The rotor's parameters, link side.
pub(super) struct Rotor {
    pub(super) inertia: Value,
    pub(super) coulomb: Value,
    pub(super) load: Value,
    pub(super) viscous: Value,
    pub(super) asymmetry: Value,
    /// c: time by which set-points act before the middle of their period, as a share of the period.
    pub(super) later: Value,
    /// The motion is fast enough for inertia and delay.
    pub(super) enough: bool,
    /// Root mean square of the torque without offset, and of the rest, N·m.
    pub(super) rms: [f64; 2],
    pub(super) notes: Vec<String>,
}

/// Standard deviation of the Gaussian, s: it passes 50 Hz and keeps the encoder's counts out of x''.
const SMOOTH_S: f64 = 2.5e-3;
/// Another one, with which inertia and delay are found once more: how far they move is part of what is
/// not known.
const SMOOTHER_S: f64 = 4e-3;
/// That of the one whose mean is subtracted for inertia and delay: slow errors of friction, gear and load
/// are larger than fast ones.
const SLOW_S: f64 = 40e-3;
/// Time over which errors of the equation are alike, s: a reversal of friction.
const ALIKE_S: f64 = 0.03;
/// Elements of friction, by the way over which they stick: from counts to the motion itself.
const ELEMENTS: usize = 5;
const SMALLEST_COUNTS: f64 = 3.0;
const LARGEST_SHARE: f64 = 0.05;
/// Elements that are damped while they stick.
const DAMPED: usize = 3;
/// Elements of the gear's hysteresis, as shares of the torque's range, and how large it may be.
const HYSTERESIS: [f64; 3] = [0.02, 0.07, 0.25];
const HYSTERESIS_SIGMA: f64 = 0.05;
/// Standard deviation of the gear's gain before the data.
const GAIN_SIGMA: f64 = 0.3;
/// Standard deviation of the friction's growth with load.
const LOAD_SIGMA: f64 = 0.1;
/// Time by which the drive's use of angle and velocity, and the rise of its current, shift between samples,
/// which no sample shows: this share of its lag, whose larger part is half a period of its own loop.
const HIDDEN: f64 = 1.0 / 3.0;
/// Damping of the gear over that at which its spring and the rotor would not swing, largest.
const GEAR_DAMPING: f64 = 0.1;

/// Columns.
const INERTIA: usize = 0;
const GAIN: usize = 1;
const LOAD: usize = 2;
const VISCOUS: usize = 3;
const ASYMMETRY: usize = 4;
const OFFSET: usize = 5;
const LATER: usize = 6;
const GEAR_RATE: usize = 7;
const COLUMNS: usize = 8;

/// Columns and right side of every row, with its place in the log.
type Rows = Vec<(f64, Vec<f64>, f64)>;

pub(super) fn fit(known: &DriveKnowledge, log: &DriveLog, law: &Law) -> Option<Rotor> {
    let constant = known.torque_constant * known.gear_ratio;
    let scales = Scales::new(known, log);
    let (mut fast, mut all, mut smoother): (Rows, Rows, Rows) = Default::default();
    let total: usize = log.stretches.iter().map(|s| s.theta.len()).sum();
    let mut before = 0;
    for stretch in &log.stretches {
        let terms = Terms::new(known, [SMOOTH_S, log.period], stretch, law, &scales);
        let place = |k: usize| (before + k) as f64 / total as f64;
        let other = Terms::new(known, [SMOOTHER_S, log.period], stretch, law, &scales);
        smoother.extend(other.rows(true).map(|(k, row, y)| (place(k), row, y)));
        fast.extend(terms.rows(true).map(|(k, row, y)| (place(k), row, y)));
        all.extend(terms.rows(false).map(|(k, row, y)| (place(k), row, y)));
        before += stretch.theta.len();
    }
    let mean = all.iter().map(|(_, _, y)| *y).sum::<f64>() / all.len().max(1) as f64;
    let torque = rms(all.iter().map(|(_, _, y)| y - mean));
    // Viscous friction beside what the drive's own stiffness makes of a hidden shift of time.
    let hidden_time = HIDDEN * known.lag;
    let stiffness = if known.takes_position {
        law.gain.value * constant
    } else {
        0.0
    };
    let hidden = hidden_time * stiffness;
    let viscous_sigma = known.viscous.hypot(hidden);
    let mut priors = scales.priors(known, torque, viscous_sigma);
    let fit = |rows: &Rows, priors: &[Prior]| {
        let mut equations = Blocks::new(priors.len(), blocks(log), 1.0);
        for (place, row, y) in rows {
            equations.add(*place, row, *y);
        }
        equations.fit_at(priors, (ALIKE_S / log.period).max(1.0))
    };
    // Inertia and delay from the fast part alone, then friction with them.
    let found = fit(&fast, &priors)?;
    let mut inertia = value(&found, INERTIA, known.inertia, known.inertia);
    let mut later = value(&found, LATER, 0.0, 0.3);
    // The equation's residual is its model's error, not noise: half of it may go with a term.
    let share = |column: usize| {
        let size = rms(fast.iter().map(|(_, row, _)| row[column]));
        0.5 * found.rms / size.max(1e-300)
    };
    inertia.sigma = inertia.sigma.hypot(share(INERTIA));
    later.sigma = later.sigma.hypot(share(LATER).min(0.3));
    let other = fit(&smoother, &priors)?;
    inertia.sigma = inertia.sigma.hypot(inertia.value - other.x[INERTIA]);
    later.sigma = later.sigma.hypot(later.value - other.x[LATER]);
    for column in [INERTIA, LATER] {
        let sigma = found.covariance[(column, column)].sqrt();
        priors[column] = Prior::new(found.x[column], 0.3 * sigma);
    }
    let friction_of_fast: f64 = found.x.iter().skip(COLUMNS).take(scales.radii.len()).sum();
    let found = fit(&all, &priors)?;
    let scale = known.torque_constant_sigma * inertia.value;
    let hidden_inertia = hidden_time * law.damping.value * constant;
    inertia.sigma = inertia.sigma.hypot(scale).hypot(hidden_inertia);
    later.sigma = later.sigma.hypot(hidden_time / log.period);
    // Standard deviation of the Gaussian's second derivative of white noise: sqrt(3 T / (8 sqrt(pi) s⁵)).
    let noise =
        (3.0 * log.period / (8.0 * PI.sqrt() * SMOOTH_S.powi(5))).sqrt() * angle_sigma(known);
    let enough = rms(fast.iter().map(|(_, row, _)| row[INERTIA])) > ENOUGH * noise;
    let mut viscous = value(&found, VISCOUS, known.viscous, viscous_sigma);
    viscous.sigma = viscous.sigma.hypot(hidden);
    let clear = viscous.sigma < 0.5 * viscous.value.abs();
    let viscous = viscous.or_configured(viscous_sigma, clear);
    let gain = value(&found, GAIN, 1.0, GAIN_SIGMA);
    let mut notes = Vec::new();
    if (gain.value - 1.0).abs() > 0.25 + 2.0 * gain.sigma {
        notes.push(format!(
            "the gear's torque is {:.2} times the current's: its stiffness or the torque constant is wrong",
            1.0 / gain.value
        ));
    }
    let elements = scales.radii.len();
    let sum: f64 = found.x.iter().skip(COLUMNS).take(elements).sum();
    let variance = found
        .covariance
        .view((COLUMNS, COLUMNS), (elements, elements))
        .sum();
    // Friction that differs with speed is another one in the fast part.
    let sigma = variance.max(0.0).sqrt().hypot(sum - friction_of_fast);
    let sigma = sigma.hypot(known.torque_constant_sigma * sum);
    Some(Rotor {
        inertia: inertia.or_configured(known.inertia, enough),
        enough,
        coulomb: Value {
            value: sum,
            sigma,
            configured: known.coulomb,
            determined: sigma < super::NARROWER * sum,
        },
        load: value(&found, LOAD, 0.0, LOAD_SIGMA),
        asymmetry: value(&found, ASYMMETRY, 0.0, viscous_sigma),
        viscous,
        later,
        rms: [torque, found.rms],
        notes,
    })
}

/// Sizes of the elements of friction and hysteresis.
struct Scales {
    /// Ways over which elements of friction stick, link side, rad.
    radii: Vec<f64>,
    /// Torques over which elements of the gear's hysteresis turn, N·m.
    turns: Vec<f64>,
}

impl Scales {
    fn new(known: &DriveKnowledge, log: &DriveLog) -> Self {
        let n = known.gear_ratio;
        let all = |of: fn(&DriveStretch) -> &[f64]| -> Vec<f64> {
            let list = log.stretches.iter().flat_map(|s| of(s).iter().copied());
            list.collect()
        };
        let least = SMALLEST_COUNTS * known.motor_resolution / n;
        let most = (LARGEST_SHARE * range(&all(|s| &s.theta)) / n).max(2.0 * least);
        let ratio = (most / least).powf(1.0 / (ELEMENTS - 1) as f64);
        let torque = range(&all(|s| &s.torque)).max(1e-9);
        Self {
            radii: (0..ELEMENTS)
                .map(|i| least * ratio.powi(i as i32))
                .collect(),
            turns: HYSTERESIS.iter().map(|share| share * torque).collect(),
        }
    }

    fn priors(&self, known: &DriveKnowledge, torque: f64, viscous: f64) -> Vec<Prior> {
        let coulomb = known.coulomb.max(1e-3 * torque);
        let mut priors = vec![Prior::new(0.0, 1.0); COLUMNS];
        priors[INERTIA] = Prior::at_least(known.inertia, known.inertia, 0.0);
        priors[GAIN] = Prior::at_least(1.0, GAIN_SIGMA, 0.0);
        priors[LOAD] = Prior::at_least(0.0, LOAD_SIGMA, 0.0);
        priors[VISCOUS] = Prior::new(known.viscous, viscous);
        priors[ASYMMETRY] = Prior::new(0.0, 0.3 * viscous);
        priors[OFFSET] = Prior::new(0.0, torque);
        // A set-point acts anywhere in its period: a uniform distribution.
        priors[LATER] = Prior::new(0.0, 0.3);
        // The gear's damping over its stiffness, s.
        let rate = 2.0 * GEAR_DAMPING * (known.inertia / known.gear_stiffness).sqrt();
        priors[GEAR_RATE] = Prior::at_least(0.0, rate, 0.0);
        let share = coulomb / self.radii.len() as f64;
        priors.extend(vec![Prior::at_least(share, coulomb, 0.0); self.radii.len()]);
        // A bristle is damped as its stiffness and the rotor are: sigma_1 near the root of both.
        let damping = |r: &f64| (coulomb * r * known.inertia).sqrt();
        let damped = self.radii.iter().take(DAMPED);
        priors.extend(damped.map(|r| Prior::at_least(0.0, 3.0 * damping(r), 0.0)));
        let range = self.turns.last().copied().unwrap_or(0.0) / HYSTERESIS[HYSTERESIS.len() - 1];
        let turn = Prior::at_least(0.0, HYSTERESIS_SIGMA * range, 0.0);
        priors.extend(vec![turn; self.turns.len()]);
        priors
    }
}

/// The equation's terms along a stretch.
struct Terms {
    /// By column, then sample: smooth, and less their slow part.
    smooth: Vec<Vec<f64>>,
    fast: Vec<Vec<f64>>,
    /// Samples at which every filter is full and every element has slipped.
    full: std::ops::Range<usize>,
    reach: usize,
}

impl Terms {
    fn new(
        known: &DriveKnowledge,
        [smooth, period]: [f64; 2],
        s: &DriveStretch,
        law: &Law,
        scales: &Scales,
    ) -> Self {
        let constant = known.torque_constant * known.gear_ratio;
        let n = s.theta.len();
        let gaussian = Gaussian::new(smooth, period);
        // From the first angle on: its level would swamp the differences.
        let start = s.theta.first().copied().unwrap_or(0.0);
        let x: Vec<f64> = s
            .theta
            .iter()
            .map(|t| (t - start) / known.gear_ratio)
            .collect();
        let triangle = |list: &[f64], k: usize| (list[k - 1] + 4.0 * list[k] + list[k + 1]) / 6.0;
        let inner = |of: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let inside = |k: usize| (1..n.saturating_sub(1)).contains(&k);
            (0..n)
                .map(|k| if inside(k) { of(k) } else { 0.0 })
                .collect()
        };
        let steps = steps(known, s, law);
        // Friction follows the smooth angle: an encoder's noise would loosen what sticks.
        let (angle, torque) = (gaussian.of(&x), gaussian.of(&s.torque));
        let elements: Vec<Vec<f64>> = scales.radii.iter().map(|r| stop(&angle, *r)).collect();
        let middle = &elements[elements.len() / 2];
        let mut columns = vec![
            inner(&|k| (x[k + 1] - 2.0 * x[k] + x[k - 1]) / (period * period)),
            inner(&|k| triangle(&s.torque, k)),
            inner(&|k| middle[k] * torque[k].abs()),
            inner(&|k| (x[k + 1] - x[k - 1]) / (2.0 * period)),
            inner(&|k| (angle[k + 1] - angle[k - 1]).abs() / (2.0 * period)),
            vec![1.0; n],
            inner(&|k| -0.5 * constant * law.gain.value * (steps[k - 1] + steps[k])),
            inner(&|k| (s.torque[k + 1] - s.torque[k - 1]) / (2.0 * period)),
        ];
        columns.extend(elements.iter().cloned());
        let rate = |z: &[f64], k: usize| (z[k + 1] - z[k - 1]) / (2.0 * period);
        columns.extend(elements.iter().take(DAMPED).map(|z| inner(&|k| rate(z, k))));
        columns.extend(scales.turns.iter().map(|r| stop(&torque, *r)));
        columns.push(inner(&|k| constant * triangle(&s.current, k)));
        let smooth: Vec<Vec<f64>> = columns.iter().map(|column| gaussian.of(column)).collect();
        let slow = Gaussian::new(SLOW_S, period);
        let fast = smooth.iter().map(|column| {
            let mean = slow.of(column);
            column.iter().zip(mean).map(|(x, mean)| x - mean).collect()
        });
        let first = gaussian.reach + 1;
        // Until the elements have once slipped, their stretch is not known.
        let widest = scales.radii.last().copied().unwrap_or(0.0);
        let from = angle.get(first).copied().unwrap_or(0.0);
        let turned = angle
            .iter()
            .skip(first)
            .position(|x| (x - from).abs() > 2.0 * widest);
        Self {
            fast: fast.collect(),
            smooth,
            full: first + turned.unwrap_or(0).max(law.shares.len())..n.saturating_sub(first + 1),
            reach: slow.reach,
        }
    }

    /// Sample, columns, right side.
    fn rows(&self, fast: bool) -> impl Iterator<Item = (usize, Vec<f64>, f64)> {
        let (all, end) = if fast {
            (&self.fast, self.full.end.saturating_sub(self.reach))
        } else {
            (&self.smooth, self.full.end)
        };
        let start = if fast {
            self.full.start + self.reach
        } else {
            self.full.start
        };
        (start..end.max(start)).map(move |k| {
            let mut row: Vec<f64> = all.iter().map(|column| column[k]).collect();
            let y = row.pop().unwrap_or(0.0);
            (k, row, y)
        })
    }
}

/// Change of the drive's error by the set-points that act between each sample and the next, rad or A.
fn steps(known: &DriveKnowledge, s: &DriveStretch, law: &Law) -> Vec<f64> {
    let n = s.theta.len();
    let acts = |error: f64| {
        if known.takes_position {
            zone(error, law)
        } else {
            error
        }
    };
    let step_at = |k: usize| {
        if !(law.shares.len()..n.saturating_sub(1)).contains(&k) {
            return 0.0;
        }
        let x = if known.takes_position {
            0.5 * (s.theta[k] + s.theta[k + 1]) / known.gear_ratio
        } else {
            0.0
        };
        let step = law
            .shares
            .iter()
            .enumerate()
            .map(|(j, share)| share * (acts(s.sent[k + 1 - j] - x) - acts(s.sent[k - j] - x)));
        step.sum()
    };
    (0..n).map(step_at).collect()
}
