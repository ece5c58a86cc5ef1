//! Training of a feed-forward torque from recorded motion (G V-B): what inverse dynamics was missing.
//!
//! ```text
//! y = tau_d - (M ddq + h - J^T f) of the motion that followed      inputs: q, dq, ddq of that motion
//! ```
//!
//! It is the inverse of what the joint does: asked for a desired motion, it gives the torque beside the
//! model's that has made such a motion, whatever the reason (payload, model, gear, friction). As the prior
//! mean is zero, it fades to nothing beyond the motions that were recorded.

use super::clustering::{self, Sample};
use super::{GpOptions, hyper_parameters};
use crate::learned::Progress;
use estimators::features::{FeatureSet, MAX_FEATURES};
use estimators::local_gp::{LocalGp, LocalGpParameters};
use estimators::regimes::{Regime, Regimes};
use joint_file::{TrainedLocalGp, feed_forward_base};
use problem::Problem;

/// Recorded motion of one joint, sample by sample.
#[derive(Debug, Clone, Default)]
pub struct MotionLog {
    /// Inputs: motions of the joint and of its neighbours.
    pub inputs: Vec<[f64; MAX_FEATURES]>,
    /// y: torque that the model did not explain, N·m; NaN where it is not known.
    pub missing: Vec<f64>,
}

/// Length of a block, s, and one of how many is held out: neighbouring samples are alike.
const BLOCK_S: f64 = 0.7;
const HOLD_OUT_INTERVAL: usize = 5;
/// Shortest recording, s.
const SHORTEST_S: f64 = 5.0;

/// Options for a feed-forward of a joint of this torque limit, N·m.
#[must_use]
pub fn motion_options(joint: &str, torque_limit: f64) -> GpOptions {
    GpOptions {
        features: FeatureSet::Motion,
        models: 16,
        points: 100,
        directions: 1,
        subsample: 300,
        ..GpOptions::new(&feed_forward_base(joint), torque_limit)
    }
}

/// Trains on one joint's motion.
///
/// # Errors
/// Less than some seconds of motion.
pub fn train_motion(
    log: &MotionLog,
    sample_period: f64,
    options: &GpOptions,
    progress: Progress<'_>,
) -> Result<TrainedLocalGp, Problem> {
    let known: Vec<usize> = (0..log.inputs.len().min(log.missing.len()))
        .filter(|&i| log.missing[i].is_finite() && log.inputs[i].iter().all(|x| x.is_finite()))
        .collect();
    let seconds = known.len() as f64 * sample_period;
    if seconds < SHORTEST_S {
        return Err(Problem::new(
            format!("{seconds:.1} s of motion that can be learned from"),
            format!("at least {SHORTEST_S} s in a mode that follows a desired motion"),
        ));
    }
    let block = ((BLOCK_S / sample_period) as usize).max(1);
    let held_out = |i: usize| (i / block) % HOLD_OUT_INTERVAL == HOLD_OUT_INTERVAL - 1;
    let some = |of: &dyn Fn(usize) -> bool, most: usize| {
        let all: Vec<usize> = known.iter().copied().filter(|&i| of(i)).collect();
        let step = all.len().div_ceil(most).max(1);
        all.into_iter().step_by(step).collect::<Vec<usize>>()
    };
    let subsample = some(&|i| !held_out(i), options.subsample);
    let inputs: Vec<_> = subsample.iter().map(|&i| log.inputs[i]).collect();
    let outputs: Vec<f64> = subsample.iter().map(|&i| log.missing[i]).collect();
    let hyper = hyper_parameters::fit(&inputs, &outputs, options.features.len(), &mut |part| {
        progress(0.6 * part, "feed-forward: hyper-parameters");
    });
    let models = |of: &dyn Fn(usize) -> bool| {
        let used = known.iter().filter(|&&i| of(i));
        let samples = used.map(|&i| Sample {
            x: hyper.scaled(&log.inputs[i]),
            y: log.missing[i],
            index: i,
        });
        let samples: Vec<Sample> = samples.collect();
        LocalGpParameters {
            features: options.features,
            inputs: hyper.inputs.clone(),
            signal_variance: hyper.signal_variance,
            noise_variance: hyper.noise_variance,
            models: clustering::models(&samples, options, &hyper, sample_period),
            directions: options.directions,
            tolerance: options.tolerance,
            regimes: always(sample_period, hyper.noise_variance.sqrt()),
            gear_ratio: 1.0,
        }
    };
    progress(0.6, "feed-forward: models without the held-out blocks");
    let judged_on = LocalGp::new(&models(&|i| !held_out(i)))?;
    let judged = some(&held_out, 20_000);
    let rms = |left: &dyn Fn(usize) -> f64| {
        let square: f64 = judged.iter().map(|&i| left(i).powi(2)).sum();
        (square / judged.len().max(1) as f64).sqrt()
    };
    let held_out_rms = (
        rms(&|i| log.missing[i]),
        rms(&|i| log.missing[i] - judged_on.predict(&log.inputs[i]).mean),
    );
    progress(0.8, "feed-forward: models with all samples");
    let parameters = models(&|_| true);
    LocalGp::new(&parameters)?;
    progress(1.0, "feed-forward: done");
    Ok(TrainedLocalGp {
        base: options.base.clone(),
        parameters,
        held_out_rms,
    })
}

/// One regime: a feed-forward has no rest of its own.
fn always(sample_period: f64, sigma: f64) -> Regimes {
    let regime = Regime { gain: 1.0, sigma };
    Regimes {
        speed: 1.0,
        time_constant: 1.0,
        sample_period,
        rest: regime,
        moving: regime,
    }
}
