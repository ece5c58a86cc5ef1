//! Variance of the sources' errors, regime by regime.

use crate::record::Record;
use estimators::fusion::{BOUNDS, FusedSource, Fusion, FusionParameters, REGIMES, SourceError};
use estimators::joint::JointTorqueEstimator;
use estimators::set::EstimatorSet;
use robot_state::torque_flags;

/// Time over which variances blend, s.
const BLEND_S: f64 = 0.03;
/// Time over which errors of a source are alike: so long are the samples that count as one, s.
const ALIKE_S: f64 = 0.25;
/// Weight of the mean over all regimes in each regime's variance, independent samples.
const PRIOR_SAMPLES: f64 = 2.0;
/// Usual error of a source, and the number of independent samples that it counts as.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Usual {
    /// Error, of the rated torque.
    pub error: f64,
    /// Samples.
    pub samples: f64,
    /// Whether they count in each regime, or once in all.
    pub each_regime: bool,
}

impl Usual {
    /// From the torsion, after an unloaded turn.
    pub const TURNED: Self = Self {
        error: 0.01,
        samples: 1.0,
        each_regime: false,
    };
    /// From the torsion, without one: harmonics and zero are known from the loaded log alone. Found on
    /// a real arm, 2026-11.
    pub const NOT_TURNED: Self = Self {
        error: 0.04,
        samples: 5.0,
        each_regime: true,
    };
    /// From the torsion, by recordings of the robot itself, whose encoders are absolute: between the two, as the
    /// zero is for good, and higher harmonics are a part of the fit.
    pub const OWN_RECORDINGS: Self = Self {
        error: 0.02,
        samples: 1.0,
        each_regime: false,
    };
    /// From the feed-forward: other payloads, other parts of the pose.
    pub const FEED_FORWARD: Self = Self {
        error: 0.04,
        samples: 5.0,
        each_regime: true,
    };
    /// From the current.
    pub const CURRENT: Self = Self {
        error: 0.05,
        samples: 1.0,
        each_regime: true,
    };
    /// From the current, after an unloaded turn: a training whose regimes are alike. Family of joints, 2026-11.
    pub const CURRENT_TURNED: Self = Self {
        each_regime: false,
        ..Self::CURRENT
    };
}

/// Errors of the sources by the fits, beside the log.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SourceKnowledge {
    /// Whether the source takes part in the fused torque.
    pub fused: bool,
    /// Usual error.
    pub usual: Usual,
    /// Part of its sigma that does not come from its parameters, N·m; none if it does not report
    /// their part.
    pub own_sigma: Option<f64>,
    /// The source that reports the part of its parameters, by index.
    pub parameters_of: Option<usize>,
    /// Error on held-out blocks over that on the fitted ones.
    pub held_out_ratio: f64,
}

/// Least share of the variance seen that counts as the source's own, not the sensor's.
const MIN_OWN_SHARE: f64 = 0.02;

