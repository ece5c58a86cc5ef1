//! Noise of process and measurement of the Kalman filters, by the likelihood of the innovations (U).

use crate::record::Record;
use estimators::joint::JointTorqueEstimator;
use estimators::kalman::{ADDED_STATES, KalmanEstimator, KalmanParameters, Transform};

/// Windows over the whole log that each evaluation runs over, the samples of each, and those of
/// them that the filter settles in.
const WINDOWS: usize = 10;
const SAMPLES: usize = 1_000;
const SETTLING: usize = 300;
/// Factors by which a variance is moved, from coarse to fine.
const FACTORS: [f64; 2] = [10.0, 2.5];

/// Mean logarithm of the likelihood of the innovations, up to a constant.
fn likelihood<const N: usize>(record: &Record, p: &KalmanParameters, transform: Transform) -> f64 {
    let mut filter = KalmanEstimator::<N>::new(p.clone(), transform);
    let (mut sum, mut count) = (0.0, 0.0);
    let between = record.samples.len().saturating_sub(SAMPLES) / (WINDOWS - 1);
    for window in 0..WINDOWS {
        filter.reset();
        let samples = record.samples.iter().skip(window * between).take(SAMPLES);
        for (i, sample) in samples.enumerate() {
            filter.update(sample);
            if i >= SETTLING {
                sum += filter.log_likelihood();
                count += 1.0;
            }
        }
    }
    if count > 0.0 {
        sum / count
    } else {
        f64::NEG_INFINITY
    }
}

/// Moves the variances one at a time as long as the innovations become more likely.
///
/// Coordinate search on logarithms: five or seven variances, no gradient, no more than some
/// hundred runs over the log.
#[must_use]
pub fn fit<const N: usize>(
    record: &Record,
    start: &KalmanParameters,
    transform: Transform,
) -> KalmanParameters {
    let mut best = start.clone();
    let mut best_value = likelihood::<N>(record, &best, transform);
    let added = [ADDED_STATES, ADDED_STATES + 1];
    for factor in FACTORS {
        for _ in 0..2 {
            let before = best_value;
            for which in (0..N).chain(added) {
                for factor in [factor, 1.0 / factor] {
                    loop {
                        let mut moved = best.clone();
                        match which.checked_sub(ADDED_STATES) {
                            None => moved.process[which] *= factor,
                            Some(i) => moved.measurement[i] *= factor,
                        }
                        let value = likelihood::<N>(record, &moved, transform);
                        if value.is_nan() || value <= best_value + 1e-6 {
                            break;
                        }
                        (best, best_value) = (moved, value);
                    }
                }
            }
            if best_value - before < 1e-3 {
                break;
            }
        }
    }
    best
}
