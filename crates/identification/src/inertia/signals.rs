//! From logged columns to angle, velocity, acceleration and torque on an even grid, without delay.
//!
//! Stamps may be irregular, doubled or have gaps: each instant of the grid is the centre of a
//! local polynomial of fourth degree with tricube weights (Cleveland 1979), whose value and
//! derivatives are the smoothed signal. One window serves all signals of an instant, so that none
//! is delayed against another.

use super::robot::{JointColumns, RobotLog};
use problem::Problem;

/// Coefficients of a local polynomial.
const TERMS: usize = 5;
/// A window's half width times its cut-off frequency: the second derivative has lost 3 dB there
/// (computed from the kernel).
const HALF_WIDTH_TIMES_CUT_OFF: f64 = 1.03;
/// A gap is longer than this many sample periods.
const GAP_PERIODS: f64 = 10.0;
/// Rows of which the stamp goes back: more are a fault of the log.
const MAX_BACKWARD_SHARE: f64 = 0.01;
/// Samples within half a window at least.
const MIN_SAMPLES: f64 = 3.5;

/// Where velocity and acceleration come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// The angle, differentiated twice.
    Angle,
    /// The logged velocity, differentiated once.
    Velocity,
    /// The logged velocity and acceleration.
    Acceleration,
}

impl Source {
    /// Text for a report.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Angle => "q, differentiated",
            Self::Velocity => "dq of the log, differentiated once",
            Self::Acceleration => "dq and ddq of the log",
        }
    }
}

/// How kinematic signals are smoothed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smoothing {
    /// Frequency at which the acceleration has lost 3 dB, Hz.
    pub cut_off: f64,
    /// Where velocity and acceleration come from.
    pub source: Source,
}

/// A stretch of a log without gaps.
#[derive(Debug, Clone, Default)]
pub struct Segment {
    /// Index of its log.
    pub log: usize,
    /// Stamps, s, increasing.
    pub t: Vec<f64>,
    /// Columns `[joint][signal]`; signals: q, dq, ddq, tau (empty where the log has none).
    pub columns: Vec<[Vec<f64>; 4]>,
}

/// Stretches of all logs, and what was done to the stamps.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// Stretches in their order.
    pub segments: Vec<Segment>,
    /// Samples a second: the reciprocal of the median period.
    pub rate: f64,
    /// Joints' velocities are in every log.
    pub has_dq: bool,
    /// Joints' accelerations are in every log.
    pub has_ddq: bool,
    /// Remarks for the user.
    pub notes: Vec<String>,
}

