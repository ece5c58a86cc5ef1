//! Torque reference and current: constants, clipping, units and signs, and references that are the
//! current once more.

use super::LogKind;
use super::signals::{Signals, constant, deviation, span};
use crate::excitation::{Excitation, Quantity};
use crate::least_squares::Batch;
use joint_file::JointFile;
use problem::Problem;

/// Residual of a reference as a linear function of the current, parts of its deviation, below
/// which it is computed from the current. The friction of a gear leaves several per cent, of a
/// joint that moves one way only about one.
const COPIED: f64 = 0.005;
/// Low-passes and delays of a copy that are tried, s.
const COPY_TIMES_S: [f64; 5] = [0.0, 0.002, 0.005, 0.01, 0.02];
/// Rows that these comparisons look at, at most.
const MAX_ROWS: usize = 20_000;
/// A reference above the joint's torque limit by this factor is in another unit.
const MAX_OVER_LIMIT: f64 = 3.0;
/// Smallest span of the reference, parts of the rated torque.
const MIN_TORQUE_SPAN: f64 = 0.002;
/// Rows in a run of one number at the column's largest or smallest, s, from which it is clipped.
const CLIPPED_S: f64 = 0.01;
/// Share of such rows that is refused.
const MAX_CLIPPED: f64 = 0.003;
/// Share of rows away from the extremes that repeat the number before: above, the column is
/// coarse or its torque is held, and plateaus mean nothing.
const COARSE: f64 = 0.2;
/// Deviation of the torque in an unloaded turn, parts of the rated torque.
const MAX_UNLOADED: f64 = 0.1;
/// Stiffness over rated torque of gears, 1/rad: catalogues of harmonic, cycloidal and planetary
/// gears have 300 to 1500.
const STIFFNESS: [f64; 2] = [60.0, 8000.0];
/// Torque per current over N K_t. Data sheets are off by tens of per cent; a reference that is the
/// payload's part of the torque alone (an F/T sensor at the flange) shows a third of it.
const TORQUE_CONSTANT: [f64; 2] = [0.15, 6.5];
/// Span of the torque, parts of the rated torque, from which sign and size of the compliance
/// are judged: below, friction and kinematic error may exceed the torsion.
const MIN_SPAN_FOR_SIGN: f64 = 0.02;
const MIN_SPAN_FOR_STIFFNESS: f64 = 0.1;
/// Standard deviations by which an estimate must miss these bounds.
const SIGNIFICANCE: f64 = 3.0;

/// Requirements of a training log.
pub(super) fn check(
    s: &Signals,
    joint: &JointFile,
    kind: LogKind,
    problems: &mut Vec<Problem>,
    notes: &mut Vec<String>,
) {
    if !s.tau.iter().all(|tau| tau.is_finite()) {
        let reason =
            "column `tau_sensor` is missing: without a reference stiffness is not determined";
        problems.push(Problem::new(reason, kind.references()));
        return;
    }
    let mut refuse = |reason: String, allowed: &str| problems.push(Problem::new(reason, allowed));
    let [tau_name, current_name] = ["tau_sensor", "i"].map(|column| kind.name(column));
    let (rated, limit) = (joint.joint.rated_torque, joint.torque_limit());
    let torque = span(&s.tau);
    if torque < MIN_TORQUE_SPAN * rated {
        refuse(
            format!(
                "{tau_name} is constant (it spans {torque:.4} N·m): stiffness is not determined"
            ),
            "loads that change, better up to the rated torque both ways",
        );
        return;
    }
    let largest = s.tau.iter().fold(0.0f64, |m, tau| m.max(tau.abs()));
    if largest > MAX_OVER_LIMIT * limit {
        refuse(
            format!(
                "{tau_name} reaches {largest:.1} N·m: another unit{}, or another joint",
                if largest > 300.0 * rated {
                    " (mN·m?)"
                } else {
                    ""
                }
            ),
            &format!("N·m on the link side; the joint's torque limit is {limit} N·m"),
        );
    }
    if constant(&s.current) {
        refuse(
            format!("{current_name} is constant"),
            "the motor's measured current, A",
        );
        return;
    }
    for (name, values) in [(current_name, &s.current), (tau_name, &s.tau)] {
        let (share, at) = clipped(s, values);
        if share > MAX_CLIPPED {
            refuse(
                format!(
                    "{name} is clipped at {at}: {:.1} % of the rows",
                    100.0 * share
                ),
                "readings below the sensor's range",
            );
        } else if share > 0.0 {
            notes.push(format!(
                "{name} stands at {at} in {:.2} % of the rows",
                100.0 * share
            ));
        }
    }
    if let Some((factor, rest)) = copied(s, &s.current, &s.tau) {
        refuse(
            format!(
                "{tau_name} is computed from the current (it is {factor:.4} times {current_name}, but for \
                 {:.2} %): stiffness is not determined",
                100.0 * rest
            ),
            kind.references(),
        );
    }
    if let Some(model) = s.feed_forward.as_deref().filter(|model| !constant(model)) {
        if let Some((factor, rest)) = copied(s, model, &s.tau) {
            let reason = format!(
                "`tau_sensor` is computed from the feed-forward (it is {factor:.4} times `tau_feedforward`, but for \
                 {:.2} %): neither shows the other's errors",
                100.0 * rest
            );
            refuse(reason, "a torque sensor's column, or no `tau_feedforward`");
        }
        if let Some((factor, rest)) = copied(s, &s.current, model) {
            let reason = format!(
                "`tau_feedforward` is computed from the current (it is {factor:.4} times `i`, but for {:.2} %): it is \
                 no further source",
                100.0 * rest
            );
            let allowed = "the torque that a controller or a rigid-body model expects";
            refuse(reason, allowed);
        }
    }
}

