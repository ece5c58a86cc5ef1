//! Encoders: one link seen from both sides of its gear. Their difference is a torsion, and no
//! gear's torsion exceeds some hundredths of a radian.

use super::LogKind;
use super::contradictions::{LATE_NAMED, LATE_REFUSED, MIN_LAG_S, SIGNIFICANT};
use super::probes::Probes;
use super::signals::{Signals, constant, deviation, span};
use crate::least_squares::{Batch, Solution};
use joint_file::JointFile;
use problem::Problem;
use std::f64::consts::{PI, TAU};

/// Span of the torsion that no gear reaches, rad: 2.5 times the rated torque both ways on a gear
/// of a hundred rated torques per radian, a quarter of what catalogues have.
const MAX_TORSION: f64 = 0.05;
/// The same of an unloaded turn, rad: kinematic error and drag.
const MAX_UNLOADED_TORSION: f64 = 0.008;
/// Longest delay between the encoders that is looked for, s.
const MAX_LATE_S: f64 = 0.2;
/// Span of theta/N - q over that of q below which both are one encoder: rounding.
const ONE_ENCODER: f64 = 1e-7;
/// Skew that may be taken out first, periods: what a joint file may hold.
const MAX_SKEW: f64 = 16.0;
/// Deviation of the slope of theta/N over q from one: parts, and rad over the angle covered. Two
/// neighbouring ratios differ by 1/320 at least; kinematic error and torsion are below 1.2 mrad.
const MAX_SLOPE_ERROR: f64 = 0.002;
const MAX_SLOPE_TORSION: f64 = 0.0012;
/// Step of the torsion from one row to the next that is no load, rad.
const MAX_TORSION_STEP: f64 = 0.015;
/// Multiple of the torsion's ordinary steps (99 of 100 are smaller) from which on one is a change of the zero.
const MIN_STEP: f64 = 3.0;
/// Cure of a lag.
const LATE_CURE: &str =
    "channels of one instant; `delay_ms` in the map of `torquectl import` shifts one";
/// Share of the rows in motion at which an encoder may repeat its number.
const MAX_HELD: f64 = 0.4;
/// A turn's log that covers more than this is no turn, rad.
const MAX_TURNS: f64 = 30.0 * TAU;

pub(super) fn check(
    s: &Signals,
    joint: &JointFile,
    kind: LogKind,
    problems: &mut Vec<Problem>,
    notes: &mut Vec<String>,
) {
    for (name, values, other) in [("theta", &s.u, &s.q), ("q", &s.q, &s.u)] {
        if constant(values) && span(other) > 1e-3 {
            let name = kind.name(name);
            let reason = format!("{name} is constant while the other encoder moves");
            problems.push(Problem::new(reason, "both encoders of the joint"));
            return;
        }
    }
    let torsion: Vec<f64> = s.u.iter().zip(&s.q).map(|(u, q)| u - q).collect();
    if span(&torsion) < ONE_ENCODER * span(&s.q) {
        if kind != LogKind::Current {
            let (theta, q) = (kind.name("theta"), kind.name("q"));
            let reason = format!(
                "one encoder: {q} is {theta} over the gear ratio, so that no torsion is measured"
            );
            let allowed =
                "encoders on both sides of the gear; `torquectl fit current` does with one";
            problems.push(Problem::new(reason, allowed));
        }
        return;
    }
    let fit = slope(s);
    let skew = fit.as_ref().map_or(0.0, |f| f.x[1]);
    let longest = MAX_SKEW * joint.sample_period();
    let skew = if skew.abs() < longest { skew } else { 0.0 };
    let aligned: Vec<f64> = torsion
        .iter()
        .zip(&s.dq)
        .map(|(x, dq)| x - skew * dq)
        .collect();
    let most = match kind {
        LogKind::NoLoad => MAX_UNLOADED_TORSION,
        _ => MAX_TORSION,
    };
    if steps(s, &torsion, problems) {
        return;
    }
    let before = problems.len();
    held(s, kind, problems);
    if problems.len() > before {
        return;
    }
    let found = span(&aligned);
    if found > most {
        problems.push(diagnosis(s, joint, kind, &fit, found, most));
        return;
    }
    // A joint that was fitted has its skew taken out.
    let known = joint.encoders.as_ref().map_or(0.0, |e| e.skew);
    if let Some(skew) = fit
        .as_ref()
        .filter(|_| kind != LogKind::NoLoad)
        .and_then(|fit| Skew::new(s, fit, known))
    {
        let text = skew.text(kind);
        if skew.late.abs() > longest && skew.effect > LATE_REFUSED {
            let reason = format!("{text}, more than a joint file's skew of {MAX_SKEW} periods");
            problems.push(Problem::new(reason, LATE_CURE));
            return;
        }
        notes.push(format!("{text}; {LATE_CURE}"));
    }
    if let Some(fit) = fit.filter(|f| determined(f, s)) {
        let error = fit.x[0] - 1.0;
        if error.abs() > MAX_SLOPE_ERROR && error.abs() * span(&s.q) > MAX_SLOPE_TORSION {
            let n = joint.joint.gear_ratio;
            let reason = format!(
                "the encoders show a gear ratio of {:.2}, the joint's `gear_ratio` is {n}",
                n * fit.x[0]
            );
            problems.push(Problem::new(
                reason,
                "the ratio of motor turns to link turns",
            ));
        }
    }
    if kind == LogKind::NoLoad && span(&s.q) > MAX_TURNS {
        notes.push(format!(
            "`q` covers {:.0} rad: is it in degrees?",
            span(&s.q)
        ));
    }
}

