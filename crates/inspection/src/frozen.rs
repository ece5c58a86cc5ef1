//! Stretches in which a channel repeats one value while what it measures goes on: a driver that
//! kept its last reading.
//!
//! A joint at rest repeats its angle too. What tells both apart is the end: a reading that was
//! kept catches up in one step that is far larger than the steps around the stretch.

use crate::statistics::{span, steps};
use core::ops::Range;

/// Fewest repeated samples.
const MIN_RUN: usize = 10;
/// Multiple of the largest step shortly before and behind, and share of the range, of the step
/// that ends a stretch.
const MIN_STEP: f64 = 3.0;
/// Steps before and behind a stretch that its end is compared with.
const AROUND: usize = 10;
const MIN_SHARE: f64 = 0.01;

/// Stretches of rows that repeat a value the channel has left meanwhile.
#[must_use]
pub fn frozen(values: &[f64]) -> Vec<Range<usize>> {
    let runs = runs(values);
    let long: Vec<&Range<usize>> = runs.iter().filter(|r| r.len() >= MIN_RUN).collect();
    if long.is_empty() {
        return Vec::new();
    }
    let all = steps(values);
    let smallest = all.iter().copied().filter(|s| *s > 0.0);
    let smallest = smallest.fold(f64::INFINITY, f64::min);
    let least = MIN_SHARE * span(values);
    let leaps = |run: &Range<usize>| {
        let Some(next) = values.get(run.end) else {
            return false;
        };
        let before = run.start.saturating_sub(AROUND)..run.start;
        let behind = run.end..(run.end + AROUND).min(all.len());
        let most = before
            .chain(behind)
            .map(|k| all[k])
            .fold(smallest, f64::max);
        let leap = (next - values[run.start]).abs();
        leap > least && leap > MIN_STEP * most
    };
    long.into_iter().filter(|run| leaps(run)).cloned().collect()
}

/// Runs of equal values, one sample long at least.
fn runs(values: &[f64]) -> Vec<Range<usize>> {
    let mut out = Vec::new();
    let mut start = 0;
    for k in 1..=values.len() {
        if k == values.len() || values[k] != values[start] {
            out.push(start..k);
            start = k;
        }
    }
    out
}

/// Stretches of `shortest` rows or more that repeat a value while each of some companions, which follow
/// the same motion, crosses more than `went_on` of its own range. A channel that repeats more than a share
/// of `coarse` of its values outside of long stretches is held by its resolution, and shows none.
#[must_use]
pub fn held(
    values: &[f64],
    companions: &[&[f64]],
    shortest: usize,
    went_on: f64,
    coarse: f64,
) -> Vec<Range<usize>> {
    let runs = runs(values);
    let long: Vec<&Range<usize>> = runs.iter().filter(|r| r.len() >= shortest).collect();
    if long.is_empty() {
        return Vec::new();
    }
    let short = runs.iter().filter(|r| r.len() < shortest);
    let (repeats, rows) = short.fold((0, 0), |(repeats, rows), r| {
        (repeats + r.len() - 1, rows + r.len())
    });
    if repeats as f64 > coarse * rows as f64 || companions.is_empty() {
        return Vec::new();
    }
    let ranges: Vec<f64> = companions.iter().map(|x| span(x)).collect();
    let moved = |run: &Range<usize>| {
        companions.iter().zip(&ranges).all(|(x, range)| {
            let part = x.get(run.clone()).unwrap_or_default();
            let low = part.iter().copied().fold(f64::INFINITY, f64::min);
            let high = part.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            high - low > went_on * range
        })
    };
    long.into_iter().filter(|run| moved(run)).cloned().collect()
}