/// A no-load turn must not be loaded, where the log has a torque.
pub(super) fn check_unloaded(s: &Signals, joint: &JointFile, problems: &mut Vec<Problem>) {
    let known: Vec<f64> = s
        .tau
        .iter()
        .copied()
        .filter(|tau| tau.is_finite())
        .collect();
    let spread = deviation(&known);
    if spread > MAX_UNLOADED * joint.joint.rated_torque {
        let reason = format!("the turn is loaded: `tau_sensor` varies by {spread:.2} N·m RMS");
        let allowed = "a turn without load: its torsion is taken for kinematic error";
        problems.push(Problem::new(reason, allowed));
    }
}

/// Share of rows in long runs of exactly the largest or smallest number, and that number.
fn clipped(s: &Signals, values: &[f64]) -> (f64, f64) {
    let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(low, high), x| {
        (low.min(*x), high.max(*x))
    });
    let at_end = |x: f64| x == low || x == high;
    let repeats = values
        .windows(2)
        .filter(|w| w[0] == w[1] && !at_end(w[1]))
        .count();
    let inside = values.iter().filter(|x| !at_end(**x)).count();
    if repeats as f64 > COARSE * inside as f64 {
        return (0.0, 0.0);
    }
    let shortest = (CLIPPED_S / (s.t[1] - s.t[0])).max(4.0) as usize;
    let (mut rows, mut at) = (0, 0.0);
    for run in values.chunk_by(|a, b| a == b) {
        if run.len() >= shortest && at_end(run[0]) {
            rows += run.len();
            at = run[0];
        }
    }
    (rows as f64 / values.len() as f64, at)
}

/// Factor of a column that is another one once more, as a reference that is the current, perhaps filtered,
/// delayed or either one shifted, and the part of its deviation that is not.
fn copied(s: &Signals, from: &[f64], tau: &[f64]) -> Option<(f64, f64)> {
    let period = (s.t.last()? - s.t.first()?) / (s.t.len() - 1).max(1) as f64;
    let whole = deviation(tau);
    let mut best: Option<(f64, f64)> = None;
    let mut attempt = |filtered: &[f64], reference: &[f64]| {
        let mut batch = Batch::new(2);
        let step = reference.len().div_ceil(MAX_ROWS).max(1);
        for (i, tau) in filtered.iter().zip(reference).step_by(step) {
            batch.add(&[*i, 1.0], *tau);
        }
        if let Some(solution) = batch.solve(1e-12) {
            let rest = solution.rms / whole.max(f64::MIN_POSITIVE);
            if best.is_none_or(|(_, least)| rest < least) {
                best = Some((solution.x[0], rest));
            }
        }
    };
    for time in COPY_TIMES_S {
        attempt(&low_pass(from, time / period), tau);
        let delay = (time / period).round() as usize;
        if delay > 0 && delay < tau.len() {
            attempt(&from[..tau.len() - delay], &tau[delay..]);
            attempt(&from[delay..], &tau[..tau.len() - delay]);
        }
    }
    best.filter(|(_, rest)| *rest < COPIED)
}