/// The torque, or the current where no torque is known throughout.
fn load(s: &Signals) -> &[f64] {
    let known = s.tau.iter().all(|tau| tau.is_finite());
    if known { &s.tau } else { &s.current }
}

fn stride(s: &Signals) -> usize {
    s.q.len().div_ceil(20_000).max(1)
}

/// Coefficients of [`slope`]. Angles are taken from the first, so that counts of an absolute encoder keep their digits.
fn row(s: &Signals, load: &[f64], i: usize) -> [f64; 4] {
    [s.q[i] - s.q[0], s.dq[i], load[i], 1.0]
}

/// theta/N = slope q + skew dq + compliance tau + constant; none of a joint at rest.
fn slope(s: &Signals) -> Option<Solution> {
    let mut batch = Batch::new(4);
    let load = load(s);
    for i in (0..s.q.len()).step_by(stride(s)) {
        batch.add(&row(s, load, i), s.u[i] - s.u[0]);
    }
    // A constant load depends on the constant.
    let all = batch.solve_columns(1e-12, |_| true);
    all.filter(|f| f.x.iter().all(|x| x.is_finite()))
        .or_else(|| batch.solve_columns(1e-12, |i| i != 2))
}

/// Time by which the link side is late against the motor side.
struct Skew {
    /// s; below zero it is early.
    late: f64,
    /// Twice its standard deviation, by samples that count as independent, s.
    within: f64,
    /// Torsion that it makes, RMS, over that of the load.
    effect: f64,
}

impl Skew {
    /// A skew beyond the known one, s, that is certain and that a torque shows.
    fn new(s: &Signals, fit: &Solution, known: f64) -> Option<Self> {
        let load = load(s);
        let rows = (0..s.q.len()).step_by(stride(s));
        let residual: Vec<f64> = rows
            .map(|i| {
                let sum: f64 = row(s, load, i)
                    .iter()
                    .zip(fit.x.iter())
                    .map(|(a, x)| a * x)
                    .sum();
                s.u[i] - s.u[0] - sum
            })
            .collect();
        let counted = Probes::independent(&residual) / residual.len() as f64;
        let sigma = fit.sigma[1] / counted.sqrt();
        let late = fit.x[1] - known;
        let skew = Self {
            late,
            within: 2.0 * sigma,
            effect: late.abs() * deviation(&s.dq) / (fit.x[2].abs() * deviation(load)).max(1e-12),
        };
        let certain = late.abs() > SIGNIFICANT * sigma && late.abs() > MIN_LAG_S;
        (certain && skew.effect > LATE_NAMED).then_some(skew)
    }

