//! The drive's own law from set-point, motor angle and measured current (D5 with D 3.2.1's dead zone).
//!
//! ```text
//! i(k) = sum over j of g_j zone(u(k - j) - x(k) - e_0; w) + b x'(k) + c x''(k) + i_0
//! ```
//! `g_j` over their sum is the share of samples at which the set-point of j periods before acts: one
//! of them for a steady transport, several for one that jitters. Their sum is k_d / (K_t N). The angle that
//! the drive used is older than the sample by its lag: `b = g lag - d_d / (K_t N)`; its velocity is
//! older still, which `c` takes. Linear but for w and e_0, for which Gauss-Newton steps follow a search.

use super::smooth::Gaussian;
use super::{
    DriveKnowledge, DriveLog, DriveStretch, ENOUGH, PRIOR_WIDTH, Value, angle_sigma, blocks,
    median, rms, value,
};
use crate::blocks::{Blocks, Posterior, Prior};
use crate::least_squares::Batch;
use std::f64::consts::PI;

/// The law, in terms of current.
pub(super) struct Law {
    /// k_d / (K_t N), A/rad; of a drive that takes currents measured over commanded current, 1.
    pub(super) gain: Value,
    /// d_d / (K_t N), A·s/rad.
    pub(super) damping: Value,
    /// w, rad.
    pub(super) dead_zone: Value,
    /// Mean number of periods after which a set-point shows.
    pub(super) periods: Value,
    /// Shares of the set-points of 0, 1, .. periods before.
    pub(super) shares: Vec<f64>,
    /// e_0: offset of the drive's angle, rad.
    pub(super) angle_offset: f64,
    /// Root mean square of the current, and of the rest, A.
    pub(super) rms: [f64; 2],
    pub(super) notes: Vec<String>,
}

/// Longest delay that is looked for, s and periods.
const LONGEST_S: f64 = 8e-3;
const LONGEST: [usize; 2] = [4, 9];
/// Widths of the dead zone tried first, as quantiles of the set-point's error.
const TRIED: usize = 24;
const STEPS: usize = 12;
/// Rows further from the law than so many standard deviations are left out: lost commands, limits.
const OUTLIER: f64 = 6.0;
/// Offset of the current before the data, as a share of its largest.
const OFFSET: f64 = 0.03;
/// Standard deviation of the mean over time, s.
const SMOOTH_S: f64 = 3e-3;
/// A loop slower than this takes differences instead of local cubics, s.
const SLOW_S: f64 = 2.5e-3;
/// Standard deviation of the drive's lag, as a share of it.
const LAG_SIGMA: f64 = 0.5;

/// Samples before a row that it needs, and after it.
struct Frame {
    lags: usize,
    ahead: usize,
    slow: bool,
}

/// One sample: angle, velocity, acceleration link side, current, and the set-points before it.
struct Row<'a> {
    stretch: usize,
    place: f64,
    x: [f64; 3],
    current: f64,
    /// Newest first, beginning with that of this sample.
    sent: &'a [f64],
}

/// Nonlinear parameters: dead zone and angle's offset, rad.
#[derive(Clone, Copy)]
struct Zone {
    width: f64,
    offset: f64,
}

impl Zone {
    fn of(self, error: f64) -> f64 {
        let error = error - self.offset;
        error - error.clamp(-self.width, self.width)
    }

    /// Sign of the error outside of the zone.
    fn side(self, error: f64) -> f64 {
        let error = error - self.offset;
        if error.abs() > self.width {
            error.signum()
        } else {
            0.0
        }
    }
}

/// Outside of its dead zone, what a drive makes of the error.
pub(super) fn zone(error: f64, law: &Law) -> f64 {
    let zone = Zone {
        width: law.dead_zone.value,
        offset: law.angle_offset,
    };
    zone.of(error)
}

