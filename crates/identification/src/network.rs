//! Training of S's network by back-propagation (S 36-46).
//!
//! Mini-batches with Adam find the valley, a quasi-Newton method on all samples goes along it, and
//! the weights with the least held-out error are kept. The torque is zero-phase filtered: the network
//! would learn the delay of a delayed one.

mod back_propagation;

use crate::learned::{Judged, Progress, Use, judge, motion, of_use, uses, zero_phase};
use crate::quasi_newton::minimise;
use crate::record::Record;
use back_propagation::{Batch, Perceptron};
use estimators::features::FeatureSet;
use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::network::{NetworkEstimator, NetworkParameters, ScalarKalman};
use joint_file::TrainedNetwork;
use problem::Problem;

/// Options of the training.
#[derive(Debug, Clone, PartialEq)]
pub struct NetworkOptions {
    /// Inputs.
    pub features: FeatureSet,
    /// Units of each hidden layer.
    pub hidden: Vec<usize>,
    /// Q, R and P0 of the filter on the current, A².
    pub current_filter: [f64; 3],
    /// Pole of the torque's low-pass, 0 to below 1.
    pub low_pass_pole: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
    /// Samples used at most.
    pub max_samples: usize,
    /// Passes over the samples in mini-batches.
    pub epochs: usize,
    /// Quasi-Newton steps after that.
    pub steps: usize,
    /// Seed of weights and mini-batches.
    pub seed: u64,
}

impl NetworkOptions {
    /// Options that suit a joint of one revolute axis; `torque_limit` in N·m.
    #[must_use]
    pub fn new(torque_limit: f64) -> Self {
        Self {
            features: FeatureSet::Phase,
            hidden: vec![16, 16],
            current_filter: [0.05, 0.25, 0.01],
            low_pass_pole: 0.0,
            torque_limit,
            max_samples: 40_000,
            epochs: 40,
            steps: 600,
            seed: 1,
        }
    }
}

/// Samples in a mini-batch.
const MINI_BATCH: usize = 128;
/// Adam's rate at the start; it falls to a hundredth along half a cosine.
const RATE: f64 = 5e-3;
/// Quasi-Newton steps without a better held-out error after which training ends.
const PATIENCE: usize = 150;

/// Trains a network on loaded motion beside a torque sensor.
///
/// # Errors
/// A log without torque sensor, or too short to hold anything out.
pub fn train(
    record: &Record,
    options: &NetworkOptions,
    progress: Progress<'_>,
) -> Result<TrainedNetwork, Problem> {
    if options.hidden.is_empty() || options.hidden.contains(&0) || options.hidden.len() > 8 {
        let hidden = &options.hidden;
        return Err(Problem::new(
            format!("hidden layers {hidden:?}"),
            "1 to 8 layers of at least one unit",
        ));
    }
    let uses = uses(record);
    let tau = zero_phase(record, &record.tau);
    let inputs = Inputs::new(record, options, &uses);
    let train = of_use(&uses, Use::Train, options.max_samples);
    let held_out = of_use(&uses, Use::HeldOut, options.max_samples / 4);
    let needed = 10 * MINI_BATCH;
    if train.len() < needed || held_out.len() < MINI_BATCH {
        let count = train.len();
        return Err(Problem::new(
            format!("training log: {count} samples to train on"),
            format!("at least {needed} with a reference torque, over several seconds"),
        ));
    }
    let torque = mean_and_spread(train.iter().map(|&i| tau[i]));
    let target = |i: usize| (tau[i] - torque.0) / torque.1;
    let batch = |of: &[usize]| Batch::new(of.iter().map(|&i| (inputs.of(i), target(i))));
    let mut network = Perceptron::new(inputs.scales.len(), &options.hidden, options.seed);
    let (train, held_out_batch) = (batch(&train), batch(&held_out));
    let error = descend(&mut network, options, &train, &held_out_batch, progress);
    let (mut regimes, shares) = motion(record);
    let mut parameters = NetworkParameters {
        features: options.features,
        inputs: inputs.scales.clone(),
        torque,
        layers: network.layers(),
        regimes,
        low_pass_pole: options.low_pass_pole,
        current_filter: options.current_filter,
        gear_ratio: record.gear_ratio,
        torque_limit: options.torque_limit,
    };
    // With low-pass and delay, as the loop runs it.
    let mut estimator = NetworkEstimator::new(parameters.clone())?;
    let estimates: Vec<f64> = record
        .samples
        .iter()
        .map(|s| estimator.update(s).tau)
        .collect();
    let judged: Vec<Judged> = (0..uses.len())
        .filter(|&i| uses[i] == Use::HeldOut)
        .map(|i| (shares[i], estimates[i], record.tau[i]))
        .collect();
    regimes.rest = judge(&judged, false, Some(1.0), torque.1);
    regimes.moving = judge(&judged, true, Some(1.0), torque.1);
    parameters.regimes = regimes;
    Ok(TrainedNetwork {
        parameters,
        held_out_rms: torque.1 * error,
    })
}

