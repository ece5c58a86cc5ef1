//! g: torque per torque of torsion, for fast changes.
//!
//! Inside a hysteresis loop a gear is stiffer than its curve, and estimators from torsion show changes
//! by a factor that is a property of the joint. The loop learns it (`g e + b`, `whole-body`), but only once
//! the torque changes, and a first step before that overshoots by what `g` is wrong. So the joint file
//! stores it: a regression of the reference's changes on those of the fused torque, both through the same band
//! of some hertz, with the interval of a jackknife over blocks.

use crate::blocks::{Blocks, Prior};
use crate::record::{Record, smooth};
use estimators::joint::JointTorqueEstimator;
use estimators::set::EstimatorSet;
use joint_file::TorsionGainTable;
use robot_state::torque_flags;

/// Half of the windows whose difference is the band, s: slower than the reference's own filters, faster than
/// the drift of both.
const BAND_S: [f64; 2] = [0.06, 0.3];
/// Standard deviation of g before any data: hysteresis of harmonic drives makes up to a third.
const PRIOR: f64 = 0.2;
/// Standard deviation, of the prior's, above which the data do not determine g.
const DETERMINED: f64 = 0.5;
/// g that a gear can have.
const POSSIBLE: core::ops::RangeInclusive<f64> = 0.5..=2.0;
/// Samples used at most.
const MAX_SAMPLES: usize = 60_000;

/// g of the set's fused torque, and its standard deviation; none where the record does not determine it.
#[must_use]
pub fn fit(record: &Record, set: &mut EstimatorSet) -> Option<TorsionGainTable> {
    set.reset();
    let estimates = record.samples.iter().map(|sample| set.update(sample));
    let fused: Vec<f64> = estimates
        .map(|e| {
            if e.flags & torque_flags::VALID != 0 {
                e.tau
            } else {
                f64::NAN
            }
        })
        .collect();
    let (fused, reference) = (changes(record, &fused), changes(record, &record.tau));
    let spacing = fused.len().div_ceil(MAX_SAMPLES).max(1) as f64;
    let seconds = fused.len() as f64 * record.sample_period;
    let alike = Blocks::alike(record.sample_period) / spacing;
    let mut blocks = Blocks::new(1, Blocks::count(seconds), alike);
    for i in record.spread(MAX_SAMPLES) {
        if fused[i].is_finite() && reference[i].is_finite() {
            let place = i as f64 / fused.len() as f64;
            blocks.add(place, &[fused[i]], reference[i]);
        }
    }
    let posterior = blocks.fit(&[Prior::new(1.0, PRIOR)])?;
    let (gain, sigma) = (posterior.x[0], posterior.covariance[(0, 0)].sqrt());
    let determined = sigma < DETERMINED * PRIOR && POSSIBLE.contains(&gain);
    determined.then_some(TorsionGainTable { gain, sigma })
}

/// A signal in the band, log by log; NaN within a window of one that is not known.
fn changes(record: &Record, signal: &[f64]) -> Vec<f64> {
    record.each_log(signal, |log| {
        let through = |half: f64| {
            let half = (half / record.sample_period).round().max(2.0) as usize;
            smooth(log, 0, half, record.sample_period)
        };
        let [quick, slow] = BAND_S.map(through);
        quick.iter().zip(&slow).map(|(a, b)| a - b).collect()
    })
}
