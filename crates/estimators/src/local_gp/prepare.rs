//! From points to the terms of a prediction: weights of the mean, directions of the variance, bound.

use super::evaluate::{Columns, Points, SINGLE_ERROR};
use super::factor::Factor;
use super::sparsify::{part, sparsify};
use super::{LocalGp, LocalGpParameters, LocalModel, MAX_MODELS, MAX_POINTS, Prepared};
use crate::features::MAX_FEATURES;
use nalgebra::DMatrix;
use problem::{Allowed, Problem};
use simd::{Instructions, Pack, SINGLE_WIDTH, SinglePack, WIDTH};

/// Least noise of a point over the signal's variance, so that a model can be factored.
const MIN_RELATIVE_NOISE: f64 = 1e-8;

/// Part of a sample's noise by which one model may make the variance too large.
const NEGLIGIBLE_NOISE: f64 = 0.01;

impl LocalGp {
    /// Prepares the models.
    ///
    /// # Errors
    /// Sizes that do not fit together, numbers that are not allowed, too many models or points.
    pub fn new(parameters: &LocalGpParameters) -> Result<Self, Problem> {
        check(parameters).map_err(|p| p.of("local Gaussian processes"))?;
        let mut scales = [(0.0, 0.0); MAX_FEATURES];
        for (scale, (mean, width)) in scales.iter_mut().zip(&parameters.inputs) {
            *scale = (*mean, 1.0 / width);
        }
        let models = parameters.models.iter().map(|model| {
            let (kernel, factor) = factored(parameters, model)?;
            Ok(prepare(parameters, model, &kernel, &factor))
        });
        Ok(Self {
            features: parameters.features,
            scales,
            signal_variance: parameters.signal_variance,
            tolerance: parameters.tolerance,
            regimes: parameters.regimes,
            gear_ratio: parameters.gear_ratio,
            models: models.collect::<Result<_, Problem>>()?,
            negligible_variance: NEGLIGIBLE_NOISE * parameters.noise_variance,
            instructions: Instructions::detect(),
        })
    }
}

fn check(p: &LocalGpParameters) -> Result<(), Problem> {
    let fail = |reason: String, allowed: &str| Err(Problem::new(reason, allowed));
    let d = p.features.len();
    if p.inputs.len() != d {
        return fail(
            format!("{} inputs are scaled", p.inputs.len()),
            &d.to_string(),
        );
    }
    let positive = |x: f64| Allowed::Positive.admits(x);
    if let Some((mean, width)) = p
        .inputs
        .iter()
        .find(|i| !(i.0.is_finite() && positive(i.1)))
    {
        return fail(
            format!("an input is scaled by ({mean}, {width})"),
            "widths > 0",
        );
    }
    for (name, value, allowed) in [
        ("signal variance", p.signal_variance, Allowed::Positive),
        ("noise variance", p.noise_variance, Allowed::Positive),
        ("gear ratio", p.gear_ratio, Allowed::Positive),
        ("tolerance", p.tolerance, Allowed::NonNegative),
    ] {
        if !allowed.admits(value) {
            return fail(format!("{name} is {value}"), &allowed.to_string());
        }
    }
    let count = p.models.len();
    if count > MAX_MODELS {
        return fail(format!("{count} models"), &format!("at most {MAX_MODELS}"));
    }
    for (i, m) in p.models.iter().enumerate() {
        let n = m.residuals.len();
        if n > MAX_POINTS {
            let allowed = format!("at most {MAX_POINTS}");
            return fail(format!("model {i} has {n} points"), &allowed);
        }
        if m.centre.len() != d || m.points.len() != n * d || m.noise.len() != n {
            let (centre, points, noise) = (m.centre.len(), m.points.len(), m.noise.len());
            return fail(
                format!(
                    "model {i} has {centre}, {points} and {noise} numbers in its centre, {n} points and noise"
                ),
                &format!("{d}, {} and {n}", n * d),
            );
        }
        let mut numbers = m.centre.iter().chain(&m.points).chain(&m.residuals);
        if !numbers.all(|x| x.is_finite()) || m.noise.iter().any(|x| !positive(*x)) {
            return fail(format!("numbers of model {i}"), "finite numbers, noise > 0");
        }
    }
    Ok(())
}

