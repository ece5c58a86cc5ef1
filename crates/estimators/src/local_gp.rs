//! Local Gaussian processes on the residual of a model (G 6-14).
//!
//! Each local model holds at most some hundred points; a prediction is the mean of the models'
//! own, weighted by the nearness of their centres (G14). As a model falls back to zero beyond its
//! data, each is given all data of its neighbourhood, where its weight is at least
//! [`MIN_RELATIVE_WEIGHT`], and not only those nearer to its centre than to any other. The weights
//! need the centres alone, and a model's prediction is bounded, so models whose whole share lies below
//! a tolerance are left out.
//!
//! | file | does |
//! | --- | --- |
//! | `local_gp.rs` | parameters, prediction |
//! | `local_gp/prepare.rs` | from points to the terms of a prediction |
//! | `local_gp/sparsify.rs` | the same mean from fewer points |
//! | `local_gp/evaluate.rs` | one model's prediction, in double or, where that is enough, single precision |
//! | `local_gp/factor.rs` | Cholesky factor that grows by a point |
//! | `local_gp/estimator.rs` | the estimator: a model corrected by the residual |

mod estimator;
mod evaluate;
mod factor;
mod prepare;
mod sparsify;

pub use estimator::LocalGpEstimator;

use crate::exponential::exp;
use crate::features::{FeatureSet, MAX_FEATURES};
use crate::regimes::Regimes;
use evaluate::{Points, Room};
use simd::{Instructions, Kernel, Lanes, WIDTH};

/// Points of one model, at most.
pub const MAX_POINTS: usize = 256;
/// A sample belongs to every model whose weight at it is at least this part of the largest.
pub const MIN_RELATIVE_WEIGHT: f64 = 0.1;
/// Samples that a point represents, at most: misfit of the model does not average out.
pub const MAX_SAMPLES_PER_POINT: f64 = 100.0;
/// Models, at most.
pub const MAX_MODELS: usize = 64;

/// One local model: training data near its centre.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LocalModel {
    /// c: centre, in scaled inputs.
    pub centre: Vec<f64>,
    /// Points, one after the other, in scaled inputs.
    pub points: Vec<f64>,
    /// y: the residual at each point, N·m.
    pub residuals: Vec<f64>,
    /// Variance of each residual: of one sample's noise, or less where a point stands for several,
    /// (N·m)².
    pub noise: Vec<f64>,
}

/// Trained local models.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalGpParameters {
    /// Inputs of the residual.
    pub features: FeatureSet,
    /// Per input: its mean, and what it is divided by: the kernel's width (ARD, G9).
    pub inputs: Vec<(f64, f64)>,
    /// sigma_f²: variance of the residual before any data, (N·m)².
    pub signal_variance: f64,
    /// sigma_n²: variance of a sample's noise, (N·m)².
    pub noise_variance: f64,
    /// The models, at most [`MAX_MODELS`] of at most [`MAX_POINTS`] points.
    pub models: Vec<LocalModel>,
    /// Directions per model in which the data reduce the variance (G12). Fewer than points make it
    /// too large, never too small.
    pub directions: usize,
    /// Largest error of the mean by leaving models and points out and by single precision, N·m;
    /// 0: all of them, in double precision.
    pub tolerance: f64,
    /// Errors of the corrected torque on data that the training did not see.
    pub regimes: Regimes,
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
}

/// A residual and its variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Mean of the residual, N·m.
    pub mean: f64,
    /// Variance of the residual, the noise not counted, (N·m)².
    pub variance: f64,
    /// Number of models that took part.
    pub used: usize,
}

/// A local model as it is evaluated.
#[derive(Debug, Clone)]
struct Prepared {
    centre: [f64; MAX_FEATURES],
    points: Points,
    /// No prediction of this model is larger, N·m.
    bound: f64,
}

/// Local Gaussian processes, ready to predict.
#[derive(Debug, Clone)]
pub struct LocalGp {
    features: FeatureSet,
    /// Per input: its mean, and 1 over the kernel's width.
    scales: [(f64, f64); MAX_FEATURES],
    signal_variance: f64,
    tolerance: f64,
    regimes: Regimes,
    gear_ratio: f64,
    models: Vec<Prepared>,
    /// Excess of the variance that one model may cause, (N·m)².
    negligible_variance: f64,
    instructions: Instructions,
}

