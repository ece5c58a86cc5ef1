//! Rows of the regression: for every sample and joint the torque, the part of the regressor that
//! is not zero, and the terms of friction, all low-passed and decimated alike (Gautier 1997).

use super::friction::{Friction, LOAD, TERMS};
use super::robot::Robot;
use super::signals::{Instant, Recording, Smoothing, instants};
use dynamics::{Data, PARAMETERS, joint_torque_regressor};
use nalgebra::{DMatrix, DVector};
use std::collections::VecDeque;

/// Contiguous blocks that samples are divided into: four in each quarter.
pub const BLOCKS: usize = 16;
/// Samples of the grid between two rows.
const DECIMATION: usize = 5;
/// Half of the low-pass filter, in periods of its cut-off frequency.
const FILTER_PERIODS: f64 = 2.0;
/// Rate of rows, as a multiple of the cut-off frequency.
const ROWS_PER_PERIOD: f64 = 2.5;
/// Rows of a log at most; longer ones are decimated further.
const MAX_ROWS: f64 = 12_000.0;

/// How logs become rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Frequency at which the low-pass filter of torques and regressors has halved them, Hz.
    pub cut_off: f64,
    /// Rate of the grid on which regressors are computed, Hz.
    pub grid: f64,
    /// Grid samples between rows.
    pub every: usize,
    /// Time left out at both ends of each stretch, s.
    pub margin: f64,
}

impl Sampling {
    /// For a low-pass at `cut_off` of logs of a rate and duration, under kinematic windows of up to
    /// `half` seconds to both sides.
    #[must_use]
    pub fn new(cut_off: f64, recording: &Recording, half: f64) -> Self {
        let wanted = ROWS_PER_PERIOD * DECIMATION as f64 * cut_off;
        let grid = wanted.min(recording.rate);
        let rate = ROWS_PER_PERIOD * cut_off;
        let more = (recording.duration() * rate / MAX_ROWS).max(1.0);
        Self {
            cut_off,
            grid,
            every: ((more * grid / rate).round() as usize).max(1),
            margin: half,
        }
    }

    /// Share of white noise's square in a row that is left in a sixth of the square of rows' second differences: the
    /// filter makes neighbouring rows alike.
    #[must_use]
    pub fn second_difference(&self) -> f64 {
        let weights = self.filter();
        let product = |lag: usize| -> f64 {
            let later = weights.iter().skip(lag * self.every);
            weights.iter().zip(later).map(|(a, b)| a * b).sum()
        };
        let [own, next, second] = [0, 1, 2].map(product);
        1.0 - (8.0 * next - 2.0 * second) / (6.0 * own)
    }

    /// Weights of the low-pass filter: a sinc under Hann's window, their sum 1.
    fn filter(&self) -> Vec<f64> {
        let half = (FILTER_PERIODS * self.grid / self.cut_off).round().max(1.0) as i64;
        let x = |k: i64| std::f64::consts::PI * k as f64;
        let weight = |k: i64| {
            let angle = 2.0 * self.cut_off / self.grid * x(k);
            let sinc = if k == 0 { 1.0 } else { angle.sin() / angle };
            sinc * 0.5 * (1.0 + (x(k) / (half + 1) as f64).cos())
        };
        let weights: Vec<f64> = (-half..=half).map(weight).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter().map(|w| w / sum).collect()
    }
}

/// Rows of all joints.
#[derive(Debug, Clone)]
pub struct Rows {
    /// Measured joints.
    pub joints: usize,
    /// Columns of the rigid bodies, of all joints together.
    pub rigid: usize,
    /// Stamps: log and time, s.
    pub stamps: Vec<(usize, f64)>,
    /// Block of each sample.
    pub block: Vec<usize>,
    /// Per joint: its columns.
    pub of: Vec<JointRows>,
}

/// Rows of one joint, one per sample.
#[derive(Debug, Clone, Default)]
pub struct JointRows {
    /// For each column its place among all unknowns: rigid parameters, then friction.
    pub place: Vec<usize>,
    /// Values, row by row.
    pub values: Vec<f64>,
    /// tau, low-passed.
    pub tau: Vec<f64>,
    /// tau as logged at the same instant.
    pub raw: Vec<f64>,
    /// q, dq, ddq at the same instant.
    pub state: Vec<[f64; 3]>,
}

impl JointRows {
    /// A row.
    #[must_use]
    pub fn row(&self, sample: usize) -> &[f64] {
        let n = self.place.len();
        &self.values[n * sample..n * (sample + 1)]
    }

    /// s(dq) of a row, low-passed.
    #[must_use]
    pub fn sign(&self, sample: usize) -> f64 {
        self.row(sample)[self.place.len() - TERMS.len() + super::friction::COULOMB]
    }

    /// Torque of a row by a solution.
    #[must_use]
    pub fn torque(&self, sample: usize, x: &DVector<f64>) -> f64 {
        let each = self.place.iter().zip(self.row(sample));
        each.map(|(&p, value)| x[p] * value).sum()
    }

    /// Torque of a row by the rigid bodies of a solution.
    #[must_use]
    pub fn rigid_torque(&self, sample: usize, x: &DVector<f64>) -> f64 {
        let rigid = self.place.len() - TERMS.len();
        let each = self.place.iter().zip(self.row(sample)).take(rigid);
        each.map(|(&p, value)| x[p] * value).sum()
    }
}

