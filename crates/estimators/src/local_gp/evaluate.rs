//! One model's mean, and the reduction of the variance by its data, for points side by side.

use super::{MAX_POINTS, Prepared};
use crate::exponential::{exp, single_exp_of_minus_half};
use crate::features::MAX_FEATURES;
use simd::{Lanes, Pack, SINGLE_WIDTH, SingleLanes, SinglePack, WIDTH};

/// Error of the mean by single precision over the sum of |sigma_f² alpha|, at most: the
/// kernel's own error (5e-7), and as many roundings as packs of points.
pub(super) const SINGLE_ERROR: f64 = 3e-6;
/// Error of the explained variance by single precision, relative.
const SINGLE_VARIANCE: f64 = 1e-5;

/// Points with the weights of the mean and the directions of the variance, padded with points of
/// no weight.
#[derive(Debug, Clone)]
pub(super) enum Points {
    /// Exact to rounding.
    Double(Columns<Pack>),
    /// Within half of the tolerance, in less than half of the time; inputs are relative to the
    /// model's centre.
    Single(Columns<SinglePack>),
}

/// Packs of points.
#[derive(Debug, Clone)]
pub(super) struct Columns<P> {
    /// Pack by pack: each input of its points.
    pub(super) inputs: Vec<P>,
    /// sigma_f² alpha.
    pub(super) alpha: Vec<P>,
    /// sigma_f² times each direction, over the points.
    pub(super) directions: Vec<P>,
}

/// Room for the kernel between `x` and every point of a model.
pub(super) struct Room {
    double: [Pack; MAX_POINTS / WIDTH],
    single: [SinglePack; MAX_POINTS / SINGLE_WIDTH],
}

impl Room {
    pub(super) const EMPTY: Self = Self {
        double: [Pack::ZERO; MAX_POINTS / WIDTH],
        single: [SinglePack::ZERO; MAX_POINTS / SINGLE_WIDTH],
    };
}

impl Prepared {
    /// Mean at `x` (G11), and the reduction of the variance by the data (G12) if that `counts`,
    /// with `D` inputs.
    #[inline(always)]
    pub(super) fn evaluate<L: Lanes, const D: usize>(
        &self,
        x: &[f64; MAX_FEATURES],
        counts: bool,
        room: &mut Room,
    ) -> (f64, f64) {
        match &self.points {
            Points::Double(columns) => {
                let x = std::array::from_fn(|i| L::splat(x[i]));
                double::<L, D>(columns, x, counts, &mut room.double)
            }
            Points::Single(columns) => {
                let away = |i: usize| (x[i] - self.centre[i]) as f32;
                let x = std::array::from_fn(|i| L::Single::splat(away(i)));
                single::<L::Single, D>(columns, x, counts, &mut room.single)
            }
        }
    }
}

#[inline(always)]
fn double<L: Lanes, const D: usize>(
    columns: &Columns<Pack>,
    x: [L; D],
    counts: bool,
    room: &mut [Pack; MAX_POINTS / WIDTH],
) -> (f64, f64) {
    let sum = |lanes: L| lanes.to_array().iter().sum::<f64>();
    let mut mean = L::splat(0.0);
    let points = columns.inputs.as_chunks::<D>().0;
    for ((points, alpha), k) in points.iter().zip(&columns.alpha).zip(&mut *room) {
        let mut square = L::splat(0.0);
        for (column, x) in points.iter().zip(x) {
            let d = L::load(column) - x;
            square = d.mul_add(d, square);
        }
        //= G9: k(x, x_n) = sigma_f^2 exp(-1/2 |x - x_n|^2), inputs scaled by their widths
        let value = exp(L::splat(-0.5) * square);
        mean = value.mul_add(L::load(alpha), mean);
        value.store(k);
    }
    if !counts {
        return (sum(mean), 0.0);
    }
    //= G12: V(x) = k(x, x) - k' (K + sigma_n^2 I)^-1 k, along the directions that are kept
    let kernel = &room[..columns.alpha.len().min(MAX_POINTS / WIDTH)];
    let mut explained = 0.0;
    for direction in columns.directions.chunks_exact(kernel.len().max(1)) {
        let mut along = L::splat(0.0);
        for (u, k) in direction.iter().zip(kernel) {
            along = L::load(u).mul_add(L::load(k), along);
        }
        explained += sum(along).powi(2);
    }
    (sum(mean), explained)
}

#[inline(always)]
fn single<S: SingleLanes, const D: usize>(
    columns: &Columns<SinglePack>,
    x: [S; D],
    counts: bool,
    room: &mut [SinglePack; MAX_POINTS / SINGLE_WIDTH],
) -> (f64, f64) {
    let sum = |lanes: S| lanes.to_array().iter().map(|x| f64::from(*x)).sum::<f64>();
    let mut mean = S::splat(0.0);
    let points = columns.inputs.as_chunks::<D>().0;
    for ((points, alpha), k) in points.iter().zip(&columns.alpha).zip(&mut *room) {
        let mut square = S::splat(0.0);
        for (column, x) in points.iter().zip(x) {
            let d = S::load(column) - x;
            square = d.mul_add(d, square);
        }
        //= G9: k(x, x_n) = sigma_f^2 exp(-1/2 |x - x_n|^2), inputs scaled by their widths
        let value = single_exp_of_minus_half(square);
        mean = value.mul_add(S::load(alpha), mean);
        value.store(k);
    }
    if !counts {
        return (sum(mean), 0.0);
    }
    //= G12: V(x) = k(x, x) - k' (K + sigma_n^2 I)^-1 k, along the directions that are kept
    let kernel = &room[..columns.alpha.len().min(MAX_POINTS / SINGLE_WIDTH)];
    let mut explained = 0.0;
    let mut four = columns.directions.chunks_exact(4 * kernel.len().max(1));
    for directions in &mut four {
        // Four sums side by side: one alone would wait for itself.
        let (ab, cd) = directions.split_at(2 * kernel.len());
        let ((a, b), (c, d)) = (ab.split_at(kernel.len()), cd.split_at(kernel.len()));
        let mut sums = [S::splat(0.0); 4];
        for ((((k, a), b), c), d) in kernel.iter().zip(a).zip(b).zip(c).zip(d) {
            let k = S::load(k);
            for (sum, u) in sums.iter_mut().zip([a, b, c, d]) {
                *sum = S::load(u).mul_add(k, *sum);
            }
        }
        explained += sums.iter().map(|s| sum(*s).powi(2)).sum::<f64>();
    }
    for direction in four.remainder().chunks_exact(kernel.len().max(1)) {
        let mut along = S::splat(0.0);
        for (u, k) in direction.iter().zip(kernel) {
            along = S::load(u).mul_add(S::load(k), along);
        }
        explained += sum(along).powi(2);
    }
    (sum(mean), (1.0 - SINGLE_VARIANCE) * explained)
}
