//! Learns on, sample by sample, off the loop's thread.

use super::prepare::{diagonal, factored, kernel, prepare};
use super::{
    Factor, LocalGp, LocalGpError, LocalGpParameters, LocalModel, MAX_MODELS, MAX_POINTS,
    NEIGHBOUR, SUREST,
};
use crate::features::MAX_FEATURES;
use nalgebra::DMatrix;

/// What became of a sample in the model nearest to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Learned {
    /// It joined a point of the nearest model that is so near that it tells nothing new.
    Merged,
    /// It became a point of the nearest model.
    Appended,
    /// It became a point in place of the one that told least.
    Replaced,
    /// It founded a model.
    Founded,
    /// It told less than every point of a full model, or was not a number.
    Dropped,
}

/// Local models that learn, and their hand-over to the loop.
pub struct LocalGpUpdater {
    parameters: LocalGpParameters,
    /// Factor of K + D of each model, and whether the model changed since it was last prepared.
    factors: Vec<(Factor, bool)>,
    prepared: LocalGp,
    most_points: usize,
    similarity: f64,
    hand_over: triple_buffer::Input<LocalGp>,
}

impl LocalGpUpdater {
    /// Goes on from trained models, with at most `most_points` each; a sample whose similarity to
    /// every centre (G13) is below `similarity` founds a new one. The second part is for
    /// [`super::LocalGpEstimator::learning`].
    ///
    /// # Errors
    /// As [`LocalGp::new`].
    pub fn new(
        parameters: LocalGpParameters,
        most_points: usize,
        similarity: f64,
    ) -> Result<(Self, triple_buffer::Output<LocalGp>), LocalGpError> {
        let prepared = LocalGp::new(&parameters)?;
        let factor = |model| factored(&parameters, model).map(|(_, factor)| (factor, false));
        let factors = parameters
            .models
            .iter()
            .map(factor)
            .collect::<Result<_, _>>()?;
        let (hand_over, output) = triple_buffer::triple_buffer(&prepared);
        let updater = Self {
            factors,
            prepared,
            most_points: most_points.clamp(1, MAX_POINTS),
            similarity,
            hand_over,
            parameters,
        };
        Ok((updater, output))
    }

    /// The models as they are now.
    #[must_use]
    pub fn parameters(&self) -> &LocalGpParameters {
        &self.parameters
    }

    /// Each model's factor of K + D.
    pub fn factors(&self) -> impl Iterator<Item = &Factor> {
        self.factors.iter().map(|(factor, _)| factor)
    }

    /// Learns from one sample: inputs of the parameters' feature set, and the residual there, N·m.
    pub fn learn(&mut self, inputs: &[f64; MAX_FEATURES], residual: f64) -> Learned {
        let d = self.parameters.features.len();
        let mut x = [0.0; MAX_FEATURES];
        for ((x, raw), (mean, width)) in x.iter_mut().zip(inputs).zip(&self.parameters.inputs) {
            *x = (raw - mean) / width;
        }
        let x = &x[..d];
        if !(residual.is_finite() && x.iter().all(|x| x.abs() < 1e9)) {
            return Learned::Dropped;
        }
        //= G13
        let models = self.parameters.models.iter();
        let similar: Vec<f64> = models
            .map(|m| kernel(&self.parameters, &m.centre, x))
            .collect();
        let by_similarity = |a: &usize, b: &usize| similar[*a].total_cmp(&similar[*b]);
        let nearest = (0..similar.len()).max_by(by_similarity);
        let threshold = self.similarity * self.parameters.signal_variance;
        let room = similar.len() < MAX_MODELS;
        match nearest {
            Some(nearest) if similar[nearest] >= threshold || !room => {
                let neighbour =
                    |i: &usize| *i != nearest && similar[*i] >= NEIGHBOUR * similar[nearest];
                for i in (0..similar.len()).filter(neighbour) {
                    self.learn_in(i, x, residual);
                }
                self.learn_in(nearest, x, residual)
            }
            None if !room => Learned::Dropped,
            _ => {
                let model = LocalModel {
                    centre: x.to_vec(),
                    ..LocalModel::default()
                };
                self.parameters.models.push(model);
                self.factors.push((Factor::default(), true));
                let i = self.factors.len() - 1;
                self.append(i, x, residual, self.parameters.noise_variance);
                Learned::Founded
            }
        }
    }

