//! Torques of another time or band than the motion: late or early by some ms, or low-passed while the angles were not.
//!
//! Between the model's torque and the logged one stands a filter that is 1 in a sound log. Each filter of a small family
//! (delays either way, low-passes with and without phase) is put on the model's side, on the regressor with its
//! friction, and links and friction are fitted under it. A delay shows both as a phase against the acceleration and
//! against the velocity, which no links explain together; a low-pass as missing sudden torques. The filter that leaves
//! far less than none is named: of the squares beyond noise, and in the blocks of the log alike.

use super::consistent::Prior;
use super::equations::{Grams, Solved, Weights};
use super::friction::Friction;
use super::noise;
use super::robot::Robot;
use super::rows::{BLOCKS, JointRows, Rows, Sampling};
use super::select::always;
use nalgebra::DVector;
use problem::Problem;
use std::f64::consts::{PI, TAU};

/// Delays that are tried, s; between them a parabola finds the best.
const DELAYS: [f64; 12] = [
    -0.3, -0.2, -0.12, -0.07, -0.04, -0.02, 0.02, 0.04, 0.07, 0.12, 0.2, 0.3,
];
/// Cut-offs that are tried, Hz.
const CUT_OFFS: [f64; 4] = [0.5, 1.0, 2.0, 4.0];
/// Half of a delay's interpolation, in rows.
const TAPS: usize = 6;
/// Half of the longest low-pass, s: three deviations of the lowest cut-off's bell.
const HALF: f64 = 3.0 * 0.187_4 / 0.5;
/// Rows that are judged at most, and at least for each joint.
const MAX_ROWS: usize = 2_000;
const MIN_ROWS: usize = 100;
/// Weight of the URDF's inertias.
const LAMBDA: f64 = 1e-2;
/// Share of the squares beyond noise that a filter leaves at most to be named.
const MUCH_BETTER: f64 = 0.5;
/// Mean gain of the blocks over its standard error, from which it is no chance: one in two thousand (Student, 15
/// degrees of freedom).
const SIGNIFICANT: f64 = 4.0;
/// Share of the torque's deviation that is unexplained at least, before a filter is looked for.
const UNEXPLAINED: f64 = 0.02;
/// Delay that changes no mass by much, s.
const SMALL: f64 = 0.015;
/// One joint's filter is named where it leaves less than this share of what one filter of all joints leaves.
const OWN: f64 = 0.7;

/// A delay or low-pass between the model's torque and the logged one.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Filter {
    /// Late by this time, s.
    Delay(f64),
    /// Low-passed without phase, half at this frequency, Hz.
    Smoothed(f64),
    /// Low-passed of first order, Hz.
    Lagged(f64),
}

impl Filter {
    fn all() -> impl Iterator<Item = Self> {
        let delays = DELAYS.into_iter().map(Self::Delay);
        let smoothed = CUT_OFFS.into_iter().map(Self::Smoothed);
        let lagged = CUT_OFFS.into_iter().map(Self::Lagged);
        delays.chain(smoothed).chain(lagged)
    }

    /// Weights of the rows around one, `half` to each side, `step` s apart, the earliest first.
    fn kernel(self, half: usize, step: f64) -> Vec<f64> {
        let n = half as i64;
        let weight = |k: i64| {
            let t = k as f64 * step;
            match self {
                Self::Delay(late) => {
                    let x = k as f64 + late / step;
                    let window = 0.5 * (1.0 + (PI * x / (TAPS as f64)).cos());
                    let sinc = if x == 0.0 {
                        1.0
                    } else {
                        (PI * x).sin() / (PI * x)
                    };
                    if x.abs() < TAPS as f64 {
                        sinc * window
                    } else {
                        0.0
                    }
                }
                Self::Smoothed(cut_off) => {
                    let deviation = (2.0 * 2f64.ln()).sqrt() / (TAU * cut_off);
                    (-0.5 * (t / deviation).powi(2)).exp()
                }
                Self::Lagged(cut_off) if k <= 0 => (TAU * cut_off * t).exp(),
                Self::Lagged(_) => 0.0,
            }
        };
        let weights: Vec<f64> = (-n..=n).map(weight).collect();
        let sum: f64 = weights.iter().sum();
        weights.into_iter().map(|w| w / sum).collect()
    }

