//! References that are computed from what they shall judge: from the encoders, or from the current less a
//! friction.
//!
//! What tells a copy is noise. Sensor, encoders and current of a real joint have noises of their own: whatever
//! explains the torque by the encoders leaves the encoders' noise. A copy leaves less, as it holds that noise.

use super::LogKind;
use super::probes::Probes;
use super::signals::{Signals, deviation};
use crate::least_squares::Batch;
use inspection::{Defect, Finding, Severity};
use joint_file::JointFile;

/// Residual, as a share of the deviation, above which a reference is no function of torsion, of current. A joint's
/// torque follows its current, the noise of its control included, but for friction.
const MOST: [f64; 2] = [0.25, 0.04];
/// Residual over that of a function of angles or speeds alone, below which a reference is a function of torsion or
/// current itself: torque sensors err by some thousandths, a gear's hysteresis and friction by more.
const EXACT: f64 = 0.005;
/// Noise of the residual over that of the function.
const WITHOUT_NOISE: f64 = 0.5;
/// Correlation of a noise's neighbouring second differences, at most: that of white noise is -2/3.
const NOISY: f64 = -0.35;
/// That correlation of an encoder's steps, at most; a motion without noise has nearly 1.
const ROUGH: f64 = 0.5;
/// Rows at both ends that taps reach beyond.
const MARGIN: usize = 8;
/// Rows that are looked at, at most.
const MAX_ROWS: usize = 6_000;
/// Taps and low-passes, rows, whose sums make any usual filter.
const TAPS: [i64; 7] = [0, -1, 1, -3, 3, -8, 8];
const LOW_PASSES: [f64; 6] = [1.0, 2.5, 6.0, 14.0, 32.0, 75.0];
/// Multiple of a noise's median size beyond which a second difference is a step, and counts as so much.
const STEP: f64 = 3.0;

pub(super) fn found(
    s: &Signals,
    probes: &Probes,
    joint: &JointFile,
    kind: LogKind,
) -> Vec<Finding> {
    let torsion: Vec<f64> = s.u.iter().zip(&s.q).map(|(u, q)| u - q).collect();
    let dq = probes.signals()[6];
    let speed = s.dq.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let slip = |k: usize| (dq[k] / (0.02 * speed).max(1e-6)).tanh();
    let n = joint.joint.gear_ratio;
    let waves = |k: usize| {
        let mut row = Vec::new();
        for angle in [s.q[k], 2.0 * s.q[k], n * s.u[k], 2.0 * n * s.u[k]] {
            let (sin, cos) = angle.sin_cos();
            row.extend([sin, cos]);
        }
        row
    };
    let friction = |k: usize| vec![slip(k), dq[k], (dq[k] / 0.02).tanh(), (dq[k] / 0.1).tanh()];
    let mut out = Vec::new();
    let [tau_name, i_name] = ["tau_sensor", "i"].map(|c| kind.name(c));
    let [by_encoders, by_current] = MOST;
    for (from, channel, what, most) in [
        (&torsion, "the encoders", "torsion", by_encoders),
        (&s.current, "the current", i_name, by_current),
    ] {
        let extra: &dyn Fn(usize) -> Vec<f64> = if what == "torsion" { &waves } else { &friction };
        let Some(explained) = explained(from, &s.tau, extra) else {
            continue;
        };
        let Explained { rest, own, noise } = explained;
        // The coarse steps of an encoder are no noise, but no motion either.
        let alike = alike(&second(from));
        let is_smooth = alike < NOISY || (alike < ROUGH && rest < EXACT * own);
        if rest < most && noise < WITHOUT_NOISE && is_smooth {
            out.push(Finding {
                defect: Defect::Computed,
                severity: Severity::Refused,
                channel: tau_name.to_owned(),
                row: None,
                t: s.t[0],
                rows: s.t.len(),
                text: format!(
                    "{tau_name} is computed from {channel}: a function of {what} leaves {:.2} % of it, \
                     and {:.0} % of the noise of {what}",
                    100.0 * rest,
                    100.0 * noise
                ),
                cure: kind.references().to_owned(),
            });
            break;
        }
    }
    out
}

/// How far a column is a function of another one.
struct Explained {
    /// Residual over the deviation.
    rest: f64,
    /// Residual of the further terms alone, over the deviation.
    own: f64,
    /// Second differences of the residual over those of the function, RMS.
    noise: f64,
}

/// A column as a sum of another one, filtered, and further terms.
fn explained(from: &[f64], of: &[f64], extra: &dyn Fn(usize) -> Vec<f64>) -> Option<Explained> {
    let low_passes = LOW_PASSES.map(|rows| super::reference::low_pass(from, rows));
    let row = |k: usize| -> Vec<f64> {
        let at = |shift: i64| from[(k as i64 + shift) as usize] - from[0];
        let filtered = low_passes.iter().map(|x| x[k] - from[0]);
        let own = TAPS.iter().map(|s| at(*s)).chain(filtered);
        own.chain([1.0]).chain(extra(k)).collect()
    };
    let rows = MARGIN..of.len().saturating_sub(MARGIN);
    let step = of.len().div_ceil(MAX_ROWS).max(1);
    let mut batch = Batch::new(row(rows.start).len());
    for k in rows.clone().step_by(step) {
        batch.add(&row(k), of[k]);
    }
    let fit = batch.solve(1e-12)?;
    let without = batch.solve_columns(1e-12, |i| i >= TAPS.len() + LOW_PASSES.len())?;
    let function: Vec<f64> = rows
        .clone()
        .take(MAX_ROWS)
        .map(|k| row(k).iter().zip(fit.x.iter()).map(|(a, x)| a * x).sum())
        .collect();
    let residual: Vec<f64> = rows.zip(&function).map(|(k, y)| of[k] - y).collect();
    let size = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    let share = |rms: f64| rms / deviation(of).max(f64::MIN_POSITIVE);
    Some(Explained {
        rest: share(fit.rms),
        own: share(without.rms),
        noise: size(&second(&residual)) / size(&second(&function)).max(f64::MIN_POSITIVE),
    })
}

/// Second differences, without the steps of sudden loads.
fn second(x: &[f64]) -> Vec<f64> {
    let all: Vec<f64> = x.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).collect();
    let mut sizes: Vec<f64> = all.iter().map(|x| x.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let most = STEP * sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
    all.into_iter().map(|x| x.clamp(-most, most)).collect()
}

/// Correlation of neighbouring second differences: those of noise are opposite, those of a motion alike.
fn alike(second: &[f64]) -> f64 {
    let dot = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
    dot(second, second.get(1..).unwrap_or_default()) / dot(second, second).max(f64::MIN_POSITIVE)
}