impl Rows {
    /// Every unknown: rigid parameters of all bodies, then each joint's terms.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        self.rigid + TERMS.len() * self.joints
    }

    /// Place of a joint's term among all unknowns.
    #[must_use]
    pub fn term(&self, joint: usize, term: usize) -> usize {
        self.rigid + TERMS.len() * joint + term
    }

    /// Samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.stamps.len()
    }

    /// True without samples.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.stamps.is_empty()
    }

    /// Rows of a recording, smoothed and sampled so.
    #[must_use]
    pub fn new(
        robot: &Robot<'_>,
        recording: &Recording,
        friction: &[Friction],
        sampling: &Sampling,
        smoothing: Smoothing,
    ) -> Self {
        let rigid = PARAMETERS * robot.bodies;
        let mut rows = Self {
            joints: robot.measured.len(),
            rigid,
            stamps: Vec::new(),
            block: Vec::new(),
            of: Vec::new(),
        };
        for (joint, carried) in robot.carried.iter().enumerate() {
            let bodies = carried
                .iter()
                .flat_map(|b| (0..PARAMETERS).map(move |k| PARAMETERS * b + k));
            let terms = (0..TERMS.len()).map(|k| rows.term(joint, k));
            let place = bodies.chain(terms).collect();
            rows.of.push(JointRows {
                place,
                ..JointRows::default()
            });
        }
        let mut builder = Builder::new(robot, friction, sampling);
        for segment in &recording.segments {
            builder.restart();
            instants(
                segment,
                recording.rate,
                sampling.grid,
                smoothing,
                sampling.margin,
                |now| match now {
                    Some(now) => builder.take(robot, &mut rows, segment.log, now),
                    None => builder.restart(),
                },
            );
        }
        let n = rows.len();
        rows.block = (0..n)
            .map(|k| (k * BLOCKS / n.max(1)).min(BLOCKS - 1))
            .collect();
        rows
    }

    /// Sets the load's term by the rigid bodies of a solution.
    pub fn set_load(&mut self, x: &DVector<f64>) {
        for rows in &mut self.of {
            let n = rows.place.len();
            let (load, sign) = (
                n - TERMS.len() + LOAD,
                n - TERMS.len() + super::friction::COULOMB,
            );
            for sample in 0..rows.tau.len() {
                let tau = rows.rigid_torque(sample, x).abs();
                rows.values[n * sample + load] = tau * rows.values[n * sample + sign];
            }
        }
    }
}

/// One instant's rows before the filter: for all joints the values, and the torque.
struct Unfiltered {
    now: Instant,
    values: Vec<f64>,
}

/// Makes rows from instants that follow one another.
struct Builder {
    filter: Vec<f64>,
    every: usize,
    /// Samples of the grid until the next row.
    wait: usize,
    ring: VecDeque<Unfiltered>,
    friction: Vec<Friction>,
    data: Data,
    regressor: DMatrix<f64>,
    state: [Vec<f64>; 3],
}

impl Builder {
    fn new(robot: &Robot<'_>, friction: &[Friction], sampling: &Sampling) -> Self {
        let n = robot.model.joint_count();
        Self {
            filter: sampling.filter(),
            every: sampling.every,
            wait: 0,
            ring: VecDeque::new(),
            friction: friction.to_vec(),
            data: Data::new(robot.model),
            regressor: DMatrix::zeros(n, PARAMETERS * robot.bodies),
            state: [robot.rest.clone(), vec![0.0; n], vec![0.0; n]],
        }
    }

    fn restart(&mut self) {
        self.ring.clear();
        self.wait = 0;
        self.friction.iter_mut().for_each(Friction::restart);
    }

    fn take(&mut self, robot: &Robot<'_>, rows: &mut Rows, log: usize, now: Instant) {
        let [q, dq, ddq] = &mut self.state;
        for (k, &joint) in robot.measured.iter().enumerate() {
            (q[joint], dq[joint], ddq[joint]) = (now.q[k], now.dq[k], now.ddq[k]);
        }
        joint_torque_regressor(robot.model, &mut self.data, q, dq, ddq, &mut self.regressor);
        let mut values = Vec::with_capacity(rows.of.iter().map(|r| r.place.len()).sum());
        for (k, (joint, own)) in robot.measured.iter().zip(&rows.of).enumerate() {
            let rigid = own.place.len() - TERMS.len();
            values.extend(
                own.place[..rigid]
                    .iter()
                    .map(|&p| self.regressor[(*joint, p)]),
            );
            values.extend(self.friction[k].terms(now.q[k], now.dq[k], now.ddq[k]));
        }
        self.ring.push_back(Unfiltered { now, values });
        if self.ring.len() > self.filter.len() {
            self.ring.pop_front();
        }
        if self.ring.len() < self.filter.len() {
            return;
        }
        if self.wait == 0 {
            self.row(rows, log);
            self.wait = self.every;
        }
        self.wait -= 1;
    }

    /// The filtered row at the middle of the ring.
    fn row(&self, rows: &mut Rows, log: usize) {
        let Some(middle) = self.ring.get(self.filter.len() / 2) else {
            return;
        };
        let mut values = vec![0.0; middle.values.len()];
        let mut tau = vec![0.0; middle.now.tau.len()];
        for (sample, w) in self.ring.iter().zip(&self.filter) {
            values
                .iter_mut()
                .zip(&sample.values)
                .for_each(|(sum, x)| *sum += w * x);
            tau.iter_mut()
                .zip(&sample.now.tau)
                .for_each(|(sum, x)| *sum += w * x);
        }
        rows.stamps.push((log, middle.now.t));
        let mut rest = &values[..];
        for (k, own) in rows.of.iter_mut().enumerate() {
            let (mine, others) = rest.split_at(own.place.len());
            own.values.extend_from_slice(mine);
            own.tau.push(tau[k]);
            own.raw.push(middle.now.raw[k]);
            own.state
                .push([middle.now.q[k], middle.now.dq[k], middle.now.ddq[k]]);
            rest = others;
        }
    }
}
