//! A multi-layer perceptron with its error's gradient (S 36-46).

use estimators::network::Layer;
use nalgebra::{DMatrix, DMatrixView, DMatrixViewMut};

/// Samples that go through the network side by side.
const SIDE_BY_SIDE: usize = 256;

/// Sigmoid hidden layers, one linear output; all weights in one row.
#[derive(Debug, Clone)]
pub(super) struct Perceptron {
    /// Inputs and outputs of each layer.
    sizes: Vec<(usize, usize)>,
    /// Layer by layer: weights column by column (outputs by inputs), then biases.
    weights: Vec<f64>,
}

impl Perceptron {
    /// Random weights of a size that leaves signals as large as they are (Glorot and Bengio 2010).
    pub(super) fn new(inputs: usize, hidden: &[usize], seed: u64) -> Self {
        let mut random = Random::new(seed);
        let mut sizes = Vec::new();
        let mut weights = Vec::new();
        let mut width = inputs;
        for &outputs in hidden.iter().chain(&[1]) {
            // Four times: the sigmoid's slope is a quarter.
            let bound = 4.0 * (6.0 / (width + outputs) as f64).sqrt();
            weights.extend((0..width * outputs).map(|_| bound * random.symmetric()));
            weights.extend(std::iter::repeat_n(0.0, outputs));
            sizes.push((width, outputs));
            width = outputs;
        }
        Self { sizes, weights }
    }

    pub(super) fn weights(&self) -> &[f64] {
        &self.weights
    }

    pub(super) fn weights_mut(&mut self) -> &mut [f64] {
        &mut self.weights
    }

    /// Layers as the estimator has them.
    pub(super) fn layers(&self) -> Vec<Layer> {
        let mut start = 0;
        let layer = |&(inputs, outputs): &(usize, usize)| {
            let at = start;
            start += outputs * (inputs + 1);
            let row = |o: usize| (0..inputs).map(move |i| self.weights[at + i * outputs + o]);
            Layer {
                weights: (0..outputs).map(|o| row(o).collect()).collect(),
                bias: self.weights[at + inputs * outputs..start].to_vec(),
            }
        };
        self.sizes.iter().map(layer).collect()
    }

    /// Activations of every layer, the inputs first.
    fn forward(&self, x: DMatrixView<'_, f64>) -> Vec<DMatrix<f64>> {
        let mut activations = vec![x.clone_owned()];
        let mut start = 0;
        for (l, &(inputs, outputs)) in self.sizes.iter().enumerate() {
            let (w, b) = self.weights[start..].split_at(inputs * outputs);
            let w = DMatrixView::from_slice(w, outputs, inputs);
            let mut z = DMatrix::from_fn(outputs, x.ncols(), |o, _| b[o]);
            z.gemm(1.0, &w, &activations[l], 1.0);
            if l + 1 < self.sizes.len() {
                z.apply(|z| *z = 1.0 / (1.0 + (-*z).exp()));
            }
            activations.push(z);
            start += outputs * (inputs + 1);
        }
        activations
    }
}

/// Samples: inputs in columns, and target outputs.
#[derive(Debug, Clone)]
pub(super) struct Batch {
    inputs: DMatrix<f64>,
    targets: Vec<f64>,
}

impl Batch {
    pub(super) fn new(samples: impl Iterator<Item = (Vec<f64>, f64)>) -> Self {
        let (inputs, targets): (Vec<_>, Vec<f64>) = samples.unzip();
        let rows = inputs.first().map_or(0, Vec::len);
        Self {
            inputs: DMatrix::from_iterator(rows, targets.len(), inputs.into_iter().flatten()),
            targets,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.targets.len()
    }

    /// Some of the samples.
    pub(super) fn select(&self, which: &[usize]) -> Self {
        Self {
            inputs: self.inputs.select_columns(which),
            targets: which.iter().map(|&i| self.targets[i]).collect(),
        }
    }

    fn side_by_side(&self) -> impl Iterator<Item = (DMatrixView<'_, f64>, &[f64])> {
        (0..self.len()).step_by(SIDE_BY_SIDE).map(|start| {
            let count = SIDE_BY_SIDE.min(self.len() - start);
            let targets = &self.targets[start..start + count];
            (self.inputs.columns(start, count), targets)
        })
    }

    /// Root mean square error.
    pub(super) fn rms(&self, network: &Perceptron) -> f64 {
        let square: f64 = self
            .side_by_side()
            .map(|(x, targets)| {
                let outputs = network.forward(x).pop().unwrap_or_default();
                let errors = outputs.iter().zip(targets).map(|(y, t)| (y - t).powi(2));
                errors.sum::<f64>()
            })
            .sum();
        (square / self.len().max(1) as f64).sqrt()
    }

    /// Half of the mean square error and its gradient.
    pub(super) fn gradient(&self, network: &Perceptron) -> (f64, Vec<f64>) {
        let mut gradient = vec![0.0; network.weights.len()];
        let mut value = 0.0;
        let per_sample = 1.0 / self.len().max(1) as f64;
        for (x, targets) in self.side_by_side() {
            let activations = network.forward(x);
            let mut delta = activations[activations.len() - 1].clone();
            for (y, t) in delta.iter_mut().zip(targets) {
                *y -= t;
                value += 0.5 * per_sample * *y * *y;
                *y *= per_sample;
            }
            let mut end = network.weights.len();
            for (l, &(inputs, outputs)) in network.sizes.iter().enumerate().rev() {
                let start = end - outputs * (inputs + 1);
                let (dw, db) = gradient[start..end].split_at_mut(inputs * outputs);
                //= S43-44: dE/dw_ih = delta_h x_i
                DMatrixViewMut::from_slice(dw, outputs, inputs).gemm(
                    1.0,
                    &delta,
                    &activations[l].transpose(),
                    1.0,
                );
                for column in delta.column_iter() {
                    db.iter_mut().zip(column.iter()).for_each(|(b, d)| *b += d);
                }
                if l > 0 {
                    let w = &network.weights[start..start + inputs * outputs];
                    let w = DMatrixView::from_slice(w, outputs, inputs);
                    let mut back = w.tr_mul(&delta);
                    for (d, a) in back.iter_mut().zip(activations[l].iter()) {
                        *d *= a * (1.0 - a);
                    }
                    delta = back;
                }
                end = start;
            }
        }
        (value, gradient)
    }
}

/// Random numbers that a seed repeats (SplitMix64).
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Between -1 and 1.
    fn symmetric(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// Another order, each equally likely.
    pub(super) fn shuffle(&mut self, order: &mut [usize]) {
        for i in (1..order.len()).rev() {
            let j = (self.next() % (i as u64 + 1)) as usize;
            order.swap(i, j);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Batch, Perceptron, Random};

    #[test]
    fn gradient_is_the_slope() {
        let mut random = Random::new(3);
        let samples: Vec<_> = (0..700)
            .map(|_| {
                let x: Vec<f64> = (0..3).map(|_| random.symmetric()).collect();
                let y = x[0] * x[1] + x[2].sin();
                (x, y)
            })
            .collect();
        let batch = Batch::new(samples.into_iter());
        let network = Perceptron::new(3, &[5, 4], 7);
        let (_, gradient) = batch.gradient(&network);
        let h = 1e-6;
        for (i, gradient) in gradient.iter().enumerate() {
            let at = |h: f64| {
                let mut moved = network.clone();
                moved.weights_mut()[i] += h;
                0.5 * batch.rms(&moved).powi(2)
            };
            let slope = (at(h) - at(-h)) / (2.0 * h);
            assert!((slope - gradient).abs() < 1e-8, "{slope} {gradient}");
        }
    }
}