    fn words(self, of: &str) -> String {
        match self {
            Self::Delay(late) if late > 0.0 => {
                format!("tau{of} is late against q by some {:.0} ms", 1e3 * late)
            }
            Self::Delay(late) => format!("q is late against tau{of} by some {:.0} ms", -1e3 * late),
            Self::Smoothed(cut_off) => {
                format!("tau{of} was low-passed at some {cut_off} Hz, which q was not")
            }
            Self::Lagged(cut_off) => {
                format!("tau{of} was low-passed at some {cut_off} Hz, and lags behind q by it")
            }
        }
    }
}

/// A log whose torques fit far better under a filter.
#[must_use]
pub fn judge(
    robot: &Robot<'_>,
    rows: &Rows,
    sampling: &Sampling,
    prior: &Prior,
    friction: &[Friction],
) -> Option<Problem> {
    let judge = Judge::new(rows, sampling, prior, friction)?;
    if judge.left < UNEXPLAINED || judge.square <= judge.noise {
        return None;
    }
    let every: Vec<(Filter, Grams)> = Filter::all().map(|f| (f, judge.grams(f))).collect();
    let (filter, rest) = judge.best(&every, None)?;
    let mut named = (rest, filter, String::new());
    for joint in (0..rows.joints).filter(|k| friction[*k].moves) {
        if let Some((filter, rest)) = judge.best(&every, Some(joint))
            && rest.share < named.0.share * if named.2.is_empty() { OWN } else { 1.0 }
        {
            named = (rest, filter, format!(" of `{}`", robot.name(joint)));
        }
    }
    let (rest, filter, of) = named;
    let small = matches!(filter, Filter::Delay(late) if late.abs() < SMALL);
    if rest.systematic > MUCH_BETTER || rest.student < SIGNIFICANT || small {
        return None;
    }
    let reason = format!(
        "links and friction leave {:.1} % of the torques unexplained, but {:.1} % if {}",
        100.0 * judge.left,
        100.0 * judge.left * rest.share.sqrt(),
        filter.words(&of)
    );
    let allowed = "torques and angles of one time, filtered alike or not at all; --accept takes them as they stand";
    Some(Problem::new(reason, allowed))
}

/// Squares that a filter leaves.
#[derive(Debug, Clone, Copy)]
struct Rest {
    /// Share of all squares.
    share: f64,
    /// Share of those beyond noise.
    systematic: f64,
    /// Mean gain of the blocks over its standard error.
    student: f64,
}

/// Regressor, prior and squares by which a filter is judged.
struct Judge<'a> {
    rows: &'a Rows,
    prior: &'a Prior,
    keep: Vec<bool>,
    /// Rows with a whole filter around them, the filter's half in rows, and the rows' step, s.
    samples: Vec<usize>,
    half: usize,
    step: f64,
    plain: Grams,
    weights: Weights,
    /// Sum of squares without a filter, and in each block.
    square: f64,
    blocks: Vec<f64>,
    /// Sum of squares that white noise alone leaves.
    noise: f64,
    /// Share of the torques' deviation that is left without a filter, RMS over the joints.
    left: f64,
}

