//! Held-out blocks and regimes of motion, as network and Gaussian processes share them.

use crate::record::Record;
use estimators::low_pass::LowPass;
use estimators::regimes::{Motion, Regime, Regimes};

/// Takes the share of a training that is done, 0 to 1, and its present step.
pub type Progress<'a> = &'a mut dyn FnMut(f64, &str);

/// Length of a block, s: neighbouring samples are alike, so whole blocks are held out.
const BLOCK_S: f64 = 0.7;
/// One block of this many is held out.
const HOLD_OUT_INTERVAL: usize = 5;
/// Unused time on both sides of a held-out block, s.
const GUARD_S: f64 = 0.05;
/// Time over which |dq| is averaged to distinguish motion from rest, s.
const MOTION_S: f64 = 0.05;
/// Samples below which a regime counts as unseen.
const MIN_REGIME_SAMPLES: usize = 300;

/// Time constant of the zero-phase filter of the learned signal, s: short, as at speed the gear's
/// kinematic error makes real torques of some ten hertz.
const ZERO_PHASE_S: f64 = 0.002;

/// A signal through the same low-pass forwards and backwards, without delay.
#[must_use]
pub fn zero_phase(record: &Record, signal: &[f64]) -> Vec<f64> {
    let pole = (-record.sample_period / ZERO_PHASE_S).exp();
    let mut filter = LowPass::new(pole);
    let mut out: Vec<f64> = signal.iter().map(|x| filter.update(*x)).collect();
    filter.reset();
    out.iter_mut().rev().for_each(|x| *x = filter.update(*x));
    out
}

/// Use of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// Training.
    Train,
    /// Validation.
    HeldOut,
    /// None: not usable, or between the two.
    Nothing,
}

/// Use of each sample of a record.
#[must_use]
pub fn uses(record: &Record) -> Vec<Use> {
    let t = record.sample_period;
    let block = ((BLOCK_S / t) as usize).max(1);
    let guard = (GUARD_S / t) as usize;
    let of = |i: usize| {
        if !record.usable(i) || !record.tau[i].is_finite() {
            return Use::Nothing;
        }
        let (number, inside) = (i / block, i % block);
        if number % HOLD_OUT_INTERVAL == HOLD_OUT_INTERVAL - 1 {
            Use::HeldOut
        } else {
            let before =
                number % HOLD_OUT_INTERVAL == HOLD_OUT_INTERVAL - 2 && inside + guard >= block;
            let after = number > 0 && number % HOLD_OUT_INTERVAL == 0 && inside < guard;
            if before || after {
                Use::Nothing
            } else {
                Use::Train
            }
        }
    };
    (0..record.samples.len()).map(of).collect()
}

/// Indices of the samples of one use, at most about `most`, evenly spread.
#[must_use]
pub fn of_use(uses: &[Use], which: Use, most: usize) -> Vec<usize> {
    let all: Vec<usize> = (0..uses.len()).filter(|&i| uses[i] == which).collect();
    let step = all.len().div_ceil(most.max(1)).max(1);
    all.into_iter().step_by(step).collect()
}

/// Regimes of a record without figures, and the share of motion at each sample.
#[must_use]
pub fn motion(record: &Record) -> (Regimes, Vec<f64>) {
    let fastest = record.motion.iter().fold(0.0f64, |m, v| m.max(v[0].abs()));
    let unseen = Regime {
        gain: 0.0,
        sigma: 0.0,
    };
    let regimes = Regimes {
        speed: (0.02 * fastest).max(1e-4),
        time_constant: MOTION_S,
        sample_period: record.sample_period,
        rest: unseen,
        moving: unseen,
    };
    let mut motion = Motion::default();
    let shares = record.samples.iter().map(|s| motion.update(s, &regimes));
    let shares = shares.collect();
    (regimes, shares)
}

/// One held-out sample: share of motion, learned value, true value.
pub type Judged = (f64, f64, f64);

/// Figures of one regime: the gain of least squares within 0 and 1, and the error it leaves.
/// `unseen` is the sigma of a regime with too few samples.
#[must_use]
pub fn judge(judged: &[Judged], moving: bool, fixed_gain: Option<f64>, unseen: f64) -> Regime {
    let own: Vec<&Judged> = judged.iter().filter(|j| (j.0 > 0.5) == moving).collect();
    if own.len() < MIN_REGIME_SAMPLES {
        return Regime {
            gain: 0.0,
            sigma: unseen,
        };
    }
    let sum = |f: &dyn Fn(&Judged) -> f64| own.iter().map(|j| f(j)).sum::<f64>();
    let gain = fixed_gain.unwrap_or_else(|| {
        let (along, square) = (sum(&|j| j.1 * j.2), sum(&|j| j.1 * j.1));
        (along / square.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
    });
    let left = sum(&|j| (j.2 - gain * j.1).powi(2));
    Regime {
        gain,
        sigma: (left / own.len() as f64).sqrt(),
    }
}
