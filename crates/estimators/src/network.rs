//! Back-propagation network (S 28-46), as the loop runs it: forwards only, without allocation.

use crate::features::{FeatureSet, MAX_FEATURES};
use crate::joint::{JointSample, JointTorqueEstimator};
use crate::output::Output;
use robot_state::{TorqueEstimate, torque_source};
use std::fmt;

/// Scalar Kalman filter with F = H = 1 (S 29-35).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScalarKalman {
    /// Q: variance of the process.
    pub process: f64,
    /// R: variance of the measurement.
    pub measurement: f64,
    /// P: variance of the value, from sample to sample.
    variance: f64,
    value: Option<f64>,
}

impl ScalarKalman {
    /// A filter that has seen nothing; S has Q 0.05, R 0.25, P0 0.01.
    #[must_use]
    pub fn new(process: f64, measurement: f64, initial: f64) -> Self {
        Self {
            process,
            measurement,
            variance: initial,
            value: None,
        }
    }

    /// Takes one sample; the first one is the first value.
    pub fn update(&mut self, z: f64) -> f64 {
        let value = self.value.unwrap_or(z);
        //= S31-35
        let predicted = self.variance + self.process;
        let gain = predicted / (predicted + self.measurement);
        self.variance = (1.0 - gain) * predicted;
        let value = value + gain * (z - value);
        self.value = Some(value);
        value
    }
}

/// One layer: `y = W x + b`.
#[derive(Debug, Clone, PartialEq)]
pub struct Layer {
    /// W: one row per output.
    pub weights: Vec<Vec<f64>>,
    /// b: one per output.
    pub bias: Vec<f64>,
}

/// A trained network.
#[derive(Debug, Clone, PartialEq)]
pub struct NetworkParameters {
    /// What it looks at.
    pub features: FeatureSet,
    /// Per input: its mean and half of its range in the training data.
    pub inputs: Vec<(f64, f64)>,
    /// Mean and standard deviation of the torque in the training data, N·m.
    pub torque: (f64, f64),
    /// Layers; all but the last end in a sigmoid.
    pub layers: Vec<Layer>,
    /// Q, R and P0 of the filter on the current, A².
    pub current_filter: [f64; 3],
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// Standard deviation of the torque on data that the training did not see, N·m.
    pub sigma: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
}

/// Layers that do not fit together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NetworkError(String);

impl fmt::Display for NetworkError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "network: {}", self.0)
    }
}
impl std::error::Error for NetworkError {}

/// Layers in one piece of memory, with their activations.
#[derive(Debug, Clone)]
struct Forward {
    /// Rows of each layer's weights, bias first.
    rows: Vec<f64>,
    /// Inputs and outputs of each layer.
    sizes: Vec<(usize, usize)>,
    activations: [Vec<f64>; 2],
}

impl Forward {
    fn new(inputs: usize, layers: &[Layer]) -> Result<Self, NetworkError> {
        let mut rows = Vec::new();
        let mut sizes = Vec::new();
        let mut width = inputs;
        for (i, layer) in layers.iter().enumerate() {
            let fits = layer.bias.len() == layer.weights.len() && !layer.bias.is_empty();
            if !fits || layer.weights.iter().any(|row| row.len() != width) {
                let outputs = layer.bias.len();
                let message = format!("layer {i} must have {outputs} rows of {width} weights");
                return Err(NetworkError(message));
            }
            for (row, bias) in layer.weights.iter().zip(&layer.bias) {
                rows.push(*bias);
                rows.extend(row);
            }
            sizes.push((width, layer.bias.len()));
            width = layer.bias.len();
        }
        if width != 1 || layers.is_empty() {
            return Err(NetworkError(
                "the last layer must have one output".to_owned(),
            ));
        }
        if rows.iter().any(|w| !w.is_finite()) {
            return Err(NetworkError("weights must be finite".to_owned()));
        }
        let widest = sizes.iter().fold(inputs, |w, s| w.max(s.1));
        let activations = [vec![0.0; widest], vec![0.0; widest]];
        Ok(Self {
            rows,
            sizes,
            activations,
        })
    }

    fn run(&mut self) -> f64 {
        let [from, to] = &mut self.activations;
        let mut rows = self.rows.as_slice();
        let last = self.sizes.len().saturating_sub(1);
        for (i, &(inputs, outputs)) in self.sizes.iter().enumerate() {
            let (layer, rest) = rows.split_at(outputs * (inputs + 1));
            rows = rest;
            let x = &from[..inputs];
            for (row, y) in layer.chunks_exact(inputs + 1).zip(to.iter_mut()) {
                let sum = row[0] + dot(&row[1..], x);
                *y = if i == last { sum } else { sigmoid(sum) };
            }
            std::mem::swap(from, to);
        }
        from.first().copied().unwrap_or(0.0)
    }
}

/// Four sums side by side, so that additions need not wait for each other.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = a4
        .remainder()
        .iter()
        .zip(b4.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in a4.zip(b4) {
        for lane in 0..4 {
            sums[lane] += x[lane] * y[lane];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// The logistic function.
#[must_use]
pub fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// S's network as an estimator.
#[derive(Debug, Clone)]
pub struct NetworkEstimator {
    parameters: NetworkParameters,
    forward: Forward,
    current: ScalarKalman,
    output: Output,
}

impl NetworkEstimator {
    /// A network that has seen no sample.
    ///
    /// # Errors
    /// Layers whose sizes do not fit together, or weights that are not finite.
    pub fn new(parameters: NetworkParameters) -> Result<Self, NetworkError> {
        let inputs = parameters.features.len();
        if parameters.inputs.len() != inputs {
            let message = format!("{inputs} inputs must be scaled");
            return Err(NetworkError(message));
        }
        let [q, r, p] = parameters.current_filter;
        Ok(Self {
            forward: Forward::new(inputs, &parameters.layers)?,
            current: ScalarKalman::new(q, r, p),
            output: Output::new(torque_source::ENCODER, parameters.torque_limit, 0.0),
            parameters,
        })
    }

    /// Scales the inputs; how far the furthest lies outside of what the training saw, in half ranges.
    fn scale(&mut self, x: &[f64; MAX_FEATURES]) -> f64 {
        let mut outside = 0.0f64;
        let inputs = self.parameters.inputs.iter().zip(x);
        for (y, ((mean, half), x)) in self.forward.activations[0].iter_mut().zip(inputs) {
            let scaled = (x - mean) / half.max(f64::MIN_POSITIVE);
            // A network knows nothing outside of its data: the nearest seen input stands in.
            *y = scaled.clamp(-1.0, 1.0);
            outside = outside.max(scaled.abs() - 1.0);
        }
        outside.max(0.0)
    }
}

impl JointTorqueEstimator for NetworkEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        if !Output::usable(sample) {
            return self.output.held();
        }
        let p = &self.parameters;
        // Bounded so that one wild sample is forgotten again.
        let current = self.current.update(sample.current.clamp(-1e6, 1e6));
        let x = p.features.of(sample, current, p.gear_ratio);
        let outside = self.scale(&x);
        let y = self.forward.run();
        let p = &self.parameters;
        let tau = p.torque.0 + p.torque.1 * y;
        // Beyond the data the doubt grows with the distance, measured by the torque's own spread.
        self.output
            .give(sample, tau, p.sigma.hypot(p.torque.1 * outside.min(1e6)))
    }

    fn reset(&mut self) {
        let [q, r, p] = self.parameters.current_filter;
        self.current = ScalarKalman::new(q, r, p);
        self.output.reset();
    }
}