impl<'a> Judge<'a> {
    fn new(
        rows: &'a Rows,
        sampling: &Sampling,
        prior: &'a Prior,
        friction: &[Friction],
    ) -> Option<Self> {
        let step = sampling.every as f64 / sampling.grid;
        let longest = DELAYS.iter().copied().fold(0.0, f64::max);
        let half = (HALF / step).ceil() as usize;
        let half = half.max((longest / step).ceil() as usize + TAPS);
        let samples = whole(rows, half, step);
        if samples.len() < MIN_ROWS {
            return None;
        }
        let keep = always(rows, friction);
        let own = selected(rows, &samples, |own, sample| own.row(sample).to_vec());
        let all: Vec<usize> = (0..BLOCKS).collect();
        let deviations = Weights::even(&own).sigma;
        let mut weights = Weights::even(&own);
        for _ in 0..2 {
            let normal = Grams::new(&own, &weights).normal(&all, &weights.sigma);
            let x = Solved::new(&normal, prior, LAMBDA, &keep)?.x;
            weights = Weights::of(&own, &x, &all, &weights);
        }
        let plain = Grams::new(&own, &weights);
        let shares = weights.sigma.iter().zip(&deviations);
        let squares: f64 = shares.map(|(sigma, all)| (sigma / all).powi(2)).sum();
        let mut judge = Self {
            rows,
            prior,
            keep,
            samples,
            half,
            step,
            plain,
            left: (squares / rows.joints.max(1) as f64).sqrt(),
            weights,
            square: 0.0,
            blocks: Vec::new(),
            noise: 0.0,
        };
        let x = judge.solve(&judge.plain)?;
        judge.blocks = judge.each_block(&judge.plain, &x);
        judge.square = judge.blocks.iter().sum();
        judge.noise = noise::squares(&own, sampling, &x, &judge.plain, &judge.weights);
        Some(judge)
    }

    /// Moments of all joints under a filter.
    fn grams(&self, filter: Filter) -> Grams {
        let kernel = filter.kernel(self.half, self.step);
        let filtered = selected(self.rows, &self.samples, |own, sample| {
            let mut sum = vec![0.0; own.place.len()];
            let first = sample - self.half;
            for (k, w) in kernel.iter().enumerate().filter(|(_, w)| **w != 0.0) {
                let row = own.row(first + k);
                sum.iter_mut().zip(row).for_each(|(sum, x)| *sum += w * x);
            }
            sum
        });
        Grams::new(&filtered, &self.weights)
    }

    fn solve(&self, grams: &Grams) -> Option<DVector<f64>> {
        let all: Vec<usize> = (0..BLOCKS).collect();
        let normal = grams.normal(&all, &self.weights.sigma);
        Some(Solved::new(&normal, self.prior, LAMBDA, &self.keep)?.x)
    }

    /// Sum of squares of each block.
    fn each_block(&self, grams: &Grams, x: &DVector<f64>) -> Vec<f64> {
        let of = |block: usize| -> f64 {
            let sigma = self.weights.sigma.iter().enumerate();
            sigma
                .map(|(joint, s)| grams.residual(joint, &[block], x) / s.powi(2))
                .sum()
        };
        (0..BLOCKS).map(of).collect()
    }

