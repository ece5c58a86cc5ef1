//! The integral of a drive's velocity loop (P-PI), by the rate that leaves least of its current unexplained.
//!
//! Such a loop makes `m = p + z`, of `p = k_d zone(u - x) - d_d x'` and its integral `z' = p / T_i`. So `z' = (m - z) /
//! T_i`: the integral is the current through a low-pass, and the current less that low-pass is `p`, the law of a drive
//! without one. Each rate `1/T_i` that is tried makes a log whose law is fitted as any other; none is the rate zero.

use super::position_loop::{self, Law};
use super::{DriveKnowledge, DriveLog, Value, seconds};

/// Integral times tried first, s: from some periods of a bus to what a drift of the current's offset looks like.
const TIMES: [f64; 2] = [5e-3, 3.0];
const TRIED: usize = 12;
/// Golden-section steps between the neighbours of the best of them.
const STEPS: usize = 10;
/// Share of the rest without an integral that the rest with one may be: what a further parameter takes off by chance is
/// some thousandths.
const BETTER: f64 = 0.8;
/// Time in which rests count as one, s, as blocks of the jackknife do.
const ONE_S: f64 = 0.5;

/// The law with its integral's rate, 1/s; zero where none shows.
pub(super) fn fit(known: &DriveKnowledge, log: &DriveLog) -> Option<(Law, Value)> {
    let without = position_loop::fit(known, log)?;
    let none = Value {
        value: 0.0,
        sigma: 0.0,
        configured: known.integral,
        determined: true,
    };
    if !known.takes_position {
        return Some((without, none));
    }
    let rest = |rate: f64| {
        let law = position_loop::fit(known, &washed(log, rate));
        law.map_or(f64::INFINITY, |law| law.rms[1])
    };
    let rate = least(&rest);
    let found = position_loop::fit(known, &washed(log, rate))?;
    if found.rms[1] > BETTER * without.rms[1] {
        return Some((without, none));
    }
    let sigma = width(&rest, (rate, found.rms[1]), seconds(log) / ONE_S);
    let law = Law {
        rms: [without.rms[0], found.rms[1]],
        ..found
    };
    let value = Value {
        value: rate,
        sigma,
        ..none
    };
    Some((law, value))
}

/// The rate at which least is left.
fn least(rest: &dyn Fn(f64) -> f64) -> f64 {
    let step = (TIMES[1] / TIMES[0]).powf(1.0 / (TRIED - 1) as f64);
    let at = |k: usize| step.powi(k as i32) / TIMES[1];
    let best = (0..TRIED)
        .map(|k| (rest(at(k)), k))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(0, |(_, k)| k);
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut low, mut high) = ((at(best) / step).ln(), (at(best) * step).ln());
    let inner = |low: f64, high: f64| [high - golden * (high - low), low + golden * (high - low)];
    let mut points = inner(low, high);
    let mut rests = points.map(|x| rest(x.exp()));
    for _ in 0..STEPS {
        if rests[0] < rests[1] {
            high = points[1];
            points = [inner(low, high)[0], points[0]];
            rests = [rest(points[0].exp()), rests[0]];
        } else {
            low = points[0];
            points = [points[1], inner(low, high)[1]];
            rests = [rests[1], rest(points[1].exp())];
        }
    }
    (0.5 * (low + high)).exp()
}

/// Standard deviation of the rate: where the sum of squares has risen by one of its `independent` parts.
fn width(rest: &dyn Fn(f64) -> f64, (rate, least): (f64, f64), independent: f64) -> f64 {
    const ASIDE: f64 = 0.2;
    let rise = |factor: f64| (rest(factor * rate) / least).powi(2) - 1.0;
    let curvature = 0.5 * (rise(1.0 + ASIDE) + rise(1.0 - ASIDE)) / (ASIDE * rate).powi(2);
    (independent * curvature.max(f64::MIN_POSITIVE))
        .sqrt()
        .recip()
}

/// The log with the current less its integral's share at this rate, 1/s. A stretch begins at rest, where all of the current
/// is the integral's, or what it begins with fades within `T_i`.
fn washed(log: &DriveLog, rate: f64) -> DriveLog {
    // The trapezoidal rule.
    let half = 0.5 * rate * log.period;
    let mut washed = log.clone();
    for stretch in &mut washed.stretches {
        let first = stretch.current.first().copied().unwrap_or(0.0);
        let (mut integral, mut last) = (first, first);
        for current in &mut stretch.current {
            integral = ((1.0 - half) * integral + half * (*current + last)) / (1.0 + half);
            last = *current;
            *current -= integral;
        }
    }
    washed
}
