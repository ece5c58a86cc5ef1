//! All configured sources of one joint's torque, and their fusion.

use crate::fusion::{Fusion, MAX_SOURCES};
use crate::joint::{AnyEstimator, JointSample, JointTorqueEstimator};
use robot_state::{TorqueEstimate, torque_flags};

/// Sources with their names, and their fusion if there is one.
pub struct EstimatorSet {
    names: Vec<String>,
    sources: Vec<AnyEstimator>,
    estimates: Vec<TorqueEstimate>,
    fusion: Option<Fusion>,
    fused: TorqueEstimate,
    zero: Zero,
}

/// The torsion's zero: known from the fit, or found again after each start.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ZeroParameters {
    /// Whether the encoders' zeros are others after each start: the torque from the current then sets
    /// the torsion's zero, until a tare at a known torque.
    pub unknown: bool,
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// Stiffness of the gear, N·m/rad.
    pub stiffness: f64,
    /// The sources from the gear with slipping springs and from the current.
    pub gear: Option<usize>,
    /// That from the current.
    pub current: Option<usize>,
    /// That from the feed-forward.
    pub feed_forward: Option<usize>,
}

/// The zero in use.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Zero {
    parameters: ZeroParameters,
    /// Torsion without torque, rad, and torque of the current without torque, N·m.
    torsion: f64,
    current: f64,
    /// Torque of the feed-forward without torque, N·m.
    feed_forward: f64,
    /// Samples of the tare so far, and samples since its last one.
    tared: u32,
    since: u32,
    /// Samples since the start during which an unknown zero follows the current.
    started: u32,
}

/// Samples over which an unknown zero follows the current.
const START_SAMPLES: u32 = 50;
/// Share of a step to the zero in one sample.
const ZERO_STEP: f64 = 0.3;

impl Zero {
    /// Nothing has shown yet where an unknown zero is: so far the current has not been that of a drive that
    /// is on.
    fn is_open(&self) -> bool {
        self.parameters.unknown && self.parameters.current.is_some() && self.started == 0
    }
}

impl EstimatorSet {
    /// A set of named sources, at most [`MAX_SOURCES`]; `fusion` must be of the same sources in the same
    /// order.
    #[must_use]
    pub fn new(sources: Vec<(String, AnyEstimator)>, fusion: Option<Fusion>) -> Self {
        debug_assert!(sources.len() <= MAX_SOURCES);
        let (names, sources): (Vec<_>, Vec<_>) = sources.into_iter().unzip();
        let estimates = vec![TorqueEstimate::default(); sources.len()];
        Self {
            names,
            sources,
            estimates,
            fusion,
            fused: TorqueEstimate::default(),
            zero: Zero::default(),
        }
    }

    /// The same with a zero that may have to be found.
    #[must_use]
    pub fn with_zero(mut self, parameters: ZeroParameters) -> Self {
        self.zero.parameters = parameters;
        self
    }

    /// Moves the torsion's zero towards the one at which the gear carries `tau`.
    fn shift(&mut self, tau: f64, sigma: f64) {
        let p = self.zero.parameters;
        let gear = p.gear.and_then(|i| self.estimates.get(i));
        let Some(gear) = gear.filter(|e| e.flags & torque_flags::VALID != 0 && tau.is_finite())
        else {
            return;
        };
        if p.stiffness > 0.0 {
            self.zero.torsion += ZERO_STEP * (gear.tau - tau) / p.stiffness;
        }
        for (i, source) in self.sources.iter_mut().enumerate() {
            // Current and feed-forward have zeros of their own.
            if Some(i) != p.feed_forward && Some(i) != p.current {
                source.tare(sigma);
            }
        }
    }

    /// Moves the zero of the feed-forward towards the one at which it is `tau`.
    fn shift_feed_forward(&mut self, tau: f64, sigma: f64, share: f64) {
        let Some(i) = self.zero.parameters.feed_forward else {
            return;
        };
        let valid = |e: &&TorqueEstimate| e.flags & torque_flags::VALID != 0;
        if let Some(estimate) = self.estimates.get(i).filter(valid) {
            self.zero.feed_forward += share * (estimate.tau - tau);
            if let Some(source) = self.sources.get_mut(i) {
                source.tare(sigma);
            }
        }
    }

    /// Lets an unknown zero follow the current after the start.
    fn find_zero(&mut self) {
        let p = self.zero.parameters;
        if !p.unknown || self.zero.started >= START_SAMPLES {
            return;
        }
        let current = p.current.and_then(|i| self.estimates.get(i)).copied();
        if let Some(current) = current.filter(|e| e.flags & torque_flags::VALID != 0) {
            self.zero.started += 1;
            self.shift(current.tau, current.sigma);
        }
    }

