//! Values that continue at the other end of their range: angles of drivers that report within a
//! turn, currents and counts in a register that is too short.
//!
//! A step of a whole turn between two samples is a wrap, since nothing moves so far in a period;
//! the turn is taken off. A range that nobody has named is found from the steps themselves: all
//! are of one size, larger than half of what the values cover, and lead from one bound to the other.

use crate::statistics::{quantile, steps};

/// Distance from a whole turn up to which a step counts as a wrap, turns.
const MAX_DISTANCE: f64 = 0.25;
/// Fewest wraps from which an unknown range is concluded: two could be two spikes.
const MIN_WRAPS: usize = 3;
/// Fewest times that values pass from one end to the other and stay there: out and home.
const MIN_ACROSS: usize = 2;
/// Distance of values before and behind a wrap from the bounds, as a share of what is covered.
const NEAR_BOUND: f64 = 0.15;
/// Relative spread of nine of ten steps of an unknown range.
const MAX_SPREAD: f64 = 0.05;

/// What was unwrapped.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Unwrapped {
    /// Number of wraps.
    pub count: usize,
    /// First row behind a wrap.
    pub row: usize,
    /// Range, unit of the channel.
    pub range: f64,
}

/// Takes whole turns out of the steps between neighbouring values; none where there are none.
pub fn unwrap(values: &mut [f64], turn: f64) -> Option<Unwrapped> {
    let mut found: Option<Unwrapped> = None;
    let (mut shift, mut before) = (0.0, *values.first()?);
    for (row, x) in values.iter_mut().enumerate() {
        let turns = ((*x - before) / turn).round();
        let rest = (*x - before) / turn - turns;
        // More than one turn in a period is no wrap but a bad sample.
        if turns.abs() == 1.0 && rest.abs() <= MAX_DISTANCE {
            shift -= turns * turn;
            let first = Unwrapped {
                count: 0,
                row,
                range: turn,
            };
            found.get_or_insert(first).count += 1;
        }
        before = *x;
        *x += shift;
    }
    found
}

/// The range of values that wrap at an unknown bound; none where nothing shows one.
#[must_use]
pub fn range_of_wraps(values: &[f64]) -> Option<f64> {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let covered = high - low;
    let ordinary = quantile(steps(values), 0.9);
    let mut sizes = Vec::new();
    let mut at_bounds = 0;
    // Noise at a bound takes a wrap back and repeats it, so that an odd number of steps in a row leads across. A spike
    // to one value looks like wraps otherwise, but its steps are even in number.
    let (mut across, mut last): (usize, Option<(usize, bool)>) = (0, None);
    for (row, w) in values.windows(2).enumerate() {
        let step = (w[1] - w[0]).abs();
        if step > 0.6 * covered && step > 10.0 * ordinary {
            let odd = match last {
                Some((at, odd)) if at + 1 == row => !odd,
                _ => true,
            };
            across = if odd { across + 1 } else { across - 1 };
            last = Some((row, odd));
            sizes.push(step);
            // A wrap leads from one bound to the other; a spike begins anywhere.
            let (least, most) = (w[0].min(w[1]), w[0].max(w[1]));
            let near = NEAR_BOUND * covered;
            at_bounds += usize::from(least < low + near && most > high - near);
        }
    }
    if sizes.len() < MIN_WRAPS || at_bounds * 10 < 9 * sizes.len() || across < MIN_ACROSS {
        return None;
    }
    let middle = quantile(sizes.clone(), 0.5);
    let spread = quantile(
        sizes.iter().map(|s| (s / middle - 1.0).abs()).collect(),
        0.9,
    );
    (spread < MAX_SPREAD + 2.0 * ordinary / middle).then(|| {
        // The values end within one ordinary step of either bound.
        middle.max(covered)
    })
}
