//! Many samples into few models of few points (G 13).
//!
//! A point joins the most similar centre or founds a new one below a threshold; the threshold is
//! the one that leads to the number of models asked for. In each model each further point
//! is the sample of the largest variance given the points before it; every other sample then goes
//! to the point nearest to it, which represents their mean, with less noise the more there are.

use super::{GpOptions, HyperParameters};
use estimators::features::MAX_FEATURES;
use estimators::local_gp::{LocalModel, MAX_SAMPLES_PER_POINT, MIN_RELATIVE_WEIGHT};

/// One sample: scaled inputs, residual, its place in the log.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) x: [f64; MAX_FEATURES],
    pub(super) y: f64,
    pub(super) index: usize,
}

/// Samples from which centres are chosen, at most.
const CENTRE_SAMPLES: usize = 20_000;
/// Samples of a model from which points are chosen, at most.
const POINT_SAMPLES: usize = 3_000;
/// Time between samples of independent residuals, s: from one sample to the next the residual hardly
/// changes.
const INDEPENDENT_S: f64 = 0.05;
/// Largest variance left, over the noise's, at which no more points are added.
const MIN_VARIANCE_OVER_NOISE: f64 = 1e-3;

fn square(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

fn nearest<'a>(
    x: &[f64; MAX_FEATURES],
    to: impl Iterator<Item = &'a [f64; MAX_FEATURES]>,
) -> Option<(usize, f64)> {
    to.map(|c| square(x, c))
        .enumerate()
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Models of the samples.
pub(super) fn models(
    samples: &[Sample],
    options: &GpOptions,
    hyper: &HyperParameters,
    sample_period: f64,
) -> Vec<LocalModel> {
    let centres = centres(samples, options.models);
    let mut members: Vec<Vec<Sample>> = vec![Vec::new(); centres.len()];
    // The least relative weight as a difference of squared distances.
    let neighbour = -2.0 * MIN_RELATIVE_WEIGHT.ln();
    let mut away = vec![0.0; centres.len()];
    for sample in samples {
        for (away, centre) in away.iter_mut().zip(&centres) {
            *away = square(&sample.x, centre);
        }
        let nearest = away.iter().fold(f64::MAX, |m, a| m.min(*a));
        for (members, away) in members.iter_mut().zip(&away) {
            if *away <= nearest + neighbour {
                members.push(*sample);
            }
        }
    }
    let apart = ((INDEPENDENT_S / sample_period) as usize).max(1);
    let dimensions = options.features.len();
    members
        .iter()
        .zip(&centres)
        .filter(|(members, _)| !members.is_empty())
        .map(|(members, centre)| {
            let chosen = points_of_largest_variance(members, options.points, hyper);
            gathered(centre, members, &chosen, dimensions, hyper, apart)
        })
        .collect()
}

/// At most `max` centres, and as many as a threshold on similarity can make.
fn centres(samples: &[Sample], max: usize) -> Vec<[f64; MAX_FEATURES]> {
    let step = samples.len().div_ceil(CENTRE_SAMPLES).max(1);
    let few: Vec<&Sample> = samples.iter().step_by(step).collect();
    // The threshold as a distance: similarity falls with it.
    let (mut near, mut far) = (0.0, 100.0);
    let mut best = found(&few, far, usize::MAX);
    for _ in 0..25 {
        let middle = 0.5 * (near + far);
        let made = found(&few, middle, max);
        if made.len() > max {
            near = middle;
        } else {
            far = middle;
            best = made;
        }
    }
    best
}

/// Centres that lie further than `distance` from each other; stops beyond `max`.
fn found(samples: &[&Sample], distance: f64, max: usize) -> Vec<[f64; MAX_FEATURES]> {
    let mut centres: Vec<[f64; MAX_FEATURES]> = Vec::new();
    let mut counts: Vec<f64> = Vec::new();
    for sample in samples {
        //= G13: a point joins the centre of the largest w_k, or founds one below a threshold
        match nearest(&sample.x, centres.iter()) {
            Some((i, square)) if square <= distance * distance => {
                counts[i] += 1.0;
                for (c, x) in centres[i].iter_mut().zip(&sample.x) {
                    *c += (x - *c) / counts[i];
                }
            }
            _ => {
                centres.push(sample.x);
                counts.push(1.0);
                if centres.len() > max {
                    break;
                }
            }
        }
    }
    centres
}

/// Samples as points: each of the largest variance given those before it.
fn points_of_largest_variance(
    members: &[Sample],
    max: usize,
    hyper: &HyperParameters,
) -> Vec<[f64; MAX_FEATURES]> {
    let step = members.len().div_ceil(POINT_SAMPLES).max(1);
    let from: Vec<&Sample> = members.iter().step_by(step).collect();
    let mut left = vec![1.0f64; from.len()];
    // Rows of the incomplete Cholesky factor, in units of the signal's variance.
    let mut rows: Vec<Vec<f64>> = Vec::new();
    let mut chosen = Vec::new();
    let enough = MIN_VARIANCE_OVER_NOISE * hyper.noise_variance / hyper.signal_variance;
    while chosen.len() < max {
        let best = (0..from.len()).max_by(|&i, &j| left[i].total_cmp(&left[j]));
        let Some(pivot) = best.filter(|&i| left[i] > enough.max(1e-9)) else {
            break;
        };
        let root = left[pivot].sqrt();
        let mut row: Vec<f64> = from
            .iter()
            .map(|s| (-0.5 * square(&s.x, &from[pivot].x)).exp())
            .collect();
        for earlier in &rows {
            let factor = earlier[pivot];
            row.iter_mut()
                .zip(earlier)
                .for_each(|(r, e)| *r -= factor * e);
        }
        for (left, r) in left.iter_mut().zip(&mut row) {
            *r /= root;
            *left -= *r * *r;
        }
        left[pivot] = 0.0;
        chosen.push(from[pivot].x);
        rows.push(row);
    }
    chosen
}

/// Each point with the mean of the samples nearest to it.
fn gathered(
    centre: &[f64; MAX_FEATURES],
    members: &[Sample],
    chosen: &[[f64; MAX_FEATURES]],
    dimensions: usize,
    hyper: &HyperParameters,
    apart: usize,
) -> LocalModel {
    #[derive(Clone, Copy, Default)]
    struct Cell {
        count: f64,
        independent: f64,
        x: [f64; MAX_FEATURES],
        y: f64,
        counted: Option<usize>,
    }
    let mut cells = vec![Cell::default(); chosen.len()];
    for sample in members {
        let Some((i, _)) = nearest(&sample.x, chosen.iter()) else {
            continue;
        };
        let cell = &mut cells[i];
        cell.count += 1.0;
        cell.y += (sample.y - cell.y) / cell.count;
        for (mean, x) in cell.x.iter_mut().zip(&sample.x) {
            *mean += (x - *mean) / cell.count;
        }
        if cell.counted.is_none_or(|last| sample.index >= last + apart) {
            cell.independent += 1.0;
            cell.counted = Some(sample.index);
        }
    }
    cells.retain(|cell| cell.count > 0.0);
    LocalModel {
        centre: centre[..dimensions].to_vec(),
        points: cells
            .iter()
            .flat_map(|c| c.x[..dimensions].to_vec())
            .collect(),
        residuals: cells.iter().map(|c| c.y).collect(),
        noise: cells
            .iter()
            .map(|c| hyper.noise_variance / c.independent.min(MAX_SAMPLES_PER_POINT))
            .collect(),
    }
}
