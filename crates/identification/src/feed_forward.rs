//! The feed-forward as a source: what of the torque it explains, and how the other sources differ from it
//! where nothing touches the robot.

use crate::blocks::{Blocks, Prior, directions};
use crate::record::{Record, ReferenceErrors};
use estimators::feed_forward::UNCERTAIN;
use estimators::joint::JointTorqueEstimator;
use estimators::set::EstimatorSet;
use joint_file::FeedForwardTable;
use problem::Problem;

/// Samples used at most.
const MAX_SAMPLES: usize = 60_000;
/// Widths of the priors: gain about 1, offset and friction of the rated torque (per rad/s). A payload that the
/// model lacks makes a gain, a friction that it has makes the others.
const GAIN: f64 = 0.2;
const OFFSET: f64 = 0.1;
const FRICTION: f64 = 0.1;
/// Independent samples for which the variance of the fused torque stands in that of the change, and its share:
/// in motion, or at rest, that the log does not show.
const PRIOR_SAMPLES: f64 = 2.0;
const PRIOR_SHARE: f64 = 0.25;
/// Time over which changes are alike, s.
const ALIKE_S: f64 = 0.25;

/// Fits `tau = gain ff + offset - viscous dq - coulomb sign(dq)`.
///
/// # Errors
/// A log without feed-forward, or one that does not go with the torque.
pub fn fit(
    record: &Record,
    rated_torque: f64,
    sign_smoothing: f64,
    reference: ReferenceErrors,
) -> Result<FeedForwardTable, Problem> {
    let missing = || {
        Problem::new(
            "training log: column `tau_feedforward` is missing",
            "the torque that a controller or a rigid-body model expects, in every row",
        )
    };
    let model: Option<Vec<f64>> = (record.samples.iter())
        .map(|sample| sample.feed_forward.filter(|tau| tau.is_finite()))
        .collect();
    let model = record.smooth(&model.ok_or_else(missing)?, 0);
    let tau = record.smooth(&record.tau, 0);
    let spacing = tau.len().div_ceil(MAX_SAMPLES).max(1) as f64;
    let seconds = tau.len() as f64 * record.sample_period;
    let alike = Blocks::alike(record.sample_period) / spacing;
    let mut blocks = Blocks::new(UNCERTAIN, Blocks::count(seconds), alike);
    for i in record.spread(MAX_SAMPLES).filter(|&i| tau[i].is_finite()) {
        let dq = record.motion[i][0];
        let row = [model[i], 1.0, -dq, -(dq / sign_smoothing).tanh()];
        blocks.add(i as f64 / tau.len() as f64, &row, tau[i]);
    }
    let friction = Prior::new(0.0, FRICTION * rated_torque);
    let priors = [
        Prior::new(1.0, GAIN),
        Prior::new(0.0, OFFSET * rated_torque),
        friction,
        friction,
    ];
    let posterior = blocks.fit(&priors).ok_or_else(missing)?;
    let x = &posterior.x;
    let mut covariance = posterior.covariance.clone();
    if x[0] + 2.0 * covariance[(0, 0)].sqrt() < 0.0 {
        let reason = "training log: the torque falls where `tau_feedforward` grows";
        return Err(Problem::new(reason, "a feed-forward of the torque's sign"));
    }
    covariance[(0, 0)] += (reference.gain * x[0]).powi(2);
    covariance[(1, 1)] += reference.offset.powi(2);
    Ok(FeedForwardTable {
        gain: x[0],
        offset: x[1],
        viscous: x[2],
        coulomb: x[3],
        sign_smoothing,
        sigma: posterior.held_out,
        change_sigma: [UNBOUNDED; 2],
        uncertainty: directions(&covariance, UNCERTAIN),
    })
}

/// A change that nothing exceeds: every difference to the feed-forward is followed, N·m.
pub const UNBOUNDED: f64 = 1e9;

/// Standard deviations, at rest and in motion, of how the fused torque changes against the feed-forward;
/// the set must follow without bounds. `ratio`: error on held-out blocks over that on the fitted ones.
#[must_use]
pub fn change_sigma(record: &Record, set: &mut EstimatorSet, ratio: f64) -> [f64; 2] {
    let mut sums = [(0.0, 0.0); 2];
    let (mut variance, mut all) = (0.0, 0.0);
    set.reset();
    for (i, sample) in record.samples.iter().enumerate() {
        let fused = set.update(sample);
        let Some((change, active)) = set.change().filter(|_| record.usable(i)) else {
            continue;
        };
        let sum = &mut sums[usize::from(active > 0.5)];
        sum.0 += change * change;
        sum.1 += 1.0;
        variance += fused.sigma * fused.sigma;
        all += 1.0;
    }
    let usual = PRIOR_SHARE * variance / f64::max(all, 1.0);
    let alike = (ALIKE_S / record.sample_period).max(1.0);
    sums.map(|(square, count)| {
        let mean = ratio * ratio * square / f64::max(count, 1.0);
        let worth = count / alike;
        ((worth * mean + PRIOR_SAMPLES * usual) / (worth + PRIOR_SAMPLES)).sqrt()
    })
}
