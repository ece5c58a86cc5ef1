//! Channels that hold something else than the samples of one source: marks of missing readings, samples of
//! two sources in turn, readings that are held for several rows.

use crate::statistics::{quantile, span, steps};

/// Multiple of what eight of ten samples stay within from which on a number is a mark, no reading.
const FAR: f64 = 1000.0;
/// Most samples that are marks, as a share, and different numbers among them.
const MAX_MARKS: f64 = 0.2;
const MAX_NUMBERS: usize = 3;
/// Rows after which a source of several comes again, at most.
const MAX_SOURCES: usize = 5;
/// Steps from row to row of two sources, as a share of the channel's range, at least; and steps to the next row
/// of the same source, as a share of these, at most. Of one source the latter are larger, not smaller.
const MIN_APART: f64 = 0.02;
const MAX_OWN_STEP: f64 = 0.2;
/// Different values from which on a channel is more than the toggling of a count.
const MIN_VALUES: usize = 30;
/// Rows for which readings are held from which on a log is sampled too slowly, and share of the runs of about
/// that length.
const MIN_HELD: usize = 4;
const HELD_ALIKE: f64 = 0.8;
/// Runs from which this is concluded.
const MIN_RUNS: usize = 20;
/// Leap from one held reading to the next, as a share of the range, that loses the motion between.
const MAX_LEAP: f64 = 0.03;

/// Rows that hold a mark for a missing reading, such as 9999 or the largest number of a register: one or a few
/// numbers far beyond all others.
#[must_use]
pub fn marks(values: &[f64]) -> Vec<usize> {
    let middle = quantile(values.to_vec(), 0.5);
    let distances: Vec<f64> = values.iter().map(|x| (x - middle).abs()).collect();
    let bound = FAR * quantile(distances.clone(), 1.0 - MAX_MARKS);
    let far: Vec<usize> = (0..values.len())
        .filter(|&k| distances[k] > bound)
        .collect();
    let mut numbers: Vec<f64> = Vec::new();
    for &row in &far {
        if !numbers.contains(&values[row]) {
            numbers.push(values[row]);
        }
        if numbers.len() > MAX_NUMBERS {
            return Vec::new();
        }
    }
    if bound > 0.0 { far } else { Vec::new() }
}

/// The number of sources whose samples stand in turn in a channel that moves steadily; none for one.
#[must_use]
pub fn sources(values: &[f64]) -> Option<usize> {
    let apart = quantile(steps(values), 0.9);
    if apart <= MIN_APART * span(values) || !has_many_values(values) {
        return None;
    }
    (2..=MAX_SOURCES).find(|&lag| {
        let own = values.iter().zip(values.iter().skip(lag));
        quantile(own.map(|(a, b)| (b - a).abs()).collect(), 0.9) < MAX_OWN_STEP * apart
    })
}

fn has_many_values(values: &[f64]) -> bool {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.windows(2).filter(|w| w[0] != w[1]).count() >= MIN_VALUES
}

/// Rows for which each reading of a channel that moves steadily is held, where that loses its motion.
#[must_use]
pub fn held_rows(values: &[f64]) -> Option<usize> {
    let starts: Vec<usize> = (1..values.len())
        .filter(|&k| values[k] != values[k - 1])
        .collect();
    let runs: Vec<usize> = starts.windows(2).map(|w| w[1] - w[0]).collect();
    if runs.len() < MIN_RUNS {
        return None;
    }
    let rows = quantile(runs.iter().map(|&n| n as f64).collect(), 0.5) as usize;
    let alike = runs.iter().filter(|&&n| n.abs_diff(rows) <= 1).count();
    let leaps: Vec<f64> = starts
        .iter()
        .map(|&k| (values[k] - values[k - 1]).abs())
        .collect();
    (rows >= MIN_HELD
        && alike as f64 > HELD_ALIKE * runs.len() as f64
        && quantile(leaps, 0.5) > MAX_LEAP * span(values))
    .then_some(rows)
}
