//! Zeros of a fitted joint in a log that torques are estimated over: a motor-side encoder that knows its
//! angle within a turn only comes back some turns off.

use super::signals::{Signals, deviation};
use crate::log::LogRow;
use inspection::{Defect, Finding, Severity};
use joint_file::JointFile;
use problem::Problem;
use std::f64::consts::TAU;

/// Torsion that no gear reaches, rad.
const MAX_TORSION: f64 = 0.025;
/// Distance from whole turns within which a shift is taken for them, turns.
const WHOLE: f64 = 0.25;
/// Correlation of current and torsion from which they contradict each other.
const AGAINST: f64 = -0.6;

/// Square of the correlation of current and torsion from which their ratio means something, and the ratio of the
/// torques by both, either way, that no drift of a fit has.
const ALIKE: f64 = 0.7;
const MAX_RATIO: f64 = 3.0;
/// Span of the torque by torsion, of the rated torque, below which friction is most of the current.
const LOADED: f64 = 0.1;

/// Middle of theta/N - q beyond the fitted kinematic error, rad; none of a joint whose zero is not known.
fn beyond(joint: &JointFile, pairs: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    let unknown = joint.encoders.as_ref().is_some_and(|e| e.zero_unknown);
    joint.kinematic_error.as_ref().filter(|_| !unknown)?;
    let error = joint.kinematic_error_parameters();
    let n = joint.joint.gear_ratio;
    let mut all: Vec<f64> = pairs
        .map(|(theta, q)| theta / n - q - error.error(q, theta))
        .collect();
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied()
}

/// Takes whole turns out of the motor-side angle that the fitted zero does not have.
pub(super) fn whole_turns(joint: &JointFile, rows: &mut [LogRow]) -> Option<Finding> {
    let found = beyond(joint, rows.iter().map(|r| (r.theta, r.q)))?;
    let turns = joint.joint.gear_ratio * found / TAU;
    let whole = turns.round();
    if whole == 0.0
        || found.abs() < MAX_TORSION
        || (turns - whole).abs() > WHOLE
        || whole.abs() > 1000.0
    {
        return None;
    }
    rows.iter_mut().for_each(|r| r.theta -= TAU * whole);
    Some(Finding {
        defect: Defect::Stepped,
        severity: Severity::Warning,
        channel: "`theta`".to_owned(),
        row: None,
        t: rows.first()?.t,
        rows: rows.len(),
        text: format!("`theta` is {whole:.0} turns off the zero that the joint was fitted with"),
        cure: "taken off".to_owned(),
    })
}

/// A zero that is not the fitted one's, and a current that the torsion contradicts.
pub(super) fn check(s: &Signals, joint: &JointFile, problems: &mut Vec<Problem>) {
    let n = joint.joint.gear_ratio;
    if !problems.is_empty() {
        return;
    }
    if let Some(found) = beyond(joint, s.u.iter().map(|u| n * u).zip(s.q.iter().copied()))
        && found.abs() > MAX_TORSION
    {
        let reason = format!(
            "theta/N - q is {found:.4} rad off the zero that the joint was fitted with: an encoder has another zero"
        );
        let allowed = format!(
            "at most {MAX_TORSION} rad; a joint fitted without an unloaded turn takes any zero, with `--tare`"
        );
        problems.push(Problem::new(reason, allowed));
    }
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len().max(1) as f64;
    let torsion: Vec<f64> = s.u.iter().zip(&s.q).map(|(u, q)| u - q).collect();
    let (a, b) = (mean(&torsion), mean(&s.current));
    let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
        torsion
            .iter()
            .zip(&s.current)
            .map(|(x, y)| of(x - a, y - b))
            .sum()
    };
    let size = (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt();
    if sum(&|x, y| x * y) < AGAINST * size {
        let reason = "the torsion decreases as the current grows: `i`, or `theta` and `q` together, are reversed";
        problems.push(Problem::new(
            reason,
            "theta/N - q > 0 and a positive current for positive torque",
        ));
    } else {
        problems.extend(current_unit(s, joint));
    }
}

/// A current whose torque is a multiple or a part of the torque that the torsion shows.
fn current_unit(s: &Signals, joint: &JointFile) -> Option<Problem> {
    let stiffness = (joint.hysteresis.as_ref().map(|h| h.linear))
        .or(joint.compliance.as_ref().map(|c| c.k_fs0))?;
    let (n, error) = (joint.joint.gear_ratio, joint.kinematic_error_parameters());
    let torsion = s.u.iter().zip(&s.q);
    let torsion: Vec<f64> = torsion
        .map(|(u, q)| stiffness * (u - q - error.error(*q, n * u)))
        .collect();
    let per_ampere = joint.current_parameters().k_1;
    let current: Vec<f64> = s.current.iter().map(|i| per_ampere * i).collect();
    let sizes = [deviation(&torsion), deviation(&current)];
    let means = [&torsion, &current].map(|x| x.iter().sum::<f64>() / x.len().max(1) as f64);
    let product = torsion.iter().zip(&current);
    let product: f64 = product.map(|(a, b)| (a - means[0]) * (b - means[1])).sum();
    let correlation = product / torsion.len() as f64 / (sizes[0] * sizes[1]).max(1e-24);
    let ratio = sizes[1] / sizes[0].max(1e-12);
    let sound = (1.0 / MAX_RATIO..=MAX_RATIO).contains(&ratio);
    if sound || correlation.powi(2) < ALIKE || sizes[0] < LOADED * joint.joint.rated_torque {
        return None;
    }
    let unit = match ratio {
        x if (300.0..3000.0).contains(&x) => "in mA?".to_owned(),
        x if (0.3 / n..3.0 / n).contains(&x) || (0.3 * n..3.0 * n).contains(&x) => {
            "in A of the motor? another gear ratio?".to_owned()
        }
        _ => "in another unit, or of another motor?".to_owned(),
    };
    let reason = format!(
        "the torque by `i` varies by {:.4} N·m RMS, {ratio:.3} times what the torsion shows: is `i` {unit}",
        sizes[1]
    );
    Some(Problem::new(
        reason,
        "the motor's measured current, A, of the joint that was fitted",
    ))
}
