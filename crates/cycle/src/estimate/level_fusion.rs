//! Level of a joint's delay-compensated torque: of F/T sensors and of encoders, each by what is known of it.
//!
//! In: the torque of [`DelayCompensator`](whole_body::DelayCompensator), whose level is that of F/T sensors and rigid-body
//! model; how far that level is above the encoders' torque of the same instant; the standard deviations of both.
//! Out: the torque on a level between, and its standard deviation. An F/T sensor errs by its offset, by a share of
//! what it bears, and by the model's masses between it and the joint; a gear by what its calibration did not show and
//! by its past. Which is less depends on the joint: at a hip it is often the gear, at a wrist the sensor.
//!
//! ```text
//! tau = tau_hat - (1 - w) d       d: that torque less the encoders', of the same sample, over 50 ms
//! w = s_e² / (s_e² + s_l²)        minimum variance of two independent sources
//! ```
//!
//! A gear's past is what F/T sensors have shown to the encoders' torque already. What is left of its variance then is
//! that of their own errors, so `s_e` is that of the calibration alone.
//!
//! Where both are further apart than their standard deviations allow, one of them is wrong, and that by more than it
//! is known: a slipped count, a drifting encoder. There the level is that of the F/T sensors alone, as the cross-check
//! finds out which one it is.

use robot_state::{TorqueEstimate, torque_flags};

/// Time over which the levels' difference is averaged that is judged, s: as long as the level of the torque that is fed
/// back.
const LEVEL_TIME: f64 = 0.5;
/// Time over which the correction of the torque is averaged, s: longer than encoders' noise. With 0.5 s the humanoid's
/// fused torque has 0.931 times the error of that from encoders instead of 0.904 (benches/fusion).
const AVERAGING_TIME: f64 = 0.05;
/// Standard deviations of the difference by which the sources contradict each other.
const APART: f64 = 3.0;
/// Square of the difference over its variance up to which both are as good as their standard deviations.
const AGREEMENT: f64 = 4.0;

/// Error of the fast source over its standard deviation, which covers what a calibration may have missed: medians of the
/// calibrated humanoid's and leg's joints are 0.76 and 0.60 (benches/fusion, seeds 1 and 3).
const OF_FAST_SIGMA: f64 = 0.7;
/// Least share of the fast source's variance that is not by its past.
const LEAST_OWN: f64 = 1e-3;

/// Knowledge of the levels at a sample.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Levels {
    /// The delayed source's torque less that of the fast one, of one instant, N·m.
    pub(super) difference: f64,
    /// The torque on the delayed source's level less that of the fast source, both of this sample, N·m.
    pub(super) now: f64,
    /// Standard deviation of the fast source's torque, N·m, and that by its past, which the delayed one shows it.
    pub(super) fast_sigma: [f64; 2],
    /// Standard deviations of the delayed source's torque, N·m: that which the compensator was given, and that of
    /// errors that last.
    pub(super) delayed_sigma: [f64; 2],
}

/// See the module. One joint.
#[derive(Debug, Clone)]
pub(super) struct LevelFusion {
    /// Shares of a new sample in the averages of difference and correction.
    level_share: f64,
    share: f64,
    torque_limit: f64,
    /// d, N·m; none before the first one.
    difference: Option<f64>,
    /// (1 - w) of what is now, averaged, N·m; none before the first one.
    correction: Option<f64>,
}

impl LevelFusion {
    /// Before the first sample; `sample_period` in s, `torque_limit`: largest |tau| that is reported, N·m.
    #[must_use]
    pub(super) fn new(sample_period: f64, torque_limit: f64) -> Self {
        Self {
            level_share: (sample_period / LEVEL_TIME).min(1.0),
            share: (sample_period / AVERAGING_TIME).min(1.0),
            torque_limit,
            difference: None,
            correction: None,
        }
    }

    /// Moves `estimate` to the level; `None`: one of the sources is not valid, and the level becomes that of the
    /// delayed one.
    pub(super) fn update(&mut self, levels: Option<Levels>, estimate: &mut TorqueEstimate) {
        let finite = |l: &Levels| {
            let [noise, lasting] = l.delayed_sigma;
            let [fast, past] = l.fast_sigma;
            let all = [l.difference, l.now, fast, past, noise, lasting];
            all.iter().all(|x| x.is_finite()) && fast > 0.0
        };
        let Some(levels) = levels.filter(finite) else {
            if let Some(correction) = &mut self.correction {
                *correction -= self.share * *correction;
                estimate.tau -= *correction;
            }
            self.clamp(estimate);
            return;
        };
        let difference = self.difference.get_or_insert(levels.difference);
        *difference += self.level_share * (levels.difference - *difference);
        let [fast, past] = levels
            .fast_sigma
            .map(|sigma| (OF_FAST_SIGMA * sigma).powi(2));
        let [known, lasting] = levels.delayed_sigma.map(|sigma| sigma * sigma);
        let delayed = known + lasting;
        let own = (fast - past).max(LEAST_OWN * fast);
        // Knowledge of the past by the delayed source errs as that source does, and counts no second time.
        let apart = own + (past - own - delayed).max(0.0);
        let chi = *difference * *difference / (fast + delayed);
        //= T Level: w = s_e^2 / (s_e^2 + s_l^2)
        let of_fast = delayed / (apart + delayed);
        let agree = 1.0 / (1.0 + (chi / (APART * APART)).powi(4));
        let share = of_fast * agree;
        let asked = share * levels.now;
        self.correction = match self.correction {
            Some(correction) => Some(correction + self.share * (asked - correction)),
            None => Some(asked),
        };
        estimate.tau -= self.correction.unwrap_or(0.0);
        let both = (1.0 - share).powi(2) * delayed + share * share * fast;
        let level = both * (chi / AGREEMENT).max(1.0);
        let changes = (estimate.sigma * estimate.sigma - known).max(0.0);
        estimate.sigma = (changes + level).sqrt();
        self.clamp(estimate);
    }

    fn clamp(&self, estimate: &mut TorqueEstimate) {
        if estimate.tau.abs() > self.torque_limit {
            estimate.flags |= torque_flags::SATURATED;
            // max and min, not clamp: they cannot panic.
            estimate.tau = estimate.tau.max(-self.torque_limit).min(self.torque_limit);
        }
    }
}

#[cfg(test)]
mod tests;