    fn text(&self, kind: LogKind) -> String {
        let [q, theta] = ["q", "theta"].map(|column| kind.name(column));
        let late = self.late.abs();
        format!(
            "{q} is {} by {:.0} ms ({:.0} to {:.0}) against {theta}: {:.0} % of the torque",
            if self.late > 0.0 { "late" } else { "early" },
            1e3 * late,
            1e3 * (late - self.within),
            1e3 * (late + self.within),
            100.0 * self.effect
        )
    }
}

fn determined(fit: &Solution, s: &Signals) -> bool {
    span(&s.q) > 0.02 && fit.sigma[0] * 20.0 < MAX_SLOPE_ERROR
}

/// Why the two encoders do not show one link.
fn diagnosis(
    s: &Signals,
    joint: &JointFile,
    kind: LogKind,
    fit: &Option<Solution>,
    found: f64,
    most: f64,
) -> Problem {
    let n = joint.joint.gear_ratio;
    let j = &joint.joint;
    let (theta, link) = (kind.name("theta"), kind.name("q"));
    let theta_units = [
        (String::new(), 1.0),
        (format!("{theta} is in degrees"), 180.0 / PI),
        (
            format!("{theta} is in counts"),
            j.motor_counts_per_turn / TAU,
        ),
        (format!("{theta} is in turns"), 1.0 / TAU),
        (
            format!("{theta} is already divided by the gear ratio"),
            1.0 / n,
        ),
        (format!("{theta} and {link} are swapped"), 1.0 / (n * n)),
    ];
    let q_units = [
        (String::new(), 1.0),
        (format!("{link} is in degrees"), 180.0 / PI),
        (format!("{link} is in counts"), j.link_counts_per_turn / TAU),
        (format!("{link} is in turns"), 1.0 / TAU),
    ];
    let reversed = if shown_reversed(fit) {
        format!("one of {theta} and {link} is reversed")
    } else {
        String::new()
    };
    let shown = fit.as_ref().map_or(f64::NAN, |f| f.x[0]);
    let mut cause = None;
    for (motor, a) in &theta_units {
        for (q, b) in &q_units {
            let matches = (shown.abs() * b / a - 1.0).abs() < 0.02;
            let simple = motor.is_empty() || q.is_empty();
            if matches && simple && cause.is_none() {
                let parts = [motor.as_str(), q, &reversed];
                let parts: Vec<&str> = parts.into_iter().filter(|p| !p.is_empty()).collect();
                cause = (!parts.is_empty()).then(|| parts.join("; "));
            }
        }
    }
    let wraps =
        s.u.windows(2)
            .filter(|w| ((w[1] - w[0]).abs() * n - TAU).abs() < 0.1 * TAU)
            .count();
    let cause = match cause.or_else(|| late(s, kind, most)) {
        Some(cause) => cause,
        None if wraps > 2 && (shown - 1.0).abs() > 0.05 => {
            format!("{theta} is not unwrapped: it steps by a turn of the motor")
        }
        None if (0.5..2.0).contains(&shown) && (shown - 1.0).abs() > MAX_SLOPE_ERROR => format!(
            "the encoders show a gear ratio of {:.2}, the joint's `gear_ratio` is {n}",
            n * shown
        ),
        None if span(&s.q) > 6.0 && (shown - 1.0).abs() < 0.05 => {
            "both encoders are in degrees, or a step lies in one of them".to_owned()
        }
        None => "the two encoders do not show the same link".to_owned(),
    };
    let reason = format!("{cause}: theta/N - q spans {found:.4} rad");
    Problem::new(
        reason,
        format!("at most {most} rad, by {theta} and {link} in rad of one joint, {theta} unwrapped"),
    )
}

