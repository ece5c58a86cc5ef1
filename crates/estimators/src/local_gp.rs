//! Local Gaussian processes on what a model leaves over (G 6-14).
//!
//! Each local model holds at most some hundred points; a prediction is the mean of the models'
//! own, weighted by the nearness of their centres. Nearness needs the centres alone, and a model's
//! prediction is bounded, so models whose whole share lies below a tolerance are left out.
//!
//! | file | does |
//! | --- | --- |
//! | `local_gp.rs` | parameters, prediction |
//! | `local_gp/factor.rs` | Cholesky factor that grows and shrinks by a point |
//! | `local_gp/updater.rs` | learns on, off the loop's thread, and hands finished models over |
//! | `local_gp/estimator.rs` | the estimator: a model corrected by the residual |

mod estimator;
mod factor;
mod prepare;
mod updater;

pub use estimator::LocalGpEstimator;
pub use factor::Factor;
pub use updater::{Learned, LocalGpUpdater};

use crate::exponential::exp;
use crate::features::{FeatureSet, MAX_FEATURES};
use crate::regimes::Regimes;
use dynamics::lanes::{Instructions, Kernel, Lanes, Pack, WIDTH};
use std::fmt;

/// Most points of one model.
pub const MAX_POINTS: usize = 256;
/// Most models.
pub const MAX_MODELS: usize = 64;

/// One local model: what was seen near its centre.
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
    /// What the residual is a function of.
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
    /// Largest error of the mean by leaving models out, N·m.
    pub tolerance: f64,
    /// How good the corrected torque is on data that the training did not see.
    pub regimes: Regimes,
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
}

/// Parameters from which no prediction can be made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LocalGpError(String);

impl fmt::Display for LocalGpError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "local Gaussian processes: {}", self.0)
    }
}
impl std::error::Error for LocalGpError {}

/// A residual and its variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Mean of the residual, N·m.
    pub mean: f64,
    /// Variance of the residual, the noise not counted, (N·m)².
    pub variance: f64,
    /// How many models took part.
    pub used: usize,
}

/// A local model as it is evaluated: four points side by side, padded with points of no weight.
#[derive(Debug, Clone, Default)]
struct Prepared {
    centre: [f64; MAX_FEATURES],
    /// Per four points: each input of theirs.
    points: Vec<Pack>,
    /// sigma_f² alpha.
    alpha: Vec<Pack>,
    /// sigma_f² times each direction, over the points.
    directions: Vec<Pack>,
    /// No prediction of this model is larger, N·m.
    bound: f64,
}

/// Local Gaussian processes, ready to predict: nothing changes them but a new one in their place.
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
    largest_bound: f64,
    instructions: Instructions,
}

impl LocalGp {
    /// The residual at inputs of the parameters' feature set.
    #[must_use]
    pub fn predict(&self, inputs: &[f64; MAX_FEATURES]) -> Prediction {
        dynamics::lanes::run(self.instructions, Predict(self, inputs))
    }

    /// The same residual from every model, however far; for tests of what the tolerance leaves out.
    #[must_use]
    pub fn predict_from_all(&self, inputs: &[f64; MAX_FEATURES]) -> Prediction {
        let all = Self {
            tolerance: 0.0,
            ..self.clone()
        };
        all.predict(inputs)
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
        //= G13, relative to the nearest model: G14 looks at ratios, and all may be far
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
        // A model left out shifts the mean by at most its weight times (its bound + the mean's).
        let negligible = gp.tolerance * total / gp.models.len() as f64;
        let (mut mean, mut square, mut variance, mut kept, mut used) = (0.0, 0.0, 0.0, 0.0, 0);
        for (weight, model) in weights.iter().zip(&gp.models) {
            if weight * (model.bound + gp.largest_bound) < negligible {
                continue;
            }
            let (m, explained) = evaluate::<L>(model, &x[..gp.features.len()]);
            //= G14: the weighted mean of the local predictions
            mean += weight * m;
            // The variance of a mixture: where models differ, one of them is wrong.
            square += weight * m * m;
            variance += weight * (gp.signal_variance - explained).max(0.0);
            kept += weight;
            used += 1;
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

/// Mean of one model (G11), and by how much its data reduce the variance (G12).
#[inline(always)]
fn evaluate<L: Lanes>(model: &Prepared, x: &[f64]) -> (f64, f64) {
    let mut kernel = [Pack::ZERO; MAX_POINTS / WIDTH];
    let mut mean = L::splat(0.0);
    let blocks = model.points.chunks_exact(x.len()).zip(&model.alpha);
    for ((points, alpha), k) in blocks.zip(&mut kernel) {
        let mut square = L::splat(0.0);
        for (column, x) in points.iter().zip(x) {
            let d = L::load(column) - L::splat(*x);
            square = d.mul_add(d, square);
        }
        //= G9, the widths being in the scaled inputs
        let value = exp(L::splat(-0.5) * square);
        mean = value.mul_add(L::load(alpha), mean);
        value.store(k);
    }
    let kernel = &kernel[..model.alpha.len().min(MAX_POINTS / WIDTH)];
    //= G12, along the directions that were kept
    let sum = |lanes: L| lanes.to_array().iter().sum::<f64>();
    let mut explained = 0.0;
    let mut four = model.directions.chunks_exact(4 * kernel.len().max(1));
    for directions in &mut four {
        let (ab, cd) = directions.split_at(2 * kernel.len());
        let ((a, b), (c, d)) = (ab.split_at(kernel.len()), cd.split_at(kernel.len()));
        let mut sums = [L::splat(0.0); 4];
        for (i, k) in kernel.iter().enumerate() {
            let k = L::load(k);
            for (sum, row) in sums.iter_mut().zip([a, b, c, d]) {
                *sum = L::load(&row[i]).mul_add(k, *sum);
            }
        }
        explained += sums.iter().map(|s| sum(*s).powi(2)).sum::<f64>();
    }
    for direction in four.remainder().chunks_exact(kernel.len().max(1)) {
        let mut along = L::splat(0.0);
        for (u, k) in direction.iter().zip(kernel) {
            along = L::load(u).mul_add(L::load(k), along);
        }
        explained += sum(along).powi(2);
    }
    (sum(mean), explained)
}
