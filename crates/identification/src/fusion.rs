//! Variance of the sources' errors, regime by regime.

use crate::record::Record;
use estimators::fusion::{BOUNDS, Fusion, FusionParameters, REGIMES, SourceError};
use estimators::joint::JointTorqueEstimator;
use estimators::set::EstimatorSet;
use robot_state::torque_flags;

/// Time over which variances blend, s.
const BLEND_S: f64 = 0.03;
/// Weight of the mean over all regimes in each regime's variance, samples.
const PRIOR_SAMPLES: f64 = 500.0;

/// Least share of the variance seen that counts as the source's own, not the sensor's.
const MIN_OWN_SHARE: f64 = 0.02;

/// Runs all sources over a log with a torque sensor and gathers the errors of each.
///
/// The sources run causally, as in the loop, so that their delays count as errors here too.
#[must_use]
pub fn fit(record: &Record, set: &mut EstimatorSet, torque_limit: f64) -> FusionParameters {
    let n = set.names().len();
    let fastest = record.motion.iter().fold(0.0f64, |m, v| m.max(v[0].abs()));
    let torsion = record.torsion();
    let mut rates: Vec<f64> = record.smooth(&torsion, 1).iter().map(|r| r.abs()).collect();
    rates.sort_by(f64::total_cmp);
    // Half of the log is slower than the first bound; the others lie evenly, by ratio, between it
    // and the steepest.
    let [slow, steepest] = [rates.len() / 2, rates.len().saturating_sub(1)]
        .map(|i| rates.get(i).copied().unwrap_or(0.0).max(1e-9));
    let bound = |k: usize| slow * (steepest / slow).powf(k as f64 / BOUNDS as f64);
    let mut parameters = FusionParameters {
        moving: (0.02 * fastest).max(1e-4),
        loading: std::array::from_fn(bound),
        errors: std::array::from_fn(|_| vec![SourceError::default(); n]),
        blend: BLEND_S,
        gear_ratio: record.gear_ratio,
        sample_period: record.sample_period,
        torque_limit,
    };
    let mut regimes = Fusion::new(n, parameters.clone());
    let mut counts = [0.0; REGIMES];
    // Sums of squares first: of the error, of the sigma reported.
    let mut sums = vec![[(0.0, 0.0); REGIMES]; n];
    set.reset();
    for (i, sample) in record.samples.iter().enumerate() {
        set.update(sample);
        let regime = regimes.regime(sample);
        let valid = |e: &robot_state::TorqueEstimate| e.flags & torque_flags::VALID != 0;
        let all_valid = set.estimates().iter().all(valid);
        if !(record.usable(i) && all_valid && record.tau[i].is_finite()) {
            continue;
        }
        counts[regime] += 1.0;
        for (sum, e) in sums.iter_mut().zip(set.estimates()) {
            sum[regime].0 += (e.tau - record.tau[i]).powi(2);
            sum[regime].1 += e.sigma * e.sigma;
        }
    }
    // The sensor's noise is no error of any source, but would make all of them look alike.
    let sensor_noise = record.noise(&record.tau);
    let all: f64 = counts.iter().sum::<f64>().max(1.0);
    for (source, sums) in sums.iter().enumerate() {
        let total = sums.iter().fold((0.0, 0.0), |t, s| (t.0 + s.0, t.1 + s.1));
        for (regime, sum) in sums.iter().enumerate() {
            // A regime that was hardly seen leans on the mean over all.
            let count = counts[regime];
            let own = count / (count + PRIOR_SAMPLES);
            let mean =
                |sum: f64, total: f64| own * sum / count.max(1.0) + (1.0 - own) * total / all;
            let seen = mean(sum.0, total.0);
            parameters.errors[regime][source] = SourceError {
                variance: (seen - sensor_noise * sensor_noise).max(MIN_OWN_SHARE * seen),
                reported: mean(sum.1, total.1).sqrt(),
            };
        }
    }
    parameters
}