impl Recording {
    /// Total time of the stretches, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        let ends = self
            .segments
            .iter()
            .filter_map(|s| Some((s.t.first()?, s.t.last()?)));
        ends.map(|(a, b)| b - a).sum()
    }

    /// Sorts out the stamps of logs that have torques of the `measured` joints.
    ///
    /// # Errors
    /// A log with too few rows, or whose time runs backwards.
    pub fn new(logs: &[RobotLog], measured: &[usize]) -> Result<Self, Problem> {
        let mut all = Self::default();
        let columns = |log: &RobotLog| -> Vec<JointColumns> {
            let joint = |j: &usize| log.joints[*j].clone().unwrap_or_default();
            measured.iter().map(joint).collect()
        };
        let every = |has: &dyn Fn(&JointColumns) -> bool| {
            logs.iter().all(|log| columns(log).iter().all(has))
        };
        all.has_dq = every(&|c| !c.dq.is_empty());
        all.has_ddq = all.has_dq && every(&|c| !c.ddq.is_empty());
        let mut periods = Vec::new();
        for (index, log) in logs.iter().enumerate() {
            let joined = all.repaired(log, index, &columns(log))?;
            let mut steps: Vec<f64> = joined.t.windows(2).map(|w| w[1] - w[0]).collect();
            steps.sort_by(f64::total_cmp);
            let median = steps[steps.len() / 2];
            periods.push((median, steps.len()));
            all.split(joined, median, &log.name);
        }
        let longest = periods.iter().max_by_key(|(_, n)| *n);
        let period = longest.map_or(1.0, |(p, _)| *p);
        if let Some((other, _)) = periods
            .iter()
            .find(|(p, _)| *p > 1.5 * period || 1.5 * p < period)
        {
            let (a, b) = (1.0 / period, 1.0 / other);
            all.notes
                .push(format!("logs of different rates: {a:.0} and {b:.0} Hz"));
        }
        all.rate = 1.0 / periods.iter().fold(period, |m, (p, _)| m.max(*p));
        Ok(all)
    }

    /// Rows with stamps that increase: doubles left out, coarse stamps spread.
    fn repaired(
        &mut self,
        log: &RobotLog,
        index: usize,
        columns: &[JointColumns],
    ) -> Result<Segment, Problem> {
        let signals = |k: usize| -> Vec<[f64; 4]> {
            let at = |c: &[f64]| c.get(k).copied().unwrap_or(0.0);
            columns
                .iter()
                .map(|c| [at(&c.q), at(&c.dq), at(&c.ddq), at(&c.tau)])
                .collect()
        };
        let (mut doubles, mut backward) = (0, 0);
        // Rows kept: index and stamp.
        let mut kept: Vec<(usize, f64)> = Vec::with_capacity(log.t.len());
        for (k, &t) in log.t.iter().enumerate() {
            match kept.last() {
                Some(&(last, before)) if t == before && signals(last) == signals(k) => doubles += 1,
                Some(&(_, before)) if t < before => backward += 1,
                _ => kept.push((k, t)),
            }
        }
        if backward as f64 > MAX_BACKWARD_SHARE * log.t.len() as f64 {
            let row = log.t.windows(2).position(|w| w[1] < w[0]).unwrap_or(0);
            let reason = format!("t runs backwards in {backward} of {} rows", log.t.len());
            return Err(Problem::new(reason, "stamps that increase").at(&log.name, row + 3));
        }
        let equal = kept.windows(2).filter(|w| w[0].1 == w[1].1).count();
        spread(&mut kept);
        kept.dedup_by(|b, a| b.1 <= a.1);
        if kept.len() < 20 {
            let reason = format!("the log has {} rows with different stamps", kept.len());
            return Err(Problem::new(reason, "at least 20").at(&log.name, 0));
        }
        for (n, what) in [
            (doubles, "doubled rows left out"),
            (backward, "rows with earlier stamps left out"),
            (
                equal,
                "rows with the stamp of the row before them: spread over the time to the next stamp",
            ),
        ] {
            if n > 0 {
                self.notes.push(format!("{}: {n} {what}", log.name));
            }
        }
        let take = |c: &Vec<f64>| -> Vec<f64> {
            kept.iter()
                .filter_map(|(k, _)| c.get(*k).copied())
                .collect()
        };
        let columns = columns
            .iter()
            .map(|c| [take(&c.q), take(&c.dq), take(&c.ddq), take(&c.tau)]);
        Ok(Segment {
            log: index,
            t: kept.iter().map(|(_, t)| *t).collect(),
            columns: columns.collect(),
        })
    }

    /// Cuts a log at its gaps.
    fn split(&mut self, joined: Segment, period: f64, name: &str) {
        let n = joined.t.len();
        let cuts = (1..n).filter(|&k| joined.t[k] - joined.t[k - 1] > GAP_PERIODS * period);
        let mut bounds: Vec<usize> = cuts.collect();
        if !bounds.is_empty() {
            let longest = bounds
                .iter()
                .map(|&k| joined.t[k] - joined.t[k - 1])
                .fold(0.0, f64::max);
            let note = format!("{name}: {} gaps, the longest {longest:.2} s", bounds.len());
            self.notes.push(note);
        }
        bounds.insert(0, 0);
        bounds.push(n);
        for w in bounds.windows(2) {
            let range = w[0]..w[1];
            let take = |c: &Vec<f64>| c.get(range.clone()).unwrap_or(&[]).to_vec();
            self.segments.push(Segment {
                log: joined.log,
                t: take(&joined.t),
                columns: joined
                    .columns
                    .iter()
                    .map(|c| [0, 1, 2, 3].map(|k| take(&c[k])))
                    .collect(),
            });
        }
    }
}

/// Spreads equal stamps evenly over the time to the next one.
fn spread(rows: &mut [(usize, f64)]) {
    let mut start = 0;
    while start < rows.len() {
        let t = rows[start].1;
        let run = rows[start..].iter().take_while(|r| r.1 == t).count();
        if let Some(next) = rows.get(start + run).map(|r| r.1).filter(|_| run > 1) {
            for (k, row) in rows[start..start + run].iter_mut().enumerate() {
                row.1 = t + (next - t) * k as f64 / run as f64;
            }
        }
        start += run;
    }
}

/// Half a window's width for a cut-off frequency, s, no narrower than its samples allow.
#[must_use]
pub fn half_width(cut_off: f64, rate: f64) -> f64 {
    (HALF_WIDTH_TIMES_CUT_OFF / cut_off).max(MIN_SAMPLES / rate)
}