/// Adam, then quasi-Newton; leaves the best on held-out data in `network`, gives its error.
fn descend(
    network: &mut Perceptron,
    options: &NetworkOptions,
    train: &Batch,
    held_out: &Batch,
    progress: Progress<'_>,
) -> f64 {
    let mut best = (held_out.rms(network), network.weights().to_vec());
    let mut keep = |network: &Perceptron| {
        let error = held_out.rms(network);
        let better = error < best.0;
        if better {
            best = (error, network.weights().to_vec());
        }
        (error, better)
    };
    let mut adam = Adam::new(network.weights().len());
    let mut order: Vec<usize> = (0..train.len()).collect();
    let mut random = back_propagation::Random::new(options.seed ^ 0x5eed);
    let batches = train.len() / MINI_BATCH;
    let all = (options.epochs + options.steps).max(1) as f64;
    for epoch in 0..options.epochs {
        random.shuffle(&mut order);
        for (number, batch) in order.chunks_exact(MINI_BATCH).enumerate() {
            let part = (epoch * batches + number) as f64 / (options.epochs * batches) as f64;
            let rate = RATE * (0.01 + 0.99 * 0.5 * (1.0 + (std::f64::consts::PI * part).cos()));
            let (_, gradient) = train.select(batch).gradient(network);
            adam.step(network.weights_mut(), &gradient, rate);
        }
        let (error, _) = keep(network);
        progress(
            epoch as f64 / all,
            &format!("network: held-out error {:.3} %", 100.0 * error),
        );
    }
    let mut trial = network.clone();
    let mut judged = network.clone();
    let mut since = 0;
    let mut x = network.weights().to_vec();
    minimise(
        &mut x,
        options.steps,
        1e-9,
        |x, gradient| {
            trial.weights_mut().copy_from_slice(x);
            let (value, there) = train.gradient(&trial);
            gradient.copy_from_slice(&there);
            value
        },
        |step, _, x| {
            judged.weights_mut().copy_from_slice(x);
            let (error, better) = keep(&judged);
            since = if better { 0 } else { since + 1 };
            let part = (options.epochs + step) as f64 / all;
            progress(
                part,
                &format!("network: held-out error {:.3} %", 100.0 * error),
            );
            since < PATIENCE
        },
    );
    network.weights_mut().copy_from_slice(&best.1);
    best.0
}

/// Adam (Kingma and Ba 2015).
struct Adam {
    mean: Vec<f64>,
    square: Vec<f64>,
    steps: i32,
}

impl Adam {
    fn new(count: usize) -> Self {
        Self {
            mean: vec![0.0; count],
            square: vec![0.0; count],
            steps: 0,
        }
    }

    fn step(&mut self, weights: &mut [f64], gradient: &[f64], rate: f64) {
        const MEAN: f64 = 0.9;
        const SQUARE: f64 = 0.999;
        self.steps += 1;
        let (m_bias, v_bias) = (1.0 - MEAN.powi(self.steps), 1.0 - SQUARE.powi(self.steps));
        let moments = self.mean.iter_mut().zip(&mut self.square);
        for ((w, g), (m, v)) in weights.iter_mut().zip(gradient).zip(moments) {
            *m += (1.0 - MEAN) * (g - *m);
            *v += (1.0 - SQUARE) * (g * g - *v);
            *w -= rate * (*m / m_bias) / ((*v / v_bias).sqrt() + 1e-8);
        }
    }
}

/// Inputs of every sample as the estimator forms them, and their scales.
struct Inputs<'a> {
    record: &'a Record,
    features: FeatureSet,
    current: Vec<f64>,
    /// Per input: its mean and half of its range.
    scales: Vec<(f64, f64)>,
}

impl<'a> Inputs<'a> {
    fn new(record: &'a Record, options: &NetworkOptions, uses: &[Use]) -> Self {
        let [q, r, p] = options.current_filter;
        let mut filter = ScalarKalman::new(q, r, p);
        let current = |s: &JointSample| filter.update(s.current);
        let mut inputs = Self {
            current: record.samples.iter().map(current).collect(),
            record,
            features: options.features,
            scales: Vec::new(),
        };
        let count = options.features.len();
        let mut ranges = vec![(f64::MAX, f64::MIN); count];
        for i in of_use(uses, Use::Train, usize::MAX) {
            for (range, x) in ranges.iter_mut().zip(inputs.raw(i)) {
                *range = (range.0.min(x), range.1.max(x));
            }
        }
        let scale = |(low, high): (f64, f64)| (0.5 * (low + high), (0.5 * (high - low)).max(1e-12));
        inputs.scales = ranges.into_iter().map(scale).collect();
        inputs
    }

    fn raw(&self, i: usize) -> impl Iterator<Item = f64> + use<> {
        let n = self.record.gear_ratio;
        let x = self
            .features
            .of(&self.record.samples[i], self.current[i], n);
        x.into_iter().take(self.features.len())
    }

    fn of(&self, i: usize) -> Vec<f64> {
        self.raw(i)
            .zip(&self.scales)
            .map(|(x, (mean, half))| (x - mean) / half)
            .collect()
    }
}

fn mean_and_spread(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut count, mut sum, mut square) = (0.0, 0.0, 0.0);
    for x in values {
        count += 1.0;
        sum += x;
        square += x * x;
    }
    let mean = sum / f64::max(count, 1.0);
    let variance: f64 = square / f64::max(count, 1.0) - mean * mean;
    (mean, variance.max(0.0).sqrt().max(1e-9))
}
