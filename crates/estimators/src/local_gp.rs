//! Local Gaussian processes on what a compliance model leaves over (G 6-14).
//!
//! Each model holds at most some hundred points; a prediction is the mean of the models near the
//! input, weighted by their nearness. The weights that G14 needs come from the models' centres
//! alone, and a model's own prediction is bounded, so models whose whole share lies below a
//! tolerance are left out.

use crate::features::{FeatureSet, MAX_FEATURES};
use crate::joint::{JointSample, JointTorqueEstimator};
use crate::output::Output;
use robot_state::{TorqueEstimate, torque_flags, torque_source};

/// One local model, trained.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalModel {
    /// c: centre, in scaled inputs.
    pub centre: Vec<f64>,
    /// Points, one after the other, in scaled inputs.
    pub points: Vec<f64>,
    /// (K + sigma_n² I)^-1 y, one per point (G10).
    pub alpha: Vec<f64>,
    /// Directions in which the data reduce the variance, each of as many entries as points:
    /// eigenvectors of K over the roots of their eigenvalues plus noise.
    ///
    /// Not all need be kept: with fewer, the variance errs to the safe side.
    pub directions: Vec<f64>,
}

/// Trained local models.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalGpParameters {
    /// What the residual is a function of.
    pub features: FeatureSet,
    /// Per input: its mean, and what it is divided by: the kernel's width (ARD, G9) comes last.
    pub inputs: Vec<(f64, f64)>,
    /// sigma_f²: variance of the residual before any data, (N·m)².
    pub signal_variance: f64,
    /// sigma_n²: variance of a sample's noise, (N·m)².
    pub noise_variance: f64,
    /// The models.
    pub models: Vec<LocalModel>,
    /// Largest error of the mean by leaving models out, N·m.
    pub tolerance: f64,
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
    /// How many models took part.
    pub used: usize,
}

/// Points that are taken at a time.
const LANES: usize = 4;

/// A local model as it is evaluated: inputs in columns of [`LANES`] points, padded.
#[derive(Debug, Clone)]
struct Prepared {
    centre: [f64; MAX_FEATURES],
    columns: Vec<f64>,
    alpha: Vec<f64>,
    directions: Vec<f64>,
    /// No prediction of this model is larger, N·m.
    bound: f64,
}

/// Local Gaussian processes, ready to predict.
#[derive(Debug, Clone)]
pub struct LocalGp {
    parameters: LocalGpParameters,
    models: Vec<Prepared>,
    weights: Vec<f64>,
    kernel: Vec<f64>,
    largest_bound: f64,
}

impl LocalGp {
    /// Prepares the models.
    #[must_use]
    pub fn new(parameters: LocalGpParameters) -> Self {
        let dimensions = parameters.features.len();
        let prepare = |model: &LocalModel| {
            let count = model.alpha.len();
            let padded = count.div_ceil(LANES) * LANES;
            let mut columns = vec![0.0; padded * dimensions];
            for (i, point) in model
                .points
                .chunks_exact(dimensions)
                .take(count)
                .enumerate()
            {
                for (d, x) in point.iter().enumerate() {
                    columns[(i / LANES * dimensions + d) * LANES + i % LANES] = *x;
                }
            }
            let pad = |row: &[f64]| {
                let mut row = row.to_vec();
                row.resize(padded, 0.0);
                row
            };
            let mut centre = [0.0; MAX_FEATURES];
            centre
                .iter_mut()
                .zip(&model.centre)
                .for_each(|(a, b)| *a = *b);
            Prepared {
                centre,
                columns,
                alpha: pad(&model.alpha),
                directions: model
                    .directions
                    .chunks(count.max(1))
                    .flat_map(pad)
                    .collect(),
                bound: parameters.signal_variance
                    * model.alpha.iter().map(|a| a.abs()).sum::<f64>(),
            }
        };
        let models: Vec<Prepared> = parameters.models.iter().map(prepare).collect();
        let widest = models.iter().map(|m| m.alpha.len()).max().unwrap_or(0);
        Self {
            weights: vec![0.0; models.len()],
            kernel: vec![0.0; widest],
            largest_bound: models.iter().fold(0.0, |b, m| b.max(m.bound)),
            models,
            parameters,
        }
    }

    /// The trained models.
    #[must_use]
    pub fn parameters(&self) -> &LocalGpParameters {
        &self.parameters
    }

    /// The residual at inputs of the parameters' feature set.
    pub fn predict(&mut self, inputs: &[f64; MAX_FEATURES]) -> Prediction {
        let p = &self.parameters;
        let mut x = [0.0; MAX_FEATURES];
        for ((x, raw), (mean, width)) in x.iter_mut().zip(inputs).zip(&p.inputs) {
            *x = (raw - mean) / width;
        }
        let mut total = 0.0;
        for (weight, model) in self.weights.iter_mut().zip(&self.models) {
            let square: f64 = x
                .iter()
                .zip(&model.centre)
                .map(|(a, b)| (a - b) * (a - b))
                .sum();
            //= G13
            *weight = (-0.5 * square).exp();
            total += *weight;
        }
        let prior = Prediction {
            mean: 0.0,
            variance: p.signal_variance,
            used: 0,
        };
        if total.is_nan() || total < f64::MIN_POSITIVE {
            return prior;
        }
        // A model left out shifts the mean by at most its weight times (its bound + the mean's).
        let negligible = p.tolerance * total / self.models.len() as f64;
        let (mut mean, mut variance, mut kept, mut used) = (0.0, 0.0, 0.0, 0);
        for (weight, model) in self.weights.iter().zip(&self.models) {
            if weight * (model.bound + self.largest_bound) <= negligible {
                continue;
            }
            let (m, v) = evaluate(
                model,
                &x,
                p.features.len(),
                p.signal_variance,
                &mut self.kernel,
            );
            //= G14: the weighted mean of the local predictions
            mean += weight * m;
            variance += weight * v;
            kept += weight;
            used += 1;
        }
        if used == 0 {
            return prior;
        }
        Prediction {
            mean: mean / kept,
            variance: variance / kept,
            used,
        }
    }
}

