//! Back-propagation network (S 28-46), as the loop runs it: forwards only, without allocation.

use crate::exponential::sigmoid;
use crate::features::{FeatureSet, MAX_FEATURES};
use crate::joint::{JointSample, JointTorqueEstimator};
use crate::low_pass::LowPass;
use crate::output::Output;
use crate::regimes::{Motion, Regimes};
use problem::Problem;
use robot_state::{TorqueEstimate, torque_source};
use simd::{Instructions, Kernel, Lanes, Pack, WIDTH};

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
        //= S32: P^- = P + Q
        //= S33: K = P^- / (P^- + R)
        //= S35: P = (1 - K) P^-
        //= S34: x = x^- + K (z - x^-)
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
    /// Inputs.
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
    /// Errors of the torque on data that the training did not see; gains are not used.
    pub regimes: Regimes,
    /// Pole of the torque's low-pass, 0 to below 1.
    pub low_pass_pole: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
}

/// Packs of outputs that are summed side by side, to hide the latency of each sum.
const GROUP: usize = 4;

/// Layers in one piece of memory, four outputs side by side.
#[derive(Debug, Clone)]
struct Forward {
    /// Per layer and group of its outputs: their biases, then their weights input by input.
    weights: Vec<Pack>,
    /// Inputs and blocks of four outputs of each layer.
    sizes: Vec<(usize, usize)>,
    activations: [Vec<Pack>; 2],
    instructions: Instructions,
}

impl Forward {
    fn new(inputs: usize, layers: &[Layer]) -> Result<Self, Problem> {
        let mut weights = Vec::new();
        let mut sizes = Vec::new();
        let mut width = inputs;
        for (i, layer) in layers.iter().enumerate() {
            let outputs = layer.bias.len();
            let fits = outputs == layer.weights.len() && outputs > 0;
            if !fits || layer.weights.iter().any(|row| row.len() != width) {
                let rows = layer.weights.len();
                let reason = format!("layer {i} has {rows} rows of weights and {outputs} biases");
                let allowed = format!("as many rows as biases, each of {width} weights");
                return Err(Problem::new(reason, allowed));
            }
            let pack = |first: usize, of: &dyn Fn(usize) -> f64| {
                let lane = |o: usize| if o < outputs { of(o) } else { 0.0 };
                Pack(std::array::from_fn(|l| lane(first + l)))
            };
            for group in (0..outputs).step_by(GROUP * WIDTH) {
                let firsts = (group..outputs.min(group + GROUP * WIDTH)).step_by(WIDTH);
                weights.extend(firsts.clone().map(|f| pack(f, &|o| layer.bias[o])));
                for input in 0..width {
                    let column = |first| pack(first, &|o| layer.weights[o][input]);
                    weights.extend(firsts.clone().map(column));
                }
            }
            sizes.push((width, outputs.div_ceil(WIDTH)));
            width = outputs;
        }
        if width != 1 || layers.is_empty() {
            let reason = format!("the last layer has {width} outputs");
            return Err(Problem::new(reason, "one output"));
        }
        if weights.iter().flat_map(|p| p.0).any(|w| !w.is_finite()) {
            let reason = "a weight is not finite";
            return Err(Problem::new(reason, "finite numbers"));
        }
        let widest = sizes.iter().fold(inputs.div_ceil(WIDTH), |w, s| w.max(s.1));
        let activations = [vec![Pack::ZERO; widest], vec![Pack::ZERO; widest]];
        Ok(Self {
            weights,
            sizes,
            activations,
            instructions: Instructions::detect(),
        })
    }

    fn run(&mut self) -> f64 {
        simd::run(self.instructions, Propagate(self))
    }
}

/// All layers, one after the other.
struct Propagate<'a>(&'a mut Forward);

impl Kernel for Propagate<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> f64 {
        let [from, to] = &mut self.0.activations;
        let mut weights = self.0.weights.as_slice();
        let last = self.0.sizes.len().saturating_sub(1);
        for (i, &(inputs, blocks)) in self.0.sizes.iter().enumerate() {
            let (layer, rest) = weights.split_at(blocks * (inputs + 1));
            weights = rest;
            let groups = layer.chunks(GROUP * (inputs + 1));
            for (group, y) in groups.zip(to[..blocks].chunks_mut(GROUP)) {
                match y.len() {
                    1 => group_of::<L, 1>(group, from, inputs, y, i == last),
                    2 => group_of::<L, 2>(group, from, inputs, y, i == last),
                    3 => group_of::<L, 3>(group, from, inputs, y, i == last),
                    _ => group_of::<L, GROUP>(group, from, inputs, y, i == last),
                }
            }
            std::mem::swap(from, to);
        }
        from.first().map_or(0.0, |pack| pack.0[0])
    }
}

