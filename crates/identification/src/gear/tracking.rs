//! The filter that tracks a gear's torsion, chosen by the errors of the torque with it.

use super::past::known;
use super::torsion;
use crate::record::Record;
use estimators::hysteresis::{GearParameters, HysteresisEstimator};
use estimators::joint::JointTorqueEstimator;
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::tracking::TrackingParameters;

/// Poles that are tried for fast and for slow changes of the torsion.
const FAST_POLES: [f64; 4] = [0.3, 0.5, 0.65, 0.8];
const SLOW_POLES: [f64; 4] = [0.9, 0.95, 0.98, 0.99];

/// Noise that the filter assumes over the noise found.
const NOISE_FACTORS: [f64; 3] = [1.0, 1.4, 2.0];
/// Samples of a block of [`Errors::typical`].
const BLOCK_SAMPLES: usize = 500;

/// Errors of an estimator that runs as in the loop.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Errors {
    /// Root mean square of the torque's error, N·m.
    pub rms: f64,
    /// Root mean square of the sigma reported, N·m.
    pub sigma: f64,
    /// Geometric mean of the root mean square errors of blocks, N·m: rest counts as much as
    /// sudden loads, whose errors are larger.
    pub typical: f64,
}

/// Errors on the samples of which `known` says so.
fn errors(record: &Record, estimator: &mut impl JointTorqueEstimator, known: &[bool]) -> Errors {
    let (mut square, mut sigma, mut count) = (0.0, 0.0, 0.0);
    let (mut logarithm, mut blocks) = (0.0, 0.0);
    for (k, samples) in record.samples.chunks(BLOCK_SAMPLES).enumerate() {
        let (mut block, mut used) = (0.0, 0.0);
        for (i, sample) in samples.iter().enumerate() {
            let i = k * BLOCK_SAMPLES + i;
            if record.log_begins().binary_search(&i).is_ok() {
                estimator.reset();
            }
            let estimate = estimator.update(sample);
            if record.usable(i) && known[i] {
                block += (estimate.tau - record.tau[i]).powi(2);
                sigma += estimate.sigma * estimate.sigma;
                used += 1.0;
            }
        }
        square += block;
        count += used;
        if used > 0.0 {
            logarithm += 0.5 * f64::max(block / used, 1e-18).ln();
            blocks += 1.0;
        }
    }
    let mean = |sum: f64| (sum / f64::max(count, 1.0)).sqrt();
    Errors {
        rms: mean(square),
        sigma: mean(sigma),
        typical: (logarithm / f64::max(blocks, 1.0)).exp(),
    }
}

/// The filter that tracks the torsion, long enough against noise and short enough against fast
/// loads, and the errors of the torque with it where the gear's past no longer counts.
#[must_use]
pub fn tracking(
    record: &Record,
    error: &KinematicErrorParameters,
    gear: &GearParameters,
    estimator: impl Fn(TrackingParameters) -> HysteresisEstimator,
) -> (TrackingParameters, Errors) {
    let sigma = record.noise(&torsion(record, error));
    let known = known(record, error, gear);
    let attempt = |poles, sigma| {
        let parameters = TrackingParameters { poles, sigma };
        (
            parameters,
            errors(record, &mut estimator(parameters), &known),
        )
    };
    let poles = FAST_POLES
        .iter()
        .flat_map(|&a| SLOW_POLES.map(|b| [a, 1.0 - f64::sqrt((1.0 - a) * (1.0 - b)), b]));
    let best_of = |tried: &mut dyn Iterator<Item = (TrackingParameters, Errors)>| {
        let best = tried.min_by(|a, b| a.1.typical.total_cmp(&b.1.typical));
        best.unwrap_or_default()
    };
    let [least, usual, most] = NOISE_FACTORS;
    let best = best_of(&mut poles.map(|p| attempt(p, usual * sigma)));
    let others = [least, most].map(|factor| attempt(best.0.poles, factor * sigma));
    best_of(&mut [best].into_iter().chain(others))
}