/// First-order low-pass with a time constant in samples.
pub(super) fn low_pass(values: &[f64], samples: f64) -> Vec<f64> {
    let pole = if samples > 0.0 {
        (-1.0 / samples).exp()
    } else {
        0.0
    };
    let mut state = values.first().copied().unwrap_or(0.0);
    let step = |x: &f64| {
        state = pole * state + (1.0 - pole) * x;
        state
    };
    values.iter().map(step).collect()
}

/// Signs and units by the constants that they lead to.
pub(super) fn implausible(found: &Excitation, joint: &JointFile, kind: LogKind) -> Vec<Problem> {
    let [tau, theta, q, current] =
        ["tau_sensor", "theta", "q", "i"].map(|column| kind.name(column));
    let mut problems = Vec::new();
    let rated = joint.joint.rated_torque;
    let span = (found.torque[1] - found.torque[0]) / rated;
    let compliance = found.measured(Quantity::Compliance);
    if let Some(compliance) = compliance.filter(|_| kind != LogKind::Current) {
        let (c, sigma) = (compliance.value, SIGNIFICANCE * compliance.sigma);
        let softest = 1.0 / (STIFFNESS[0] * rated);
        if c + sigma < 0.0 && span > MIN_SPAN_FOR_SIGN {
            let reason = format!(
                "torsion decreases as the torque grows: {tau}, or {theta} and {q} together, are reversed"
            );
            problems.push(Problem::new(reason, "theta/N - q > 0 for positive torque"));
        } else if c - sigma > softest {
            let reason = format!(
                "a stiffness of {:.1} N·m/rad is {:.2} rated torques per radian: angles in degrees, \
                 or torque or rated torque in another unit",
                1.0 / c,
                1.0 / (c * rated)
            );
            problems.push(Problem::new(
                reason,
                format!("{} to {}", STIFFNESS[0], STIFFNESS[1]),
            ));
        } else if c + sigma < 1.0 / (STIFFNESS[1] * rated) && span > MIN_SPAN_FOR_STIFFNESS {
            let reason = format!(
                "torsion hardly grows with the torque (at most {:.2} urad/(N·m)): angles, torque or \
                 rated torque in another unit, or no reference",
                1e6 * (c + sigma)
            );
            let allowed = format!(
                "a stiffness of {} to {} rated torques per radian",
                STIFFNESS[0], STIFFNESS[1]
            );
            problems.push(Problem::new(reason, allowed));
        }
    }
    if let Some(gain) = found.measured(Quantity::TorqueConstant) {
        // Amperes per newton metre, over the data sheet's.
        let (g, sigma) = (gain.value, SIGNIFICANCE * gain.sigma);
        let sheet = joint.joint.gear_ratio * joint.joint.torque_constant;
        if g + sigma < 0.0 {
            let reason = format!(
                "the torque decreases as the current grows: {current} or {tau} is reversed"
            );
            problems.push(Problem::new(reason, "positive current for positive torque"));
        } else if g - sigma > 1.0 / TORQUE_CONSTANT[0] || g + sigma < 1.0 / TORQUE_CONSTANT[1] {
            let reason = format!(
                "{:.4} N·m/A on the link side, where gear ratio times torque constant are {sheet:.4}: \
                 unit of {current}, `torque_constant_Nm_per_A` or columns swapped",
                sheet / g
            );
            let allowed = format!(
                "{} to {} times that",
                TORQUE_CONSTANT[0], TORQUE_CONSTANT[1]
            );
            problems.push(Problem::new(reason, allowed));
        }
    }
    problems
}
