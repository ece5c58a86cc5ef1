//! Held-out quarters: each is predicted by what the other three teach, choice of smoothing, terms
//! and weights included.

use super::consistent::{Factor, Prior};
use super::equations::{Grams, Weights};
use super::friction::{ALWAYS, Friction, TERMS};
use super::rows::{BLOCKS, Rows};
use super::select::Fit;
use nalgebra::DVector;

/// Quarters.
const QUARTERS: usize = 4;
/// Rows at both ends of a quarter that share samples with its neighbours.
const GUARD: usize = 5;
/// Smoothed sign of the velocity, filtered, from which a joint counts as moving.
const MOVING: f64 = 0.9;
/// Student's t of 95 % for 15 degrees of freedom.
const STUDENT: f64 = 2.13;

/// Predictions that are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// The URDF's inertias with friction fitted.
    Urdf,
    /// Base parameters without bounds or prior.
    Base,
    /// The inertias that are written.
    Identified,
    /// Ordinary least squares: base parameters, Coulomb and viscous friction, offset.
    Plain,
}

/// All of them.
pub const MODELS: [Model; 4] = [Model::Urdf, Model::Base, Model::Identified, Model::Plain];

/// A sample of a held-out quarter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Log and time, s.
    pub at: (usize, f64),
    /// Block.
    pub block: usize,
    /// tau, low-passed as the regressor is.
    pub tau: f64,
    /// tau as logged.
    pub raw: f64,
    /// Predictions, in the order of [`MODELS`].
    pub predicted: [f64; 4],
    /// Standard deviation that the fit expects.
    pub sigma: f64,
    /// The joint moves, for all of the filter's time.
    pub moving: bool,
}

/// A joint on held-out quarters.
#[derive(Debug, Clone, Default)]
pub struct Judged {
    /// Every sample.
    pub moments: Vec<Moment>,
}

impl Judged {
    fn rms(&self, of: impl Fn(&Moment) -> f64) -> f64 {
        let sum: f64 = self.moments.iter().map(|m| of(m).powi(2)).sum();
        (sum / self.moments.len().max(1) as f64).sqrt()
    }

    /// RMS of the torque about zero.
    #[must_use]
    pub fn torque(&self) -> f64 {
        self.rms(|m| m.tau)
    }

    /// RMS of the torque about its mean.
    #[must_use]
    pub fn deviation(&self) -> f64 {
        let mean =
            self.moments.iter().map(|m| m.tau).sum::<f64>() / self.moments.len().max(1) as f64;
        self.rms(|m| m.tau - mean)
    }

    /// Largest torque.
    #[must_use]
    pub fn largest(&self) -> f64 {
        self.moments
            .iter()
            .fold(0.0, |most, m| most.max(m.tau.abs()))
    }

    /// RMS of a model's residual.
    #[must_use]
    pub fn residual(&self, model: Model) -> f64 {
        self.rms(|m| m.tau - m.predicted[model as usize])
    }

    /// RMS of a model's residual while the joint moves, and while it rests or turns back: static
    /// friction then hides up to Coulomb's torque. None where it never does.
    #[must_use]
    pub fn in_motion_and_at_rest(&self, model: Model) -> [Option<f64>; 2] {
        [true, false].map(|moving| {
            let moments = self.moments.iter().filter(|m| m.moving == moving);
            let moments: Vec<Moment> = moments.copied().collect();
            (!moments.is_empty()).then(|| Self { moments }.residual(model))
        })
    }

    /// RMS of a model's residual against the torque as logged, noise and ripple included.
    #[must_use]
    pub fn raw_residual(&self, model: Model) -> f64 {
        self.rms(|m| m.raw - m.predicted[model as usize])
    }

    /// RMS of a model's residual in each quarter.
    #[must_use]
    pub fn quarters(&self, model: Model) -> [f64; QUARTERS] {
        let each = self.of_parts(QUARTERS, |m| m.tau - m.predicted[model as usize]);
        std::array::from_fn(|k| each.get(k).copied().unwrap_or(0.0).sqrt())
    }

    /// 95 % interval of the RMS of a model's residual, blocks taken as independent.
    #[must_use]
    pub fn interval(&self, model: Model) -> (f64, f64) {
        let parts = self.of_parts(BLOCKS, |m| m.tau - m.predicted[model as usize]);
        let (mean, half) = mean_and_half(&parts);
        ((mean - half).max(0.0).sqrt(), (mean + half).sqrt())
    }

    /// Difference of mean squares, identified less URDF, and half of its 95 % interval: above zero
    /// the URDF predicts better.
    #[must_use]
    pub fn against_urdf(&self) -> (f64, f64) {
        let square = |m: &Moment, model: Model| (m.tau - m.predicted[model as usize]).powi(2);
        let parts: Vec<f64> = self
            .blocks(BLOCKS)
            .iter()
            .map(|part| {
                let sum: f64 = part
                    .iter()
                    .map(|m| square(m, Model::Identified) - square(m, Model::Urdf))
                    .sum();
                sum / part.len().max(1) as f64
            })
            .collect();
        mean_and_half(&parts)
    }

