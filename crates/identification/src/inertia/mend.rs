//! Logs are inspected before anything is computed from them: wraps are taken out, rows without a
//! measurement left out, and a channel that cannot be what it claims to be is refused by its row.

use super::robot::{JointColumns, Robot, RobotLog};
use inspection::{Channel, Finding, Quantity, Severity, inspect};
use problem::{Problem, Problems};
use std::f64::consts::TAU;

/// A log after inspection.
#[derive(Debug, Clone, Default)]
pub struct Mended {
    /// The log.
    pub log: RobotLog,
    /// What was found and mended.
    pub notes: Vec<String>,
    /// Measured joints whose angle is one number in every row.
    pub constant: Vec<usize>,
}

/// Inspects and mends a log.
///
/// # Errors
/// Every channel that is not what it claims to be.
pub fn mend(robot: &Robot<'_>, log: &RobotLog) -> Result<Mended, Problems> {
    let mut out = Mended {
        log: log.clone(),
        ..Mended::default()
    };
    let mut lost = vec![false; log.t.len()];
    let mut problems = Vec::new();
    let mut take = |found: &[Finding]| {
        for finding in found {
            if finding.severity == Severity::Refused {
                problems.push(finding.problem(&log.name, |row| row + 2));
            } else {
                out.notes.push(format!("{}: {finding}", log.name));
            }
        }
    };
    for (k, &joint) in robot.measured.iter().enumerate() {
        let Some(columns) = out.log.joints[joint].as_mut() else {
            continue;
        };
        let own = &robot.model.joints()[joint];
        let motion = if own.kind.is_revolute() {
            Quantity::Angle
        } else {
            Quantity::Way
        };
        if columns.q.windows(2).all(|w| w[0] == w[1]) {
            out.constant.push(k);
        }
        let JointColumns { q, dq, tau, .. } = columns;
        for (signal, quantity, values) in [
            ("q", motion, q),
            ("dq", Quantity::Effort, dq),
            ("tau", Quantity::Effort, tau),
        ] {
            if values.is_empty() {
                continue;
            }
            let name = format!("{signal} of `{}`", own.name);
            let channel = Channel {
                name: &name,
                quantity,
                values,
            };
            let inspected = inspect(&log.t, channel);
            take(&inspected.findings);
            inspected.lost.iter().for_each(|&row| lost[row] = true);
            *values = inspected.values;
            if quantity == Quantity::Angle {
                within(values, own.limits.lower, own.limits.upper);
            }
        }
    }
    if !problems.is_empty() {
        return Err(Problems(problems));
    }
    leave_out(&mut out.log, &lost)?;
    Ok(out)
}

/// Whole turns that bring an angle between its limits, where any do.
fn within(values: &mut [f64], lower: f64, upper: f64) {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !(lower.is_finite() && upper.is_finite()) || (low >= lower && high <= upper) {
        return;
    }
    let turns = ((0.5 * (lower + upper) - 0.5 * (low + high)) / TAU).round();
    let shift = TAU * turns;
    if turns != 0.0 && low + shift >= lower && high + shift <= upper {
        values.iter_mut().for_each(|x| *x += shift);
    }
}

/// Leaves out rows without a measurement.
fn leave_out(log: &mut RobotLog, lost: &[bool]) -> Result<(), Problem> {
    let kept = |x: &mut Vec<f64>| {
        let mut row = 0..;
        x.retain(|_| row.next().is_some_and(|r| !lost[r]));
    };
    kept(&mut log.t);
    for columns in log.joints.iter_mut().flatten() {
        let JointColumns { q, dq, ddq, tau } = columns;
        [q, dq, ddq, tau]
            .into_iter()
            .filter(|x| !x.is_empty())
            .for_each(kept);
    }
    if log.t.len() < 20 {
        let reason = format!("{} rows hold measurements of every channel", log.t.len());
        return Err(Problem::new(reason, "at least 20").at(&log.name, 0));
    }
    Ok(())
}