/// sigma_f² times the Gaussian kernel of two scaled points (G9).
fn kernel(p: &LocalGpParameters, a: &[f64], b: &[f64]) -> f64 {
    let square: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    p.signal_variance * (-0.5 * square).exp()
}

/// A point's own variance in K + D.
fn diagonal(p: &LocalGpParameters, noise: f64) -> f64 {
    p.signal_variance + noise.max(MIN_RELATIVE_NOISE * p.signal_variance)
}

/// K + D of a model's points, and its factor.
fn factored(p: &LocalGpParameters, model: &LocalModel) -> Result<(DMatrix<f64>, Factor), Problem> {
    let points: Vec<&[f64]> = model.points.chunks_exact(p.features.len()).collect();
    let n = points.len();
    let mut a = DMatrix::zeros(n, n);
    let mut factor = Factor::default();
    let mut column = Vec::with_capacity(n);
    for i in 0..n {
        column.clear();
        for j in 0..i {
            let k = kernel(p, points[i], points[j]);
            (a[(i, j)], a[(j, i)]) = (k, k);
            column.push(k);
        }
        a[(i, i)] = diagonal(p, model.noise[i]);
        if !factor.push(&column, a[(i, i)]) {
            let reason = format!("point {i} of a model cannot be factored");
            return Err(Problem::new(reason, "points that differ, or more noise"));
        }
    }
    Ok((a, factor))
}

/// Weights, directions and bound of a model with matrix `a` = K + D.
fn prepare(
    p: &LocalGpParameters,
    model: &LocalModel,
    a: &DMatrix<f64>,
    factor: &Factor,
) -> Prepared {
    let d = p.features.len();
    let n = model.residuals.len();
    //= G11: alpha = (K + sigma_n^2 I)^-1 y
    let mut alpha = model.residuals.clone();
    factor.solve(&mut alpha);
    // |mean(x)| = |<m, k(x, .)>| <= |m| sigma_f in the kernel's own space, |m|² = alpha' K alpha,
    // and K alpha = y - D alpha.
    let norm: f64 = (0..n)
        .map(|i| {
            let noise = a[(i, i)] - p.signal_variance;
            alpha[i] * (model.residuals[i] - noise * alpha[i])
        })
        .sum();
    let mut centre = [0.0; MAX_FEATURES];
    centre[..d].copy_from_slice(&model.centre);
    let s = p.signal_variance;
    let sparse = sparsify(p, a, &alpha, 0.25 * p.tolerance)
        .and_then(|(chosen, weights)| part(a, &chosen).map(|part| (chosen, weights, part)));
    let (chosen, directions) = match sparse {
        Some((chosen, weights, (a, factor))) => {
            alpha = weights;
            (chosen, directions(&a, &factor, p.directions))
        }
        None => ((0..n).collect(), directions(a, factor, p.directions)),
    };
    let alpha: Vec<f64> = alpha.iter().map(|a| s * a).collect();
    let point = |i: usize| &model.points[chosen[i] * d..(chosen[i] + 1) * d];
    let count = chosen.len();
    let rows = |r: usize| -> Vec<f64> { (0..count).map(|i| s * directions[(r, i)]).collect() };
    let weight: f64 = alpha.iter().map(|a| a.abs()).sum();
    let points = if SINGLE_ERROR * weight <= 0.25 * p.tolerance {
        let inputs = |c: usize| (0..count).map(|i| point(i)[c] - centre[c]).collect();
        Points::Single(columns(
            d,
            &inputs,
            &alpha,
            directions.nrows(),
            &rows,
            &pack_single,
        ))
    } else {
        let inputs = |c: usize| (0..count).map(|i| point(i)[c]).collect();
        Points::Double(columns(
            d,
            &inputs,
            &alpha,
            directions.nrows(),
            &rows,
            &pack_double,
        ))
    };
    Prepared {
        centre,
        points,
        bound: (s * norm.max(0.0)).sqrt(),
    }
}

