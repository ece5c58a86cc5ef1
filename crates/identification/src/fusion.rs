//! Covariance of the sources' errors, regime by regime.

use crate::record::Record;
use estimators::fusion::{Fusion, FusionParameters, REGIMES};
use estimators::joint::JointTorqueEstimator;
use estimators::set::EstimatorSet;
use robot_state::torque_flags;

/// Time over which weights blend, s.
const BLEND_S: f64 = 0.03;
/// Samples below which a regime's own covariance is not believed.
const FEW: f64 = 500.0;

/// Runs all sources over a log with a torque sensor and gathers what their errors have in common.
///
/// The sources run causally, as in the loop, so that what lags counts as an error here too.
#[must_use]
pub fn fit(record: &Record, set: &mut EstimatorSet, torque_limit: f64) -> FusionParameters {
    let n = set.names().len();
    let fastest = record.motion.iter().fold(0.0f64, |m, v| m.max(v[0].abs()));
    let torsion = record.torsion();
    let rate = record.smooth(&torsion, 1);
    let steepest = rate.iter().fold(0.0f64, |m, r| m.max(r.abs()));
    let mut parameters = FusionParameters {
        moving: (0.02 * fastest).max(1e-4),
        loading: 0.1 * steepest,
        covariance: std::array::from_fn(|_| vec![0.0; n * n]),
        blend: BLEND_S,
        gear_ratio: record.gear_ratio,
        sample_period: record.sample_period,
        torque_limit,
    };
    let mut regimes = Fusion::new(n, parameters.clone());
    let mut counts = [0.0; REGIMES];
    set.reset();
    for (i, sample) in record.samples.iter().enumerate() {
        set.update(sample);
        let regime = regimes.regime(sample);
        let valid = set
            .estimates()
            .iter()
            .all(|e| e.flags & torque_flags::VALID != 0);
        if !(record.usable(i) && valid && record.tau[i].is_finite()) {
            continue;
        }
        counts[regime] += 1.0;
        let covariance = &mut parameters.covariance[regime];
        for (a, first) in set.estimates().iter().enumerate() {
            for (b, second) in set.estimates().iter().enumerate() {
                let product = (first.tau - record.tau[i]) * (second.tau - record.tau[i]);
                covariance[a * n + b] += product;
            }
        }
    }
    let all: f64 = counts.iter().sum();
    let mean: Vec<f64> = (0..n * n)
        .map(|k| parameters.covariance.iter().map(|c| c[k]).sum::<f64>() / all.max(1.0))
        .collect();
    for (covariance, count) in parameters.covariance.iter_mut().zip(counts) {
        // A regime that was hardly seen leans on the mean over all.
        let own = count / (count + FEW);
        for (c, mean) in covariance.iter_mut().zip(&mean) {
            *c = own * *c / count.max(1.0) + (1.0 - own) * mean;
        }
    }
    parameters
}
