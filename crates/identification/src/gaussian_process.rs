//! Training of local Gaussian processes on the residual of a model (G 6-14).
//!
//! ```text
//! residual = tau_sensor - tau_model, zero-phase filtered, the model's delay taken out
//!   -> widths, signal and noise: most likely on a subsample          hyper_parameters.rs
//!   -> centres by similarity (G13), points of largest variance       clustering.rs
//!   -> regimes' figures on held-out blocks; then once more with all samples
//! ```

mod clustering;
mod hyper_parameters;
mod motion;
mod recorded_motion;

pub use hyper_parameters::{HyperParameters, log_marginal_likelihood};
pub use motion::{MotionLog, motion_options, train_motion};
pub use recorded_motion::GatherMotion;

use crate::learned::{Judged, Progress, Use, judge, motion, of_use, uses, zero_phase};
use crate::record::Record;
use clustering::Sample;
use estimators::features::{FeatureSet, MAX_FEATURES};
use estimators::joint::JointTorqueEstimator;
use estimators::local_gp::{LocalGp, LocalGpParameters, MAX_MODELS, MAX_POINTS};
use estimators::regimes::Regimes;
use joint_file::TrainedLocalGp;
use problem::Problem;
use robot_state::torque_flags;

/// Options of the training.
#[derive(Debug, Clone, PartialEq)]
pub struct GpOptions {
    /// Inputs of the residual.
    pub features: FeatureSet,
    /// Name of the model that is corrected, as in the joint file.
    pub base: String,
    /// M: most models.
    pub models: usize,
    /// Most points of a model.
    pub points: usize,
    /// Directions per model in which the data reduce the variance.
    pub directions: usize,
    /// Samples that the hyper-parameters are fitted to.
    pub subsample: usize,
    /// Largest error of the mean by leaving models out, N·m.
    pub tolerance: f64,
}

impl GpOptions {
    /// G's numbers; `base` is the model's name, `rated_torque` in N·m.
    #[must_use]
    pub fn new(base: &str, rated_torque: f64) -> Self {
        Self {
            features: FeatureSet::Phase,
            base: base.to_owned(),
            models: 20,
            points: 200,
            directions: 12,
            subsample: 500,
            tolerance: 1e-4 * rated_torque,
        }
    }
}