    /// RMS of residual over the expected deviation: 1 where sigma is right.
    #[must_use]
    pub fn sigma_check(&self) -> f64 {
        self.rms(|m| (m.tau - m.predicted[Model::Identified as usize]) / m.sigma.max(1e-12))
    }

    fn blocks(&self, parts: usize) -> Vec<Vec<&Moment>> {
        let mut all = vec![Vec::new(); parts];
        for moment in &self.moments {
            all[moment.block * parts / BLOCKS].push(moment);
        }
        all.retain(|part| !part.is_empty());
        all
    }

    fn of_parts(&self, parts: usize, of: impl Fn(&Moment) -> f64) -> Vec<f64> {
        let square = |part: &Vec<&Moment>| {
            part.iter().map(|m| of(m).powi(2)).sum::<f64>() / part.len() as f64
        };
        self.blocks(parts).iter().map(square).collect()
    }
}

fn mean_and_half(parts: &[f64]) -> (f64, f64) {
    let n = parts.len().max(2) as f64;
    let mean = parts.iter().sum::<f64>() / n;
    let variance = parts.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, STUDENT * (variance / n).sqrt())
}

/// Fits to three quarters, four times, and predicts the other one. None where a fit fails.
#[must_use]
pub fn held_out(
    candidates: &mut [Rows],
    middle: usize,
    prior: &Prior,
    friction: &[Friction],
    mut progress: impl FnMut(usize),
) -> Option<Vec<Judged>> {
    let joints = friction.len();
    let mut judged = vec![Judged::default(); joints];
    for quarter in 0..QUARTERS {
        progress(quarter);
        let per = BLOCKS / QUARTERS;
        let out = quarter * per..(quarter + 1) * per;
        let train: Vec<usize> = (0..BLOCKS).filter(|b| !out.contains(b)).collect();
        let fit = Fit::new(candidates, middle, &train, prior, friction)?;
        let plain = plain(&candidates[middle], &train, friction)?;
        let predictions = Predictions {
            urdf: &fit.urdf,
            base: &fit.base,
            identified: &fit.consistent,
            plain: &plain,
            sigma: &fit.sigma,
        };
        let (rows, peer) = (&candidates[fit.candidate], &candidates[middle]);
        let all: Vec<usize> = (0..rows.len())
            .filter(|k| out.contains(&rows.block[*k]))
            .collect();
        let inside = all
            .get(GUARD..all.len().saturating_sub(GUARD))
            .unwrap_or(&[]);
        for (joint, judged) in judged.iter_mut().enumerate() {
            judged.moments.extend(
                inside
                    .iter()
                    .map(|&k| predictions.moment(rows, peer, joint, k)),
            );
        }
    }
    Some(judged)
}

/// Solutions that predict rows.
pub(super) struct Predictions<'a> {
    pub(super) urdf: &'a DVector<f64>,
    pub(super) base: &'a DVector<f64>,
    pub(super) identified: &'a DVector<f64>,
    pub(super) plain: &'a DVector<f64>,
    pub(super) sigma: &'a [f64],
}

impl Predictions<'_> {
    /// One sample; `peer` holds the rows of ordinary least squares.
    fn moment(&self, rows: &Rows, peer: &Rows, joint: usize, k: usize) -> Moment {
        let own = &rows.of[joint];
        Moment {
            at: rows.stamps[k],
            block: rows.block[k],
            tau: own.tau[k],
            raw: own.raw[k],
            predicted: [
                own.torque(k, self.urdf),
                own.torque(k, self.base),
                own.torque(k, self.identified),
                peer.of[joint].torque(k, self.plain),
            ],
            sigma: self.sigma[joint],
            moving: own.sign(k).abs() > MOVING,
        }
    }

    /// Every joint on every row.
    pub(super) fn judge(&self, rows: &Rows, peer: &Rows) -> Vec<Judged> {
        let joint = |joint: usize| Judged {
            moments: (0..rows.len())
                .map(|k| self.moment(rows, peer, joint, k))
                .collect(),
        };
        (0..rows.joints).map(joint).collect()
    }
}

/// Ordinary least squares: all rows alike, Coulomb and viscous friction and offset; columns that
/// depend on one another share a tiny ridge.
pub(super) fn plain(rows: &Rows, train: &[usize], friction: &[Friction]) -> Option<DVector<f64>> {
    let ones = Weights::ones(rows);
    let normal = Grams::new(rows, &ones).normal(train, &ones.sigma);
    let keep: Vec<usize> = (0..rows.unknowns())
        .filter(|&place| {
            let term = place.checked_sub(rows.rigid);
            term.is_none_or(|t| {
                t % TERMS.len()
                    < if friction[t / TERMS.len()].moves {
                        ALWAYS
                    } else {
                        1
                    }
            })
        })
        .collect();
    let mut a = normal.a.select_rows(&keep).select_columns(&keep);
    (0..keep.len()).for_each(|i| a[(i, i)] = a[(i, i)] * (1.0 + 1e-9) + 1e-12);
    let y = Factor::new(&a)?.solve(&normal.m.select_rows(&keep));
    let mut x = DVector::zeros(rows.unknowns());
    keep.iter()
        .zip(&y)
        .for_each(|(&place, value)| x[place] = *value);
    Some(x)
}