fn columns<P: Copy>(
    dimensions: usize,
    inputs: &dyn Fn(usize) -> Vec<f64>,
    alpha: &[f64],
    directions: usize,
    direction: &dyn Fn(usize) -> Vec<f64>,
    pack: &dyn Fn(&[f64]) -> Vec<P>,
) -> Columns<P> {
    let rows: Vec<Vec<P>> = (0..dimensions).map(|c| pack(&inputs(c))).collect();
    let alpha = pack(alpha);
    Columns {
        inputs: (0..alpha.len())
            .flat_map(|i| rows.iter().map(move |row| row[i]))
            .collect(),
        alpha,
        directions: (0..directions).flat_map(|r| pack(&direction(r))).collect(),
    }
}

fn pack_double(row: &[f64]) -> Vec<Pack> {
    let pack = |four: &[f64]| Pack(std::array::from_fn(|i| four.get(i).copied().unwrap_or(0.0)));
    row.chunks(WIDTH).map(pack).collect()
}

fn pack_single(row: &[f64]) -> Vec<SinglePack> {
    let lane = |eight: &[f64], i: usize| eight.get(i).map_or(0.0, |x| *x as f32);
    let pack = |eight: &[f64]| SinglePack(std::array::from_fn(|i| lane(eight, i)));
    row.chunks(SINGLE_WIDTH).map(pack).collect()
}

/// Rows u with `sum (u k)² <= k' A^-1 k` for any k, and equal if there are as many as points.
///
/// With fewer they span the subspace of the largest eigenvalues, nearly: whatever the subspace U,
/// `k' U (U' A U)^-1 U' k` is no more than `k' A^-1 k`, so the variance errs to the safe side.
fn directions(a: &DMatrix<f64>, factor: &Factor, most: usize) -> DMatrix<f64> {
    let n = a.nrows();
    if most >= n {
        // L^-1, column by column.
        let mut inverse = DMatrix::zeros(n, n);
        for (j, mut column) in inverse.column_iter_mut().enumerate() {
            column[j] = 1.0;
            factor.solve_lower(column.as_mut_slice());
        }
        return inverse;
    }
    if most == 0 {
        return DMatrix::zeros(0, n);
    }
    let mut u = a.select_columns(&pivots(a, most));
    for _ in 0..3 {
        u = a * u.qr().q();
    }
    let u = u.qr().q();
    let t = u.transpose() * a * &u;
    let Some(t) = t.cholesky() else {
        return DMatrix::zeros(0, n);
    };
    let mut rows = u.transpose();
    t.l_dirty().solve_lower_triangular_mut(&mut rows);
    rows
}

/// The columns that an incomplete Cholesky factorisation with pivoting takes first.
fn pivots(a: &DMatrix<f64>, count: usize) -> Vec<usize> {
    let n = a.nrows();
    let mut left: Vec<f64> = (0..n).map(|i| a[(i, i)]).collect();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    let mut pivots = Vec::new();
    for _ in 0..count {
        let best = (0..n).max_by(|&i, &j| left[i].total_cmp(&left[j]));
        let Some(pivot) = best.filter(|&i| left[i] > 0.0) else {
            break;
        };
        let root = left[pivot].sqrt();
        let row: Vec<f64> = (0..n)
            .map(|i| (a[(i, pivot)] - rows.iter().map(|r| r[i] * r[pivot]).sum::<f64>()) / root)
            .collect();
        for (left, r) in left.iter_mut().zip(&row) {
            *left -= r * r;
        }
        left[pivot] = 0.0;
        rows.push(row);
        pivots.push(pivot);
    }
    pivots
}
