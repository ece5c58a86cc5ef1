//! Several logs of one joint as one, each with a zero of its own.
//!
//! An encoder that is switched off may come back with another zero, and a motor-side encoder that
//! knows its angle within a turn only comes back some turns off. What the zeros are follows from
//! the logs themselves: a linear probe of the torsion holds one constant for each log, and compliance,
//! skew and harmonics in common. The motor side of every later log is then shifted to the zero of the
//! first: by whole turns where the shift is one, so that errors that repeat with the motor's angle
//! keep their phase.

use crate::blocks::{Blocks, Prior};
use crate::excitation::{CATALOGUE_STIFFNESS, SKEW_WIDTH_S};
use crate::log::LogRow;
use crate::record::{PAUSE_S, Record};
use estimators::hysteresis::harmonics;
use joint_file::JointFile;
use problem::Problem;
use std::f64::consts::TAU;

/// Standard deviations of a shift from whole turns of the motor, none included, within which it is taken for
/// them.
const WHOLE_TURN: f64 = 2.0;
/// Widths of the probe's priors: compliance over that of catalogues, harmonics of q and theta and the zeros, rad.
const COMPLIANCE: f64 = 0.5;
const LINK: f64 = 2e-4;
const MOTOR: f64 = 5e-5;
const ZERO: f64 = 10.0;
/// Samples of each log, at most.
const MAX_SAMPLES: usize = 5_000;

/// Whether logs have zeros of their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Zeros {
    /// Each its own: they are looked for, and shifted to the first one's.
    OfEachLog,
    /// The same in all, by absolute encoders: they are looked for, and left as they are.
    Common,
}

/// A shift, rad, and its standard deviation.
pub type Shift = (f64, f64);

/// The logs one after another, and the shift of each motor side that they show, rad, with its standard
/// deviation.
///
/// # Errors
/// A joint file from which no front end can be built; a log without a torque.
pub fn joined(
    joint: &JointFile,
    logs: Vec<Vec<LogRow>>,
    of_zeros: Zeros,
) -> Result<(Vec<LogRow>, Vec<Shift>), Problem> {
    let n = joint.joint.gear_ratio;
    let zeros = match logs.len() {
        0 | 1 => vec![(0.0, 0.0); logs.len()],
        _ => zeros(joint, &logs)?,
    };
    let (mut rows, mut shifts): (Vec<LogRow>, Vec<Shift>) = (Vec::new(), Vec::new());
    for (log, (zero, sigma)) in logs.into_iter().zip(zeros) {
        let mut shift = -n * zero;
        let turns = TAU * (shift / TAU).round();
        if (shift - turns).abs() <= WHOLE_TURN * n * sigma {
            shift = turns;
        }
        shifts.push((shift, n * sigma));
        if of_zeros == Zeros::Common {
            shift = 0.0;
        }
        let begin = log.first().map_or(0.0, |row| row.t);
        // Long enough for filters to start anew.
        let start = rows.last().map_or(begin, |last| last.t + 2.0 * PAUSE_S);
        rows.extend(log.into_iter().map(|row| LogRow {
            t: start + (row.t - begin),
            theta: row.theta + shift,
            ..row
        }));
    }
    Ok((rows, shifts))
}

/// Torsion of each log without load beyond the first one's, and its standard deviation, rad.
fn zeros(joint: &JointFile, logs: &[Vec<LogRow>]) -> Result<Vec<(f64, f64)>, Problem> {
    let stiffness =
        (joint.joint.stiffness).unwrap_or(CATALOGUE_STIFFNESS * joint.joint.rated_torque);
    let compliance = 1.0 / stiffness;
    let mut priors = vec![
        Prior::at_least(compliance, COMPLIANCE * compliance, 0.0),
        Prior::new(0.0, SKEW_WIDTH_S),
    ];
    let waves = harmonics(0.0, 0.0).len();
    priors.extend((0..waves).map(|k| Prior::new(0.0, if k < 4 { LINK } else { MOTOR })));
    let common = priors.len();
    priors.extend(logs.iter().map(|_| Prior::new(0.0, ZERO)));
    let spacing = |record: &Record| record.samples.len().div_ceil(MAX_SAMPLES).max(1) as f64;
    let mut blocks = Blocks::new(priors.len(), 2 * logs.len(), 1.0);
    let error = joint.kinematic_error_parameters();
    for (k, rows) in logs.iter().enumerate() {
        let record = Record::new(joint, rows)?;
        let (torsion, tau) = (record.torsion(), record.smooth(&record.tau, 0));
        let torsion = record.smooth(&torsion, 0);
        // Of every stretch of rows that are alike one counts.
        let alike = (Blocks::alike(record.sample_period) / spacing(&record)).max(1.0);
        let weight = alike.sqrt().recip();
        for i in record.spread(MAX_SAMPLES) {
            let sample = &record.samples[i];
            let mut row = vec![tau[i], record.motion[i][0]];
            row.extend(harmonics(error.w_link * sample.q, sample.theta));
            row.resize(common + logs.len(), 0.0);
            row[common + k] = 1.0;
            row.iter_mut().for_each(|x| *x *= weight);
            let place = (k as f64 + i as f64 / record.samples.len() as f64) / logs.len() as f64;
            let known = error.error(sample.q, sample.theta);
            blocks.add(place, &row, weight * (torsion[i] - known));
        }
    }
    let posterior = blocks.fit(&priors).ok_or_else(|| {
        Problem::new(
            "training logs: no zero can be found",
            "logs with rows that can be used",
        )
    })?;
    let p = &posterior.covariance;
    let beyond = |i: usize| {
        let variance = p[(i, i)] + p[(common, common)] - 2.0 * p[(common, i)];
        let zero = posterior.x[i] - posterior.x[common];
        (zero, variance.max(0.0).sqrt())
    };
    Ok((common..priors.len()).map(beyond).collect())
}