/// Trains on loaded motion and rest beside a torque sensor; `base` is the model whose residual is
/// learned.
///
/// # Errors
/// A log without torque sensor, or too short to hold anything out.
pub fn train(
    record: &Record,
    options: &GpOptions,
    base: &mut dyn JointTorqueEstimator,
    progress: Progress<'_>,
) -> Result<TrainedLocalGp, Problem> {
    for (what, value, most) in [
        ("models", options.models, MAX_MODELS),
        ("points", options.points, MAX_POINTS),
    ] {
        if value == 0 || value > most {
            return Err(Problem::new(
                format!("local Gaussian processes: {value} {what}"),
                format!("1 to {most}"),
            ));
        }
    }
    progress(0.0, "local Gaussian processes: residual of the model");
    let Residual {
        learned: residual,
        left,
    } = Residual::new(record, base);
    let mut uses = uses(record);
    for (used, residual) in uses.iter_mut().zip(&residual) {
        if !residual.is_finite() {
            *used = Use::Nothing;
        }
    }
    let raw = |i: usize| {
        let s = &record.samples[i];
        options.features.of(s, s.current, record.gear_ratio)
    };
    let subsample = of_use(&uses, Use::Train, options.subsample);
    let held_out = of_use(&uses, Use::HeldOut, 20_000);
    if subsample.len() < options.subsample / 2 || held_out.len() < 100 {
        let (count, needed) = (subsample.len(), options.subsample);
        return Err(Problem::new(
            format!("training log: {count} samples to train on"),
            format!("at least {needed} with a reference torque, over several seconds"),
        ));
    }
    let inputs: Vec<[f64; MAX_FEATURES]> = subsample.iter().map(|&i| raw(i)).collect();
    let outputs: Vec<f64> = subsample.iter().map(|&i| residual[i]).collect();
    let hyper = hyper_parameters::fit(&inputs, &outputs, options.features.len(), &mut |part| {
        progress(0.5 * part, "local Gaussian processes: hyper-parameters");
    });
    let (mut regimes, shares) = motion(record);
    let assemble = |of: &dyn Fn(Use) -> bool, regimes: Regimes| {
        let samples = (0..uses.len()).filter(|&i| of(uses[i])).map(|i| Sample {
            x: hyper.scaled(&raw(i)),
            y: residual[i],
            index: i,
        });
        let samples: Vec<Sample> = samples.collect();
        LocalGpParameters {
            features: options.features,
            inputs: hyper.inputs.clone(),
            signal_variance: hyper.signal_variance,
            noise_variance: hyper.noise_variance,
            models: clustering::models(&samples, options, &hyper, record.sample_period),
            directions: options.directions,
            tolerance: options.tolerance,
            regimes,
            gear_ratio: record.gear_ratio,
        }
    };
    progress(
        0.6,
        "local Gaussian processes: models without the held-out blocks",
    );
    let judged_on = assemble(&|used| used == Use::Train, regimes);
    let gp = LocalGp::new(&judged_on)?;
    let judged: Vec<Judged> = held_out
        .iter()
        .map(|&i| (shares[i], gp.predict(&raw(i)).mean, left[i]))
        .collect();
    let prior = (hyper.signal_variance + hyper.noise_variance).sqrt();
    regimes.rest = judge(&judged, false, None, prior);
    regimes.moving = judge(&judged, true, None, prior);
    progress(0.8, "local Gaussian processes: models with all samples");
    let parameters = assemble(&|used| used != Use::Nothing, regimes);
    let rms = |of: &dyn Fn(&Judged) -> f64| {
        let square: f64 = judged.iter().map(|j| of(j).powi(2)).sum();
        (square / judged.len() as f64).sqrt()
    };
    let corrected = |j: &Judged| {
        let gain = if j.0 > 0.5 {
            regimes.moving.gain
        } else {
            regimes.rest.gain
        };
        j.2 - gain * j.1
    };
    let held_out_rms = (rms(&|j| j.2), rms(&corrected));
    progress(1.0, "local Gaussian processes: done");
    Ok(TrainedLocalGp {
        base: options.base.clone(),
        parameters,
        held_out_rms,
    })
}

/// Residual of the model at each sample, N·m; NaN where there is none.
struct Residual {
    /// Zero-phase filtered, the model's delay taken out: left in, it would look like a residual
    /// that follows the torque's rate.
    learned: Vec<f64>,
    /// With the model's delay, as in the loop.
    left: Vec<f64>,
}

impl Residual {
    fn new(record: &Record, base: &mut dyn JointTorqueEstimator) -> Self {
        base.reset();
        let estimates: Vec<_> = record.samples.iter().map(|s| base.update(s)).collect();
        let valid = |i: usize| estimates[i].flags & torque_flags::VALID != 0;
        let tau: Vec<f64> = estimates.iter().map(|e| e.tau).collect();
        let (sensor, model) = (zero_phase(record, &record.tau), zero_phase(record, &tau));
        let delay = estimates.last().map_or(0.0, |e| e.delay_s) / record.sample_period;
        let (whole, part) = (delay.floor() as usize, delay.fract());
        let learned = |i: usize| {
            let (a, b) = (i + whole, i + whole + 1);
            if b < tau.len() && valid(i) && valid(a) && valid(b) {
                sensor[i] - (model[a] + part * (model[b] - model[a]))
            } else {
                f64::NAN
            }
        };
        Self {
            learned: (0..tau.len()).map(learned).collect(),
            left: record.tau.iter().zip(&tau).map(|(s, m)| s - m).collect(),
        }
    }
}