    /// Squares that a filter leaves.
    fn rest(&self, grams: &Grams) -> Option<Rest> {
        let blocks = self.each_block(grams, &self.solve(grams)?);
        let square: f64 = blocks.iter().sum();
        let gains = self.blocks.iter().zip(&blocks).map(|(a, b)| a - b);
        let n = BLOCKS as f64;
        let mean = (self.square - square) / n;
        let variance = gains.map(|gain| (gain - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Some(Rest {
            share: square / self.square.max(1e-30),
            systematic: (square - self.noise) / (self.square - self.noise).max(1e-30),
            student: mean / (variance / n).sqrt().max(1e-30),
        })
    }

    /// The best filter of all joints, or of one, and what it leaves.
    fn best(&self, every: &[(Filter, Grams)], joint: Option<usize>) -> Option<(Filter, Rest)> {
        let tried = every.iter().filter_map(|(filter, grams)| {
            let rest = match joint {
                None => self.rest(grams)?,
                Some(k) => self.rest(&self.plain.with_joint(k, grams))?,
            };
            Some((*filter, rest))
        });
        let tried: Vec<(Filter, Rest)> = tried.collect();
        let best = tried
            .iter()
            .min_by(|a, b| a.1.share.total_cmp(&b.1.share))?;
        let Filter::Delay(_) = best.0 else {
            return Some(*best);
        };
        let mut delays: Vec<(f64, f64)> = vec![(0.0, 1.0)];
        delays.extend(tried.iter().filter_map(|(filter, rest)| match filter {
            Filter::Delay(late) => Some((*late, rest.share)),
            _ => None,
        }));
        delays.sort_by(|a, b| a.0.total_cmp(&b.0));
        Some((Filter::Delay(lowest(&delays)), best.1))
    }
}

/// Where a parabola through the least of the points and its neighbours is least.
fn lowest(points: &[(f64, f64)]) -> f64 {
    let least = (0..points.len()).min_by(|a, b| points[*a].1.total_cmp(&points[*b].1));
    let Some(k) = least else { return 0.0 };
    let (Some(before), Some(after)) = (
        k.checked_sub(1).and_then(|j| points.get(j)),
        points.get(k + 1),
    ) else {
        return points[k].0;
    };
    let (x, y) = points[k];
    let [(a, b), (c, d)] = [before, after].map(|(x_, y_)| (x_ - x, y_ - y));
    let curvature = (b / a - d / c) / (a - c);
    if curvature > 0.0 {
        x + (0.5 * (a - b / a / curvature)).clamp(a, c)
    } else {
        x
    }
}

/// Rows around which `half` rows to each side follow one another.
fn whole(rows: &Rows, half: usize, step: f64) -> Vec<usize> {
    let n = rows.len();
    let inner = half..n.saturating_sub(half);
    let follow = |sample: &usize| {
        let (first, last) = (rows.stamps[sample - half], rows.stamps[sample + half]);
        first.0 == last.0 && (last.1 - first.1 - 2.0 * half as f64 * step).abs() < 0.5 * step
    };
    inner.filter(follow).take(MAX_ROWS).collect()
}

/// Rows of some samples, with other values.
fn selected(
    rows: &Rows,
    samples: &[usize],
    values: impl Fn(&JointRows, usize) -> Vec<f64>,
) -> Rows {
    let n = samples.len();
    let of = rows.of.iter().map(|own| JointRows {
        place: own.place.clone(),
        values: samples.iter().flat_map(|&k| values(own, k)).collect(),
        tau: samples.iter().map(|&k| own.tau[k]).collect(),
        ..JointRows::default()
    });
    Rows {
        joints: rows.joints,
        rigid: rows.rigid,
        stamps: samples.iter().map(|&k| rows.stamps[k]).collect(),
        block: (0..n)
            .map(|k| (k * BLOCKS / n.max(1)).min(BLOCKS - 1))
            .collect(),
        of: of.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::{Filter, lowest};

    #[test]
    fn a_delay_takes_the_row_before() {
        let step = 0.1;
        let kernel = Filter::Delay(step).kernel(10, step);
        assert!((kernel[9] - 1.0).abs() < 1e-9, "{kernel:?}");
        let half = Filter::Delay(-0.05).kernel(12, step);
        let middle = |t: f64| (2.0 * t).sin();
        let sum: f64 = (0..25)
            .map(|k| half[k] * middle((k as f64 - 12.0) * step))
            .sum();
        assert!((sum - middle(0.05)).abs() < 1e-3, "{sum}");
    }

    #[test]
    fn low_passes_halve_at_their_frequency() {
        let step = 0.05;
        let gain = |filter: Filter, f: f64| {
            let kernel = filter.kernel(60, step);
            let part = |phase: f64| -> f64 {
                let at = |k: usize| std::f64::consts::TAU * f * (k as f64 - 60.0) * step + phase;
                kernel
                    .iter()
                    .enumerate()
                    .map(|(k, w)| w * at(k).cos())
                    .sum()
            };
            part(0.0).hypot(part(-std::f64::consts::FRAC_PI_2))
        };
        assert!((gain(Filter::Smoothed(1.0), 1.0) - 0.5).abs() < 0.02);
        assert!((gain(Filter::Lagged(0.5), 0.5) - 0.5f64.sqrt()).abs() < 0.05);
    }

    #[test]
    fn the_least_of_a_parabola_is_found() {
        let y = |x: f64| (x - 0.05).powi(2) + 0.1;
        let points = [0.02, 0.04, 0.07, 0.12].map(|x| (x, y(x)));
        assert!((lowest(&points) - 0.05).abs() < 1e-12);
    }
}