    /// The sources' names, in order.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Each source's own estimate of the last sample.
    #[must_use]
    pub fn estimates(&self) -> &[TorqueEstimate] {
        &self.estimates
    }

    /// How the fused sources differ from the feed-forward beyond the slow part, N·m, and the share of
    /// motion; none without a feed-forward.
    #[must_use]
    pub fn change(&self) -> Option<(f64, f64)> {
        self.fusion.as_ref()?.change()
    }

    /// Whether the sources are fused.
    #[must_use]
    pub fn fuses(&self) -> bool {
        self.fusion.is_some()
    }
}

impl JointTorqueEstimator for EstimatorSet {
    /// The fused torque; without a fusion, the first source that is valid.
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        let zero = self.zero;
        self.zero.since = zero.since.saturating_add(1);
        let read = sample;
        let sample = &JointSample {
            theta: sample.theta - zero.parameters.gear_ratio * zero.torsion,
            ..*sample
        };
        let current = zero.parameters.current;
        let all = self.sources.iter_mut().zip(&mut self.estimates);
        for (i, (source, estimate)) in all.enumerate() {
            // The torsion's zero is no way of the rotor, along which friction builds up.
            let of_current = Some(i) == current;
            *estimate = source.update(if of_current { read } else { sample });
        }
        if let Some(estimate) = current.and_then(|i| self.estimates.get_mut(i)) {
            estimate.tau -= zero.current;
        }
        let feed_forward = zero.parameters.feed_forward;
        if let Some(estimate) = feed_forward.and_then(|i| self.estimates.get_mut(i)) {
            estimate.tau -= zero.feed_forward;
        }
        self.find_zero();
        self.fused = match &mut self.fusion {
            Some(fusion) => {
                let fused = fusion.update(sample, &self.estimates);
                // A source's own sigma does not cover what the fit found out about its errors.
                for (estimate, sigma) in self.estimates.iter_mut().zip(fusion.sigmas()) {
                    if sigma.is_finite() {
                        estimate.sigma = *sigma;
                    }
                }
                fused
            }
            None => {
                let valid = |e: &&TorqueEstimate| e.flags & torque_flags::VALID != 0;
                self.fused.flags &= !torque_flags::VALID;
                self.estimates
                    .iter()
                    .find(valid)
                    .copied()
                    .unwrap_or(self.fused)
            }
        };
        if self.zero.is_open() {
            self.fused.flags &= !torque_flags::VALID;
        }
        self.fused
    }

    fn tare_to(&mut self, tau: f64, sigma: f64) {
        let p = self.zero.parameters;
        self.zero.started = START_SAMPLES;
        self.shift(tau, sigma);
        // After a sample without one it is another tare: the mean begins anew.
        self.zero.tared = match self.zero.since {
            0 | 1 => self.zero.tared.saturating_add(1),
            _ => 1,
        };
        self.zero.since = 0;
        let share = 1.0 / f64::from(self.zero.tared.min(START_SAMPLES));
        let current = p.current.and_then(|i| self.estimates.get(i));
        if let Some(estimate) = current.filter(|e| e.flags & torque_flags::VALID != 0) {
            self.zero.current += share * (estimate.tau - tau);
            if let Some(source) = p.current.and_then(|i| self.sources.get_mut(i)) {
                source.tare(sigma);
            }
        }
        if let Some(fusion) = &mut self.fusion {
            fusion.tare(sigma);
        }
        self.shift_feed_forward(tau, sigma, share);
    }

    /// The fused torque with what the filter of the gear's torsion holds back.
    fn undelayed(&self) -> Option<f64> {
        let gear = self.zero.parameters.gear?;
        let held_back = self.sources.get(gear)?.undelayed()? - self.estimates.get(gear)?.tau;
        let usable = torque_flags::VALID | torque_flags::SATURATED;
        let valid = self.fused.flags & usable == torque_flags::VALID;
        valid.then_some(self.fused.tau + held_back)
    }

    fn show(&mut self, tau: f64, sigma: f64) -> f64 {
        let gear = self.zero.parameters.gear;
        let source = gear.and_then(|i| self.sources.get_mut(i));
        source.map_or(0.0, |source| source.show(tau, sigma))
    }

    fn disagrees(&self) -> bool {
        self.fusion.as_ref().is_some_and(Fusion::disagrees)
    }

    fn reset(&mut self) {
        self.sources.iter_mut().for_each(|source| source.reset());
        self.estimates.fill(TorqueEstimate::default());
        self.fused = TorqueEstimate::default();
        self.zero = Zero {
            parameters: self.zero.parameters,
            ..Zero::default()
        };
        if let Some(fusion) = &mut self.fusion {
            fusion.reset();
        }
    }
}