/// `G` packs of a layer's outputs.
#[inline(always)]
fn group_of<L: Lanes, const G: usize>(
    weights: &[Pack],
    x: &[Pack],
    inputs: usize,
    y: &mut [Pack],
    last: bool,
) {
    let (columns, _) = weights.as_chunks::<G>();
    let Some((bias, columns)) = columns.split_first() else {
        return;
    };
    let mut sums: [L; G] = std::array::from_fn(|g| L::load(&bias[g]));
    for (columns, pack) in columns[..inputs].chunks(WIDTH).zip(x) {
        for (column, x) in columns.iter().zip(pack.0) {
            for (sum, weight) in sums.iter_mut().zip(column) {
                *sum = L::load(weight).mul_add(L::splat(x), *sum);
            }
        }
    }
    for (sum, y) in sums.into_iter().zip(y) {
        let out = if last { sum } else { sigmoid(sum) };
        out.store(y);
    }
}

/// S's network as an estimator.
#[derive(Debug, Clone)]
pub struct NetworkEstimator {
    parameters: NetworkParameters,
    /// Per input: its mean and 1 over half of its range.
    scales: [(f64, f64); MAX_FEATURES],
    forward: Forward,
    current: ScalarKalman,
    low_pass: LowPass,
    motion: Motion,
    output: Output,
}

impl NetworkEstimator {
    /// A network that has seen no sample.
    ///
    /// # Errors
    /// Layers whose sizes do not fit together, or numbers that are not finite.
    pub fn new(parameters: NetworkParameters) -> Result<Self, Problem> {
        let inputs = parameters.features.len();
        if parameters.inputs.len() != inputs {
            let reason = format!("network: {} inputs are scaled", parameters.inputs.len());
            return Err(Problem::new(reason, inputs.to_string()));
        }
        let mut scales = [(0.0, 0.0); MAX_FEATURES];
        for (scale, (mean, half)) in scales.iter_mut().zip(&parameters.inputs) {
            if !(mean.is_finite() && half.is_finite() && *half > 0.0) {
                let reason = format!("network: an input is scaled by ({mean}, {half})");
                return Err(Problem::new(reason, "half ranges > 0"));
            }
            *scale = (*mean, 1.0 / half);
        }
        let [q, r, p] = parameters.current_filter;
        let low_pass = LowPass::new(parameters.low_pass_pole);
        let delay_s = low_pass.delay_samples() * parameters.regimes.sample_period;
        let output = Output::new(torque_source::ENCODER, parameters.torque_limit, delay_s);
        Ok(Self {
            scales,
            forward: Forward::new(inputs, &parameters.layers).map_err(|p| p.of("network"))?,
            current: ScalarKalman::new(q, r, p),
            low_pass,
            motion: Motion::default(),
            output,
            parameters,
        })
    }

    /// Scales the inputs; gives the largest distance of one outside its training range, in half ranges.
    fn scale(&mut self, x: &[f64; MAX_FEATURES]) -> f64 {
        let mut outside = 0.0f64;
        let to = self.forward.activations[0]
            .iter_mut()
            .flat_map(|pack| &mut pack.0);
        let inputs = self.scales.iter().zip(x).take(self.parameters.inputs.len());
        for (y, ((mean, per_half), x)) in to.zip(inputs) {
            let scaled = (x - mean) * per_half;
            // A network is undetermined outside its training data: the nearest input inside is used.
            *y = scaled.clamp(-1.0, 1.0);
            outside = outside.max(scaled.abs() - 1.0);
        }
        outside
    }
}

impl JointTorqueEstimator for NetworkEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        if !Output::usable(sample) {
            return self.output.held();
        }
        let p = &self.parameters;
        let known = p.regimes.mix(self.motion.update(sample, &p.regimes)).sigma;
        // Bounded so that the effect of one outlier decays.
        let current = self.current.update(sample.current.clamp(-1e6, 1e6));
        let x = p.features.of(sample, current, p.gear_ratio);
        let outside = self.scale(&x);
        let y = self.forward.run();
        let p = &self.parameters;
        let tau = self.low_pass.update(p.torque.0 + p.torque.1 * y);
        // Beyond the data the standard deviation grows with the distance, scaled by the torque's.
        self.output
            .give(sample, tau, known.hypot(p.torque.1 * outside.min(1e6)))
    }

    fn reset(&mut self) {
        let [q, r, p] = self.parameters.current_filter;
        self.current = ScalarKalman::new(q, r, p);
        self.low_pass.reset();
        self.motion = Motion::default();
        self.output.reset();
    }
}
