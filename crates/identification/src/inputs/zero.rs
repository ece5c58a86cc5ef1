//! Zeros of a fitted joint in a log that torques are estimated over: a motor-side encoder that knows its
//! angle within a turn only comes back some turns off.

use super::signals::Signals;
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
    }
}