impl LocalGp {
    /// The residual at inputs of the parameters' feature set.
    #[must_use]
    pub fn predict(&self, inputs: &[f64; MAX_FEATURES]) -> Prediction {
        simd::run(self.instructions, Predict(self, inputs))
    }
}

struct Predict<'a>(&'a LocalGp, &'a [f64; MAX_FEATURES]);

impl Kernel for Predict<'_> {
    type Output = Prediction;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Prediction {
        let Self(gp, inputs) = self;
        let mut x = [0.0; MAX_FEATURES];
        for ((x, raw), (mean, per_width)) in x.iter_mut().zip(inputs).zip(&gp.scales) {
            // Bounded so that squares stay finite.
            *x = ((raw - mean) * per_width).clamp(-1e9, 1e9);
        }
        let mut distances = [f64::INFINITY; MAX_MODELS];
        let mut nearest = f64::INFINITY;
        for (distance, model) in distances.iter_mut().zip(&gp.models) {
            let differences = x.iter().zip(&model.centre).map(|(a, b)| (a - b) * (a - b));
            *distance = differences.sum();
            nearest = nearest.min(*distance);
        }
        // Relative to the nearest model: G14 takes ratios, and all models may be far.
        //= G13: w_k = exp(-1/2 (x - c_k)' W (x - c_k))
        let mut weights = [0.0; MAX_MODELS];
        let mut total = 0.0;
        for (to, from) in weights
            .chunks_exact_mut(WIDTH)
            .zip(distances.chunks_exact(WIDTH))
            .take(gp.models.len().div_ceil(WIDTH))
        {
            let distance = L::set(std::array::from_fn(|lane| from[lane].min(1e30) - nearest));
            to.copy_from_slice(&exp(L::splat(-0.5) * distance).to_array());
            total += to.iter().sum::<f64>();
        }
        let (mut mean, mut square, mut variance, mut kept, mut used) = (0.0, 0.0, 0.0, 0.0, 0);
        let mut room = Room::EMPTY;
        let bounds = weights.iter().zip(&gp.models).map(|(w, m)| w * m.bound);
        let (mut left, mut left_bounds) = (total, bounds.sum::<f64>());
        // The nearest first. The models left out shift the mean by at most their weights times
        // (their bounds + the mean's magnitude).
        while used < gp.models.len() {
            let now: f64 = mean / f64::max(kept, f64::MIN_POSITIVE);
            if used > 0 && left_bounds + left * now.abs() <= 0.5 * gp.tolerance * total {
                break;
            }
            let (i, weight) = largest(&weights[..gp.models.len()]);
            weights[i] = -1.0;
            let model = &gp.models[i];
            // Below the negligible variance the reduction by the data is left out.
            let counts = weight * gp.signal_variance > gp.negligible_variance * total;
            let (m, explained) = match gp.features.len() {
                3 => model.evaluate::<L, 3>(&x, counts, &mut room),
                4 => model.evaluate::<L, 4>(&x, counts, &mut room),
                6 => model.evaluate::<L, 6>(&x, counts, &mut room),
                _ => model.evaluate::<L, MAX_FEATURES>(&x, counts, &mut room),
            };
            //= G14: y = sum_k w_k y_k / sum_k w_k
            mean += weight * m;
            // The variance of a mixture: where models differ, one of them is wrong.
            square += weight * m * m;
            variance += weight * (gp.signal_variance - explained).max(0.0);
            kept += weight;
            used += 1;
            left = (left - weight).max(0.0);
            left_bounds = (left_bounds - weight * model.bound).max(0.0);
        }
        if used == 0 {
            return Prediction {
                mean: 0.0,
                variance: gp.signal_variance,
                used,
            };
        }
        mean /= kept;
        Prediction {
            mean,
            variance: variance / kept + (square / kept - mean * mean).max(0.0),
            used,
        }
    }
}

/// Place and value of the largest.
#[inline(always)]
fn largest(weights: &[f64]) -> (usize, f64) {
    let mut best = (0, f64::NEG_INFINITY);
    for (i, weight) in weights.iter().enumerate() {
        // Without a branch, which the processor could not predict.
        let better = *weight > best.1;
        best = (
            if better { i } else { best.0 },
            if better { *weight } else { best.1 },
        );
    }
    best
}