/// Kernels of one window: weights of the samples in `first..first + len` whose sums are the value
/// and the first two derivatives.
#[derive(Debug, Clone, Default)]
pub struct Kernel {
    first: usize,
    weights: [Vec<f64>; 3],
}

impl Kernel {
    /// The local polynomial about `centre` over samples at `t`; false if they do not determine it.
    pub fn set(&mut self, t: &[f64], centre: f64, half: f64) -> bool {
        self.first = t.partition_point(|x| *x <= centre - half);
        let end = t.partition_point(|x| *x < centre + half);
        let inside = &t[self.first..end.max(self.first)];
        self.weights.iter_mut().for_each(Vec::clear);
        if inside.len() < TERMS + 1 {
            return false;
        }
        let mut gram = nalgebra::SMatrix::<f64, TERMS, TERMS>::zeros();
        for &x in inside {
            let (u, w) = place(x, centre, half);
            let powers = powers(u);
            for i in 0..TERMS {
                for j in 0..TERMS {
                    gram[(i, j)] += w * powers[i] * powers[j];
                }
            }
        }
        let Some(inverse) = gram.cholesky().map(|c| c.inverse()) else {
            return false;
        };
        let scale = [1.0, 1.0 / half, 2.0 / (half * half)];
        for &x in inside {
            let (u, w) = place(x, centre, half);
            let powers = powers(u);
            for (d, weights) in self.weights.iter_mut().enumerate() {
                let sum: f64 = (0..TERMS).map(|i| inverse[(d, i)] * powers[i]).sum();
                weights.push(scale[d] * w * sum);
            }
        }
        true
    }

    /// Value (0) or derivative (1, 2) of a signal.
    #[must_use]
    pub fn apply(&self, signal: &[f64], derivative: usize) -> f64 {
        let weights = &self.weights[derivative];
        let inside = signal.get(self.first..self.first + weights.len());
        inside.map_or(f64::NAN, |s| {
            s.iter().zip(weights).map(|(x, w)| x * w).sum()
        })
    }
}

fn place(x: f64, centre: f64, half: f64) -> (f64, f64) {
    let u = (x - centre) / half;
    let tricube = 1.0 - u.abs().powi(3);
    (u, tricube.max(0.0).powi(3))
}

fn powers(u: f64) -> [f64; TERMS] {
    [1.0, u, u * u, u * u * u, u * u * u * u]
}

/// State of all measured joints at an instant.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Instant {
    /// t: stamp, s.
    pub t: f64,
    /// q: angles.
    pub q: Vec<f64>,
    /// dq: velocities.
    pub dq: Vec<f64>,
    /// ddq: accelerations.
    pub ddq: Vec<f64>,
    /// tau: torques, averaged over the grid's period only.
    pub tau: Vec<f64>,
    /// The torques of the sample next to the instant, as logged.
    pub raw: Vec<f64>,
}

/// Instants of a segment on an even grid, windows complete on both sides. `margin`: time left out
/// at both ends, s, of which the kinematic window is a part.
pub fn instants(
    segment: &Segment,
    rate: f64,
    grid: f64,
    smoothing: Smoothing,
    margin: f64,
    mut visit: impl FnMut(Option<Instant>),
) {
    let (Some(&start), Some(&end)) = (segment.t.first(), segment.t.last()) else {
        return;
    };
    let half = half_width(smoothing.cut_off, rate);
    let torque_half = (2.0 / grid).max(MIN_SAMPLES / rate);
    let (mut motion, mut torque) = (Kernel::default(), Kernel::default());
    let count = ((end - start - 2.0 * margin) * grid).floor().max(-1.0) as i64 + 1;
    for k in 0..count.max(0) {
        let t = start + margin + k as f64 / grid;
        if !(motion.set(&segment.t, t, half) && torque.set(&segment.t, t, torque_half)) {
            visit(None);
            continue;
        }
        let near = segment
            .t
            .partition_point(|x| *x < t)
            .min(segment.t.len() - 1);
        let mut now = Instant {
            t,
            ..Instant::default()
        };
        for [q, dq, ddq, tau] in &segment.columns {
            now.q.push(motion.apply(q, 0));
            let (velocity, acceleration) = match smoothing.source {
                Source::Angle => (motion.apply(q, 1), motion.apply(q, 2)),
                Source::Velocity => (motion.apply(dq, 0), motion.apply(dq, 1)),
                Source::Acceleration => (motion.apply(dq, 0), motion.apply(ddq, 0)),
            };
            now.dq.push(velocity);
            now.ddq.push(acceleration);
            now.tau.push(torque.apply(tau, 0));
            now.raw.push(tau[near]);
        }
        visit(Some(now));
    }
}