pub(super) fn fit(known: &DriveKnowledge, log: &DriveLog) -> Option<Law> {
    let lags = (LONGEST_S / log.period).ceil() as usize;
    let slow = log.period > SLOW_S;
    let frame = Frame {
        lags: lags.clamp(LONGEST[0], LONGEST[1]),
        ahead: if slow { 1 } else { 3 },
        slow,
    };
    let sent: Vec<Vec<f64>> = (log.stretches.iter())
        .map(|s| s.sent.iter().rev().copied().collect())
        .collect();
    let mut rows = Vec::new();
    let total: usize = log.stretches.iter().map(|s| s.theta.len()).sum();
    let mut before = 0;
    for (index, (stretch, sent)) in log.stretches.iter().zip(&sent).enumerate() {
        let n = stretch.theta.len();
        for k in frame.lags.max(frame.ahead)..n.saturating_sub(frame.ahead) {
            rows.push(Row {
                stretch: index,
                place: (before + k) as f64 / total as f64,
                x: frame.angle(stretch, k, known.gear_ratio, log.period),
                current: stretch.current[k],
                sent: &sent[n - 1 - k..n - k + frame.lags],
            });
        }
        before += n;
    }
    if known.takes_position {
        of_position(known, log, &frame, &rows)
    } else {
        of_current(known, log, &frame, &rows)
    }
}

impl Frame {
    /// Angle and two derivatives at sample k, by a cubic over seven samples (Savitzky and Golay 1964).
    fn angle(&self, s: &DriveStretch, k: usize, n: f64, period: f64) -> [f64; 3] {
        let at = |weights: &[f64], norm: f64| {
            let half = weights.len() / 2;
            let samples = &s.theta[k - half..=k + half];
            // Relative to the middle: the angle is large, its changes are small.
            let sum = weights
                .iter()
                .zip(samples)
                .map(|(w, x)| w * (x - s.theta[k]));
            sum.sum::<f64>() / (norm * n)
        };
        let x = s.theta[k] / n;
        if self.slow {
            let (v, a) = (at(&[-1.0, 0.0, 1.0], 2.0), at(&[1.0, -2.0, 1.0], 1.0));
            return [x, v / period, a / (period * period)];
        }
        let value = at(&[-2.0, 3.0, 6.0, 7.0, 6.0, 3.0, -2.0], 21.0);
        let v = at(&[22.0, -67.0, -58.0, 0.0, 58.0, 67.0, -22.0], 252.0);
        let a = at(&[5.0, 0.0, -3.0, -4.0, -3.0, 0.0, 5.0], 42.0);
        [x + value, v / period, a / (period * period)]
    }
}

/// Columns after those of the set-points: velocity, acceleration, offset of the current, and these.
const GAIN: usize = 0;
const VELOCITY: usize = 0;
const WIDTH: usize = 3;
const ANGLE_OFFSET: usize = 4;
const COLUMNS: usize = 5;

