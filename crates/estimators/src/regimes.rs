//! Errors of a learned estimator at rest and in motion.
//!
//! A correction learned from a joint in motion is easily worse than none for the joint at rest,
//! where friction may have either sign, and inputs alone do not distinguish the two: a joint that
//! turns back has no velocity either. So each regime has figures of its own, from data that the
//! training did not see: no gain and the prior's variance where there were no data.

use crate::joint::JointSample;

/// Error of a learned torque in one regime, on data that its training did not see.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Regime {
    /// Share of the learned correction that is applied, 0 to 1.
    pub gain: f64,
    /// Standard deviation of the residual error, N·m.
    pub sigma: f64,
}

/// Both regimes and the velocity that separates them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Regimes {
    /// |dq| at which both count half, rad/s.
    pub speed: f64,
    /// Time over which |dq| is averaged, s.
    pub time_constant: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// At rest.
    pub rest: Regime,
    /// In motion.
    pub moving: Regime,
}

/// Follows a joint from one regime to the other.
#[derive(Debug, Clone, Copy, Default)]
pub struct Motion {
    /// Averaged |dq|, rad/s.
    speed: Option<f64>,
}

impl Motion {
    /// Share of motion in the present regime, 0 to 1.
    pub fn update(&mut self, sample: &JointSample, regimes: &Regimes) -> f64 {
        let now = sample.dq.abs().min(1e6);
        let last = self.speed.unwrap_or(now);
        let step = regimes.sample_period / (regimes.time_constant + regimes.sample_period);
        let speed = last + step * (now - last);
        self.speed = Some(speed);
        let ratio = speed / regimes.speed.max(f64::MIN_POSITIVE);
        let square = (ratio * ratio).min(1e12);
        square / (1.0 + square)
    }
}

impl Regimes {
    /// Gain and sigma at a share of motion; variances mix like the regimes.
    #[must_use]
    pub fn mix(&self, moving: f64) -> Regime {
        let rest = 1.0 - moving;
        let (r, m) = (self.rest, self.moving);
        Regime {
            gain: rest * r.gain + moving * m.gain,
            sigma: (rest * r.sigma * r.sigma + moving * m.sigma * m.sigma).sqrt(),
        }
    }
}