/// Runs all sources over a log with a torque sensor and gathers the errors of each.
///
/// The sources run causally, as in the loop, so that their delays count as errors here too. Samples count of
/// which `used` says so.
#[must_use]
pub fn fit(
    record: &Record,
    set: &mut EstimatorSet,
    used: &[bool],
    known: &[SourceKnowledge],
    [rated_torque, torque_limit]: [f64; 2],
) -> FusionParameters {
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
        sources: (set.roles().iter().enumerate())
            .map(|(i, role)| FusedSource {
                role: *role,
                fused: known.get(i).is_some_and(|k| k.fused),
                ..FusedSource::default()
            })
            .collect(),
        blend: BLEND_S,
        gear_ratio: record.gear_ratio,
        sample_period: record.sample_period,
        torque_limit,
        rated_torque,
        rest_factor: 1.0,
        zero_unknown: false,
        correction: None,
    };
    let mut regimes = Fusion::new(parameters.clone());
    let mut counts = [0.0; REGIMES];
    // Sums of squares first: of the error, of the sigma reported.
    let mut sums = vec![[(0.0, 0.0); REGIMES]; n];
    set.reset();
    for (i, sample) in record.samples.iter().enumerate() {
        if record.log_begins().binary_search(&i).is_ok() {
            set.reset();
        }
        set.update(sample);
        let regime = regimes.regime(sample);
        let valid = |e: &robot_state::TorqueEstimate| e.flags & torque_flags::VALID != 0;
        let all_valid = set.estimates().iter().all(valid);
        if !(record.usable(i) && used[i] && all_valid && record.tau[i].is_finite()) {
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
    let alike = (ALIKE_S / record.sample_period).max(1.0);
    for (source, (sums, known)) in sums.iter().zip(known).enumerate() {
        let usual = (known.usual.error * rated_torque).powi(2);
        let [worth, of_all] = if known.usual.each_regime {
            [known.usual.samples, 0.0]
        } else {
            [0.0, known.usual.samples]
        };
        let total = sums.iter().fold((0.0, 0.0), |t, s| (t.0 + s.0, t.1 + s.1));
        let seen_in_all = (total.0 / alike + of_all * usual) / (all / alike + of_all);
        let total = (seen_in_all, total.1 / all);
        for (regime, sum) in sums.iter().enumerate() {
            // A regime that was hardly seen leans on the mean over all, and all on what is usual.
            let count = counts[regime] / alike;
            let here = |sum: f64, total: f64| {
                count * sum / counts[regime].max(1.0) + PRIOR_SAMPLES * total
            };
            let seen = (here(sum.0, total.0) + worth * usual) / (count + PRIOR_SAMPLES + worth);
            let reported = here(sum.1, total.1) / (count + PRIOR_SAMPLES);
            let left = (seen - sensor_noise * sensor_noise).max(MIN_OWN_SHARE * seen);
            parameters.sources[source].errors[regime] = SourceError {
                variance: left,
                reported: reported.sqrt(),
            };
        }
    }
    for regime in 0..REGIMES {
        let its = parameters.sources.iter_mut().map(|s| &mut s.errors[regime]);
        on_others(its.collect(), known);
    }
    parameters
}

/// From the errors on the samples that were fitted to those on others: parameters that fit the former are further
/// off on the latter, by their covariance, or by how much larger the error on held-out blocks is. Both are
/// estimates of the same error, so that the larger one counts.
fn on_others(errors: Vec<&mut SourceError>, known: &[SourceKnowledge]) {
    let part = |error: &SourceError, known: &SourceKnowledge| {
        let own = known.own_sigma.unwrap_or(error.reported);
        (error.reported * error.reported - own * own).max(0.0)
    };
    let parts: Vec<f64> = (errors.iter().zip(known))
        .map(|(error, known)| part(error, known))
        .collect();
    for (error, known) in errors.into_iter().zip(known) {
        let part = known.parameters_of.and_then(|i| parts.get(i));
        let held_out = known.held_out_ratio.max(1.0).powi(2) * error.variance;
        error.variance = held_out.max(error.variance + part.copied().unwrap_or(0.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_or_held_out_blocks_enlarge_the_error_of_every_source_of_the_gear() {
        let error = |variance, reported| SourceError { variance, reported };
        let source = |own_sigma, parameters_of, held_out_ratio| SourceKnowledge {
            own_sigma,
            parameters_of,
            held_out_ratio,
            ..SourceKnowledge::default()
        };
        // The gear reports 5, of which 3 are its own and 4 its parameters'; the filter has the same gear.
        let known = |ratio| {
            [
                source(Some(3.0), Some(0), ratio),
                source(None, Some(0), ratio),
                source(None, None, 0.0),
            ]
        };
        let sources = || [error(9.0, 5.0), error(4.0, 1.0), error(1.0, 1.0)];
        let of = |ratio| {
            let mut errors = sources();
            on_others(errors.iter_mut().collect(), &known(ratio));
            errors.map(|error| error.variance)
        };
        assert_eq!(of(1.0), [25.0, 20.0, 1.0]);
        assert_eq!(of(2.0), [36.0, 20.0, 1.0]);
    }
}