    fn learn_in(&mut self, i: usize, x: &[f64], residual: f64) -> Learned {
        let p = &self.parameters;
        let noise = p.noise_variance;
        let points = p.models[i].points.chunks_exact(x.len());
        let beside: Vec<f64> = points.map(|point| kernel(p, point, x)).collect();
        let mut along = beside.clone();
        self.factors[i].0.solve_lower(&mut along);
        let novelty = p.signal_variance - along.iter().map(|v| v * v).sum::<f64>();
        let by_kernel = |a: &usize, b: &usize| beside[*a].total_cmp(&beside[*b]);
        let closest = (0..beside.len()).max_by(by_kernel);
        // Within a hundredth of the variance of the same point: they are one.
        let same = closest.filter(|&j| beside[j] > 0.99 * p.signal_variance);
        if let Some(j) = same {
            return self.merge(i, j, residual);
        }
        if beside.len() < self.most_points {
            self.append(i, x, residual, noise);
            return Learned::Appended;
        }
        let (least, told) = self.least_telling(i);
        if novelty <= told {
            return match closest {
                Some(j) if beside[j] > 0.9 * self.parameters.signal_variance => {
                    self.merge(i, j, residual)
                }
                _ => Learned::Dropped,
            };
        }
        self.take_out(i, least);
        self.append(i, x, residual, noise);
        Learned::Replaced
    }

    /// A point and a sample beside it: their mean, weighted by their variances. No point becomes
    /// surer than [`SUREST`] samples, so that what changes is followed.
    fn merge(&mut self, i: usize, j: usize, residual: f64) -> Learned {
        let (model, fresh) = (&self.parameters.models[i], self.parameters.noise_variance);
        let d = self.parameters.features.len();
        let (known, old) = (model.noise[j], model.residuals[j]);
        let noise = (known * fresh / (known + fresh)).max(fresh / SUREST);
        let residual = old + noise / fresh * (residual - old);
        let x = model.points[j * d..(j + 1) * d].to_vec();
        self.take_out(i, j);
        self.append(i, &x, residual, noise);
        Learned::Merged
    }

    fn append(&mut self, i: usize, x: &[f64], residual: f64, noise: f64) {
        let p = &self.parameters;
        let points = p.models[i].points.chunks_exact(x.len());
        let beside: Vec<f64> = points.map(|point| kernel(p, point, x)).collect();
        let own = diagonal(p, noise);
        let (factor, changed) = &mut self.factors[i];
        if !factor.push(&beside, own) {
            return;
        }
        *changed = true;
        let model = &mut self.parameters.models[i];
        model.points.extend_from_slice(x);
        model.residuals.push(residual);
        model.noise.push(noise);
    }

    fn take_out(&mut self, i: usize, j: usize) {
        let d = self.parameters.features.len();
        let model = &mut self.parameters.models[i];
        model.points.drain(j * d..(j + 1) * d);
        model.residuals.remove(j);
        model.noise.remove(j);
        self.factors[i].0.remove(j);
        self.factors[i].1 = true;
    }

    /// The point that the others of its model tell best, and what variance they would leave at it:
    /// one over its entry in the inverse's diagonal, less its own noise.
    fn least_telling(&self, i: usize) -> (usize, f64) {
        let (factor, model) = (&self.factors[i].0, &self.parameters.models[i]);
        let mut best = (0, f64::INFINITY);
        let mut column = Vec::with_capacity(factor.size());
        let mut inverse = vec![0.0; factor.size()];
        // The inverse's diagonal is the sum of squares of each column of L^-1.
        for (j, sum) in inverse.iter_mut().enumerate() {
            column.clear();
            column.resize(factor.size(), 0.0);
            column[j] = 1.0;
            factor.solve_lower(&mut column);
            *sum = column[j..].iter().map(|x| x * x).sum();
        }
        for (j, inverse) in inverse.iter().enumerate() {
            let told = 1.0 / inverse - model.noise[j];
            if told < best.1 {
                best = (j, told);
            }
        }
        best
    }

    /// Prepares the models that changed and hands a finished set over to the loop.
    pub fn publish(&mut self) {
        let p = &self.parameters;
        let d = p.features.len();
        for (i, (factor, changed)) in self.factors.iter_mut().enumerate() {
            if !std::mem::take(changed) {
                continue;
            }
            let model = &p.models[i];
            let point = |j: usize| &model.points[j * d..(j + 1) * d];
            let n = factor.size();
            let a = DMatrix::from_fn(n, n, |r, c| match r == c {
                true => diagonal(p, model.noise[r]),
                false => kernel(p, point(r), point(c)),
            });
            self.prepared.put(i, prepare(p, model, &a, factor));
        }
        self.hand_over.write(self.prepared.clone());
    }
}