/// Mean and variance of one model (G11, G12).
fn evaluate(
    model: &Prepared,
    x: &[f64; MAX_FEATURES],
    dimensions: usize,
    signal_variance: f64,
    kernel: &mut [f64],
) -> (f64, f64) {
    let mut means = [0.0; LANES];
    let blocks = model.columns.chunks_exact(dimensions * LANES);
    let rows = kernel
        .chunks_exact_mut(LANES)
        .zip(model.alpha.chunks_exact(LANES));
    for (block, (k, alpha)) in blocks.zip(rows) {
        let mut squares = [0.0; LANES];
        for (column, x) in block.chunks_exact(LANES).zip(x) {
            for lane in 0..LANES {
                let d = column[lane] - x;
                squares[lane] += d * d;
            }
        }
        for lane in 0..LANES {
            //= G9, the widths being in the scaled inputs
            k[lane] = signal_variance * exp_of_negative(-0.5 * squares[lane]);
            means[lane] += k[lane] * alpha[lane];
        }
    }
    //= G12, along the directions that were kept
    let explained: f64 = model
        .directions
        .chunks_exact(model.alpha.len().max(1))
        .map(|direction| {
            let mut sums = [0.0; LANES];
            for (u, k) in direction
                .chunks_exact(LANES)
                .zip(kernel.chunks_exact(LANES))
            {
                for lane in 0..LANES {
                    sums[lane] += u[lane] * k[lane];
                }
            }
            sums.iter().sum::<f64>().powi(2)
        })
        .sum();
    (means.iter().sum(), (signal_variance - explained).max(0.0))
}

/// `exp(x)` for x <= 0 to 1e-13 relative, without a branch, so that four run at a time.
///
/// `exp(x) = 2^k exp(r)`, k the nearest integer to x/ln 2, r by its Taylor series: |r| < 0.35, so
/// the 12th power is below 1e-14. Below -700 it is held at exp(-700): 1e-304.
#[inline]
fn exp_of_negative(x: f64) -> f64 {
    /// Added to and taken from a number, rounds it to an integer and leaves it in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52
    const LN2_HIGH: f64 = 6.931_471_803_691_238e-1;
    const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
    let x = x.max(-700.0);
    let shifted = x * std::f64::consts::LOG2_E + ROUND;
    let k = shifted - ROUND;
    let r = (x - k * LN2_HIGH) - k * LN2_LOW;
    let mut series = 1.0 / 479_001_600.0;
    for factorial in [
        39_916_800.0,
        3_628_800.0,
        362_880.0,
        40_320.0,
        5_040.0,
        720.0,
        120.0,
        24.0,
        6.0,
        2.0,
        1.0,
        1.0,
    ] {
        series = series * r + 1.0 / factorial;
    }
    let exponent = (shifted.to_bits() << 52).wrapping_add(1023 << 52);
    series * f64::from_bits(exponent)
}

/// A model (G: the compliance model) corrected by local Gaussian processes.
pub struct LocalGpEstimator {
    base: Box<dyn JointTorqueEstimator + Send>,
    residual: Box<LocalGp>,
    output: Output,
}

impl LocalGpEstimator {
    /// The correction of `base` by `residual`.
    #[must_use]
    pub fn new(
        base: Box<dyn JointTorqueEstimator + Send>,
        residual: Box<LocalGp>,
        torque_limit: f64,
    ) -> Self {
        let output = Output::new(torque_source::ENCODER, torque_limit, 0.0);
        Self {
            base,
            residual,
            output,
        }
    }

    /// Exchanges the residual for a newly trained one and hands the old one back: a move of two
    /// pointers, so that the loop neither waits nor frees memory.
    pub fn exchange(&mut self, residual: Box<LocalGp>) -> Box<LocalGp> {
        std::mem::replace(&mut self.residual, residual)
    }
}

impl JointTorqueEstimator for LocalGpEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        let model = self.base.update(sample);
        if model.flags & torque_flags::VALID == 0 || !Output::usable(sample) {
            return self.output.held();
        }
        let p = &self.residual.parameters;
        let x = p.features.of(sample, sample.current, p.gear_ratio);
        let noise = p.noise_variance;
        let Prediction { mean, variance, .. } = self.residual.predict(&x);
        //= G: tau = tau_model + y
        let mut estimate = self
            .output
            .give(sample, model.tau + mean, (variance + noise).sqrt());
        estimate.flags |= model.flags & torque_flags::SATURATED;
        estimate.delay_s = model.delay_s;
        estimate
    }

    fn reset(&mut self) {
        self.base.reset();
        self.output.reset();
    }
}

#[cfg(test)]
mod tests {
    use super::exp_of_negative;

    #[test]
    fn exponential_is_exact_to_thirteen_digits() {
        for i in 0..70_000 {
            let x = -0.01 * f64::from(i);
            let (ours, theirs) = (exp_of_negative(x), x.exp());
            assert!(
                (ours - theirs).abs() <= 1e-13 * theirs,
                "{x}: {ours} {theirs}"
            );
        }
        assert!(exp_of_negative(-1e300) < 1e-300);
        assert!(exp_of_negative(f64::NEG_INFINITY) < 1e-300);
    }
}
