//! Samples that no neighbour confirms: bits that were lost, registers read while they changed,
//! messages that were missed and filled with zeros.
//!
//! Each sample is compared with the median of a window about it (Hampel's filter). The scale is
//! the channel's own: what nine of ten samples stay below. A step stays, since the median
//! follows it; so does a curve, whose median lies on it.

use crate::statistics::{fill, quantile, span, steps};
use core::ops::Range;

/// Samples on either side of the window's middle.
const HALF_WINDOW: usize = 6;
/// Multiple of the ordinary distance from the median, and share of the channel's range, that a
/// bad sample exceeds.
const MIN_DISTANCE: f64 = 12.0;
const MIN_SHARE: f64 = 0.03;
/// Bad samples in a row at most, and where all are one value (zeros of missed messages): longer
/// ones are motion.
const MAX_RUN: usize = 2;
const MAX_EQUAL_RUN: usize = HALF_WINDOW;
/// Multiple of the ordinary steps that the step from a bad first or last sample exceeds.
const MIN_END_STEP: f64 = 20.0;
/// Share of the largest distance in a run from which a sample is bad itself.
const MIN_DEPTH: f64 = 0.3;
/// Share of a bad sample's distance that the steps into and out of it have.
const MIN_STEP: f64 = 0.5;

/// Rows whose value no neighbour confirms, in their order.
#[must_use]
pub fn spikes(values: &[f64]) -> Vec<usize> {
    let n = values.len();
    if n < 4 * HALF_WINDOW {
        return Vec::new();
    }
    let medians: Vec<f64> = (0..n).map(|k| median(values, k)).collect();
    let distance: Vec<f64> = values
        .iter()
        .zip(&medians)
        .map(|(x, m)| (x - m).abs())
        .collect();
    let bound =
        (MIN_DISTANCE * quantile(distance.clone(), 0.9)).max(MIN_SHARE * span(&medians).abs());
    let bad = |k: usize| distance[k] > bound && distance[k] > 0.0;
    let ordinary = quantile(steps(values), 0.95);
    let mut runs: Vec<(Range<usize>, f64)> = Vec::new();
    let mut from = 0;
    while from < n {
        if !bad(from) {
            from += 1;
            continue;
        }
        let start = from;
        let end = (start..n).find(|&k| !bad(k)).unwrap_or(n);
        let deepest = distance[start..end].iter().copied().fold(0.0, f64::max);
        // A step beside a bad sample moves the median, so that its neighbours seem bad too.
        let next = end;
        let deep = |k: &usize| distance[*k] > MIN_DEPTH * deepest;
        let (start, end) = match ((start..end).find(deep), (start..end).rfind(deep)) {
            (Some(first), Some(last)) => (first, last + 1),
            _ => (start, end),
        };
        let into = start
            .checked_sub(1)
            .map(|k| (values[start] - values[k]).abs());
        let out_of = values.get(end).map(|x| (x - values[end - 1]).abs());
        let abrupt = |step: Option<f64>| step.is_none_or(|s| s > MIN_STEP * deepest);
        let equal = values[start..end].windows(2).all(|w| w[0] == w[1]);
        let short = end - start <= if equal { MAX_EQUAL_RUN } else { MAX_RUN };
        // The window about a sample at an end is too short to judge by.
        let only = into
            .or(out_of)
            .filter(|_| into.is_none() || out_of.is_none());
        let at_end = only.is_none_or(|step| step > MIN_END_STEP * ordinary);
        if short && at_end && abrupt(into) && abrupt(out_of) {
            runs.push((start..end, deepest));
        }
        from = next;
    }
    let confirmed = runs
        .iter()
        .filter(|run| confirmed(values, run, &runs, bound));
    confirmed.flat_map(|(rows, _)| rows.clone()).collect()
}

/// Median of the window about a sample.
fn median(values: &[f64], k: usize) -> f64 {
    let n = values.len();
    // At the ends the window is shorter, and still about the sample.
    let half = HALF_WINDOW.min(k.max(1)).min((n - 1 - k).max(1));
    let window = values[k.saturating_sub(half)..(k + half + 1).min(n)].to_vec();
    quantile(window, 0.5)
}

/// True if a run is bad also where the deeper ones near it are taken out: a bad sample moves the
/// median of its neighbours, beside a step to the step's other side.
fn confirmed(
    values: &[f64],
    (rows, depth): &(Range<usize>, f64),
    runs: &[(Range<usize>, f64)],
    bound: f64,
) -> bool {
    let reach = rows.start.saturating_sub(HALF_WINDOW)..rows.end + HALF_WINDOW;
    let deeper: Vec<usize> = runs
        .iter()
        .filter(|(other, own)| own > depth && other.start < reach.end && other.end > reach.start)
        .flat_map(|(other, _)| other.clone())
        .collect();
    if deeper.is_empty() {
        return true;
    }
    let mut without = values.to_vec();
    fill(&mut without, &deeper);
    rows.clone()
        .any(|k| (values[k] - median(&without, k)).abs() > bound)
}