/// The link side's delay that makes both one link, in words.
fn late(s: &Signals, kind: LogKind, most: f64) -> Option<String> {
    let n = s.q.len();
    let period = (s.t[n - 1] - s.t[0]) / (n - 1) as f64;
    let longest = ((MAX_LATE_S / period) as i64).min(n as i64 / 8);
    let step = (longest / 64).max(1);
    let spans = (-longest..=longest).step_by(step as usize).map(|shift| {
        let first = longest as usize;
        let torsion: Vec<f64> = (first..n - first)
            .step_by(n.div_ceil(4000).max(1))
            .map(|k| s.u[k] - s.q[(k as i64 + shift) as usize])
            .collect();
        (span(&torsion), shift)
    });
    let (least, shift) = spans.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let late = shift as f64 * period;
    let way = if late > 0.0 { "late" } else { "early" };
    (least < 0.6 * most && shift.abs() > step).then(|| {
        let [q, theta] = ["q", "theta"].map(|c| kind.name(c));
        format!(
            "{q} is {way} by some {:.0} ms against {theta}",
            1e3 * late.abs()
        )
    })
}

/// One encoder counts against the other.
fn shown_reversed(fit: &Option<Solution>) -> bool {
    fit.as_ref().is_some_and(|fit| fit.x[0] < 0.0)
}

/// Encoder zeros that change within the log: a few steps, where another unit would make many.
fn steps(s: &Signals, torsion: &[f64], problems: &mut Vec<Problem>) -> bool {
    const MAX_STEPS: usize = 3;
    let mut sizes: Vec<f64> = torsion.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    sizes.sort_by(f64::total_cmp);
    // Encoders that show different links leave each other by as much in many rows.
    let ordinary = sizes.get(sizes.len() * 99 / 100).copied().unwrap_or(0.0);
    let least = MAX_TORSION_STEP.max(MIN_STEP * ordinary);
    let far = |w: &[f64]| (w[1] - w[0]).abs() > least;
    let count = torsion.windows(2).filter(|w| far(w)).count();
    let first = torsion.windows(2).position(far);
    let Some(i) = first.filter(|_| count <= MAX_STEPS) else {
        return false;
    };
    let reason = format!(
        "theta/N - q steps by {:.4} rad at t = {:.4} s: an encoder lost its zero, or two recordings \
         were joined",
        torsion[i + 1] - torsion[i],
        s.t[i + 1]
    );
    problems.push(Problem::new(
        reason,
        "one zero of each encoder within a log",
    ));
    true
}

/// An encoder that repeats its number while the other moves on: sampled more slowly than logged.
fn held(s: &Signals, kind: LogKind, problems: &mut Vec<Problem>) {
    let fastest = s.dq.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    for (name, values) in [("theta", &s.u), ("q", &s.q)] {
        // Steps between neighbouring numbers that differ: the resolution at speed.
        let moving: Vec<usize> = (1..values.len())
            .filter(|&i| s.dq[i].abs() > 0.3 * fastest && s.dq[i].abs() > 0.02)
            .collect();
        if moving.len() < 50 {
            continue;
        }
        let repeats = moving
            .iter()
            .filter(|&&i| values[i] == values[i - 1])
            .count();
        let quantum = values
            .windows(2)
            .map(|w| (w[1] - w[0]).abs())
            .filter(|d| *d > 0.0)
            .fold(f64::INFINITY, f64::min);
        let slow = 0.3 * fastest.max(0.06) * (s.t[1] - s.t[0]);
        // A coarse encoder repeats its number by its resolution.
        if repeats as f64 > MAX_HELD * moving.len() as f64 && quantum < slow {
            let reason = format!(
                "{} repeats its number in {:.0} % of the rows in motion: it is sampled more slowly than \
                 {}",
                kind.name(name),
                100.0 * repeats as f64 / moving.len() as f64,
                match kind {
                    LogKind::Recorded => "the loop runs",
                    _ => "`sample_rate_hz`",
                }
            );
            problems.push(Problem::new(reason, "a new reading in every row"));
        }
    }
}