fn of_position(
    known: &DriveKnowledge,
    log: &DriveLog,
    frame: &Frame,
    rows: &[Row<'_>],
) -> Option<Law> {
    let constant = known.torque_constant * known.gear_ratio;
    let (gain, damping) = (known.stiffness / constant, known.damping / constant);
    let largest = rows
        .iter()
        .fold(0.0, |m: f64, row| m.max(row.current.abs()));
    let lags = frame.lags + 1;
    let width = known
        .dead_zone
        .max(known.motor_resolution / known.gear_ratio);
    let mut priors = vec![Prior::at_least(gain / lags as f64, 3.0 * gain, 0.0); lags];
    priors.extend([
        Prior::new(-damping, 3.0 * damping + gain * log.period),
        Prior::new(0.0, (3.0 * damping + gain * log.period) * 2.0 * log.period),
        Prior::new(0.0, OFFSET * largest),
        Prior::at_least(known.dead_zone, 3.0 * width, 0.0),
        Prior::new(0.0, known.motor_resolution / known.gear_ratio),
    ]);
    let mut zone = Zone {
        width: search(frame, rows, known.dead_zone),
        offset: 0.0,
    };
    let mut used = vec![true; rows.len()];
    let mut best: Option<(Posterior, Vec<f64>)> = None;
    for step in 0..STEPS {
        let gains: Vec<f64> = match &best {
            Some((posterior, _)) => posterior.x.iter().take(lags).copied().collect(),
            None => linear(frame, rows, zone)?.0,
        };
        let columns = |row: &Row<'_>| columns(row, zone, &gains, lags);
        let mut all = Blocks::new(lags + COLUMNS, blocks(log), 1.0);
        for (row, _) in rows.iter().zip(&used).filter(|(_, used)| **used) {
            let (a, known) = columns(row);
            all.add(row.place, &a, row.current - known);
        }
        let posterior = all.fit_at(&priors, rows_per_one(log))?;
        let rest = rows.iter().map(|row| {
            let (a, known) = columns(row);
            let model: f64 = a.iter().zip(posterior.x.iter()).map(|(a, x)| a * x).sum();
            row.current - known - model
        });
        let rest: Vec<f64> = rest.collect();
        let sigma = 1.4826 * median(rest.iter().map(|r| r.abs()).collect());
        used = rest.iter().map(|r| r.abs() <= OUTLIER * sigma).collect();
        let (width, offset) = (posterior.x[lags + WIDTH], posterior.x[lags + ANGLE_OFFSET]);
        let moved = (width - zone.width).abs() + (offset - zone.offset).abs();
        best = Some((posterior, rest));
        if moved < 1e-3 * (zone.width + known.motor_resolution / known.gear_ratio) && step > 1 {
            break;
        }
        // Half steps: the zone's ends move rows from one side to the other.
        zone.width += 0.7 * (width - zone.width);
        zone.offset += 0.7 * (offset - zone.offset);
    }
    let (first, rest) = best?;
    let total: f64 = first.x.iter().take(lags).sum();
    let shares: Vec<f64> = first.x.iter().take(lags).map(|g| g / total).collect();
    let prior = |column: usize| priors[lags + column];
    let coarse = [
        Prior::at_least(gain, 9.0 * gain, 0.0),
        prior(0),
        prior(1),
        prior(2),
        prior(3),
        prior(4),
    ];
    let posterior = smooth(log, rows, &used, &shares, &mut zone, &coarse)?;
    // Both ways of averaging see the same law; how far they differ is part of what is not known.
    let apart = |x: f64, other: f64, value: Value| Value {
        sigma: value.sigma.hypot(x - other),
        ..value
    };
    let of_rows = |column: usize| (first.x[lags + column], posterior.x[1 + column]);
    let gain_found = value(&posterior, GAIN, gain, PRIOR_WIDTH * gain);
    let gain_found = apart(total, gain_found.value, gain_found);
    let (before, after) = of_rows(VELOCITY);
    let velocity = value(
        &posterior,
        1 + VELOCITY,
        -damping,
        coarse[1 + VELOCITY].sigma,
    );
    let velocity = apart(before, after, velocity);
    let of_lag = LAG_SIGMA * known.lag * gain_found.value;
    // Standard deviation of the Gaussian's derivative of white noise: sqrt(T / (4 sqrt(pi) s³)).
    let noise = angle_sigma(known) * (log.period / (4.0 * PI.sqrt() * SMOOTH_S.powi(3))).sqrt();
    let fast = rms(rows.iter().map(|row| row.x[1])) > ENOUGH * noise;
    let mut notes = Vec::new();
    let left_out = used.iter().filter(|used| !**used).count() as f64 / rows.len().max(1) as f64;
    if left_out > 0.005 {
        notes.push(format!(
            "{:.1} % of the samples contradict the drive's law (lost commands, current limit) and are left out",
            100.0 * left_out
        ));
    }
    let sides = |side: f64| {
        let on = |row: &&Row<'_>| zone.side(row.sent[0] - row.x[0]) == side;
        rows.iter().filter(on).count() as f64 / rows.len().max(1) as f64
    };
    let crossed = sides(-1.0) > 0.01 && sides(1.0) > 0.01;
    if !crossed {
        notes
            .push("the torque never changes its sign, so that the dead zone is not crossed".into());
    }
    let mut dead_zone = value(&posterior, 1 + WIDTH, known.dead_zone, 3.0 * width);
    let (before, after) = of_rows(WIDTH);
    dead_zone = apart(before, after, dead_zone);
    let dead_zone = dead_zone.or_configured(3.0 * width, crossed);
    Some(Law {
        periods: periods(&first, lags),
        shares,
        gain: gain_found.or_configured(PRIOR_WIDTH * gain, true),
        damping: Value {
            value: known.lag * gain_found.value - velocity.value,
            sigma: velocity.sigma.hypot(of_lag),
            configured: damping,
            determined: true,
        }
        .or_configured(PRIOR_WIDTH * damping, fast),
        dead_zone,
        angle_offset: posterior.x[1 + ANGLE_OFFSET],
        rms: [
            rms(rows.iter().map(|row| row.current)),
            rms(rest
                .iter()
                .zip(&used)
                .filter(|(_, used)| **used)
                .map(|(r, _)| *r)),
        ],
        notes,
    })
}

/// The law with the set-points' shares known, every term averaged over the same few milliseconds: a velocity
/// from counts is noisy, and noise in a term makes its coefficient too small.
fn smooth(
    log: &DriveLog,
    rows: &[Row<'_>],
    used: &[bool],
    shares: &[f64],
    zone: &mut Zone,
    priors: &[Prior],
) -> Option<Posterior> {
    let gaussian = Gaussian::new(SMOOTH_S, log.period);
    let mut best: Option<Posterior> = None;
    for step in 0..STEPS {
        let gain = best
            .as_ref()
            .map_or(priors[GAIN].mean, |posterior| posterior.x[GAIN]);
        let gains: Vec<f64> = shares.iter().map(|share| gain * share).collect();
        let mut columns = vec![Vec::new(); COLUMNS + 2];
        for row in rows {
            let (a, known) = self::columns(row, *zone, &gains, shares.len());
            let (errors, others) = a.split_at(shares.len());
            columns[0].push(errors.iter().zip(shares).map(|(z, share)| z * share).sum());
            for (column, x) in columns[1..].iter_mut().zip(others) {
                column.push(*x);
            }
            columns[COLUMNS + 1].push(row.current - known);
        }
        let columns: Vec<Vec<f64>> = columns.iter().map(|column| gaussian.of(column)).collect();
        let mut all = Blocks::new(COLUMNS + 1, blocks(log), 1.0);
        for k in gaussian.reach..rows.len().saturating_sub(gaussian.reach) {
            let window = k - gaussian.reach..=k + gaussian.reach;
            // Neither lost commands nor the end of a stretch within the mean.
            let whole = rows[*window.start()].stretch == rows[*window.end()].stretch;
            if whole && used[window].iter().all(|used| *used) {
                let a: Vec<f64> = columns[..=COLUMNS].iter().map(|column| column[k]).collect();
                all.add(rows[k].place, &a, columns[COLUMNS + 1][k]);
            }
        }
        let posterior = all.fit_at(priors, 3.0 * rows_per_one(log))?;
        let (width, offset) = (posterior.x[1 + WIDTH], posterior.x[1 + ANGLE_OFFSET]);
        let moved = (width - zone.width).abs() + (offset - zone.offset).abs();
        let change = (posterior.x[GAIN] - gain).abs() / gain.abs().max(1e-300);
        best = Some(posterior);
        if moved < 1e-3 * zone.width.max(1e-9) && change < 1e-3 && step > 1 {
            break;
        }
        zone.width += 0.7 * (width - zone.width);
        zone.offset += 0.7 * (offset - zone.offset);
    }
    best
}

/// Columns of a row for dead zone and offset near `zone`, and the part of the current that is known.
fn columns(row: &Row<'_>, zone: Zone, gains: &[f64], lags: usize) -> (Vec<f64>, f64) {
    let mut a = Vec::with_capacity(lags + COLUMNS);
    let (mut by_width, mut by_offset) = (0.0, 0.0);
    for (u, gain) in row.sent.iter().zip(gains) {
        let error = u - row.x[0];
        a.push(zone.of(error));
        let side = zone.side(error);
        by_width -= gain * side;
        by_offset -= gain * side.abs();
    }
    a.extend([row.x[1], row.x[2], 1.0, by_width, by_offset]);
    (a, -zone.width * by_width - zone.offset * by_offset)
}

/// Gains by plain least squares at a given zone, and the rest's root mean square.
fn linear(frame: &Frame, rows: &[Row<'_>], zone: Zone) -> Option<(Vec<f64>, f64)> {
    let lags = frame.lags + 1;
    let mut batch = Batch::new(lags + 3);
    let step = rows.len().div_ceil(8000).max(1);
    for row in rows.iter().step_by(step) {
        let (a, _) = columns(row, zone, &[], lags);
        let mut a: Vec<f64> = a.into_iter().take(3).collect();
        let sent = row.sent.iter().map(|u| zone.of(u - row.x[0]));
        a.splice(0..0, sent);
        a.truncate(lags + 3);
        batch.add(&a, row.current);
    }
    let found = batch.solve_bounded(1e-9, |column| column < lags)?;
    Some((found.x.iter().take(lags).copied().collect(), found.rms))
}

/// The dead zone of the smallest rest.
fn search(frame: &Frame, rows: &[Row<'_>], configured: f64) -> f64 {
    let mut errors: Vec<f64> = (rows.iter())
        .map(|row| (row.sent[1.min(row.sent.len() - 1)] - row.x[0]).abs())
        .collect();
    errors.sort_by(f64::total_cmp);
    let quantile = |share: f64| errors[((errors.len() - 1) as f64 * share) as usize];
    let tried = (0..TRIED).map(|i| match i {
        0 => 0.0,
        // Denser towards small ones.
        _ => quantile(0.9) * (i as f64 / (TRIED - 1) as f64).powf(1.5),
    });
    let rest = |width: f64| {
        let zone = Zone { width, offset: 0.0 };
        linear(frame, rows, zone).map_or(f64::INFINITY, |(_, rms)| rms)
    };
    let tried = tried.chain([configured]).map(|width| (width, rest(width)));
    tried
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(configured, |(width, _)| width)
}

fn of_current(
    known: &DriveKnowledge,
    log: &DriveLog,
    frame: &Frame,
    rows: &[Row<'_>],
) -> Option<Law> {
    let lags = frame.lags + 1;
    let largest = rows
        .iter()
        .fold(0.0, |m: f64, row| m.max(row.current.abs()));
    let mut priors = vec![Prior::at_least(1.0 / lags as f64, 3.0, 0.0); lags];
    priors.push(Prior::new(0.0, OFFSET * largest));
    let mut all = Blocks::new(lags + 1, blocks(log), 1.0);
    for row in rows {
        let mut a = row.sent.to_vec();
        a.push(1.0);
        all.add(row.place, &a, row.current);
    }
    let posterior = all.fit_at(&priors, rows_per_one(log))?;
    let gain = sum(&posterior, lags, 1.0, PRIOR_WIDTH);
    let none = Value {
        value: 0.0,
        sigma: 0.0,
        configured: known.dead_zone,
        determined: false,
    };
    Some(Law {
        periods: periods(&posterior, lags),
        shares: (posterior.x.iter().take(lags))
            .map(|g| g / gain.value)
            .collect(),
        gain,
        damping: none,
        dead_zone: none,
        angle_offset: 0.0,
        rms: [rms(rows.iter().map(|row| row.current)), posterior.rms],
        notes: Vec::new(),
    })
}

/// Rows whose errors are alike: those of the angle's smoothing window.
fn rows_per_one(log: &DriveLog) -> f64 {
    (7e-3 / log.period).clamp(1.0, 20.0)
}

/// Sum of the set-points' gains.
fn sum(posterior: &Posterior, lags: usize, configured: f64, prior_sigma: f64) -> Value {
    let total: f64 = posterior.x.iter().take(lags).sum();
    let variance = posterior.covariance.view((0, 0), (lags, lags)).sum();
    let sigma = variance.max(0.0).sqrt();
    Value {
        value: total,
        sigma,
        configured,
        determined: sigma < super::NARROWER * prior_sigma,
    }
}

/// Mean number of periods, by the gains' shares.
fn periods(posterior: &Posterior, lags: usize) -> Value {
    let total: f64 = posterior.x.iter().take(lags).sum();
    let gains = posterior.x.iter().take(lags).enumerate();
    let mean = gains.map(|(j, g)| j as f64 * g).sum::<f64>() / total;
    let slope: Vec<f64> = (0..lags).map(|j| (j as f64 - mean) / total).collect();
    let mut variance = 0.0;
    for (i, a) in slope.iter().enumerate() {
        for (j, b) in slope.iter().enumerate() {
            variance += a * b * posterior.covariance[(i, j)];
        }
    }
    Value {
        value: mean,
        sigma: variance.max(0.0).sqrt(),
        configured: 0.0,
        determined: true,
    }
}
