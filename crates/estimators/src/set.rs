//! All configured sources of one joint's torque, and their fusion.

use crate::fusion::{Fusion, MAX_SOURCES};
use crate::joint::{AnyEstimator, JointSample, JointTorqueEstimator};
use crate::role::{Places, Role};
use robot_state::{TorqueEstimate, torque_flags};

/// One source of a joint's torque.
pub struct Source {
    /// Its name, once in a set.
    pub name: String,
    /// Its part in the joint's torque.
    pub role: Role,
    /// The estimator.
    pub estimator: AnyEstimator,
}

/// Sources with their names, and their fusion if there is one.
pub struct EstimatorSet {
    names: Vec<String>,
    roles: Vec<Role>,
    places: Places,
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

impl EstimatorSet {
    /// A set of named sources, at most [`MAX_SOURCES`]; `fusion` must be of the same sources in the same
    /// order.
    #[must_use]
    pub fn new(sources: Vec<Source>, fusion: Option<Fusion>) -> Self {
        debug_assert!(sources.len() <= MAX_SOURCES);
        let estimates = vec![TorqueEstimate::default(); sources.len()];
        let roles: Vec<Role> = sources.iter().map(|source| source.role).collect();
        let (names, sources) = (sources.into_iter())
            .map(|source| (source.name, source.estimator))
            .unzip();
        Self {
            names,
            places: Places::of(roles.iter().copied().map(Some)),
            roles,
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

    /// Nothing has shown yet where an unknown zero is: so far the current has not been that of a drive that
    /// is on.
    fn zero_is_open(&self) -> bool {
        let zero = &self.zero;
        zero.parameters.unknown && self.places.current.is_some() && zero.started == 0
    }

    /// Moves the torsion's zero towards the one at which the gear carries `tau`.
    fn shift(&mut self, tau: f64, sigma: f64) {
        let p = self.zero.parameters;
        let gear = self.places.gear.and_then(|i| self.estimates.get(i));
        let Some(gear) = gear.filter(|e| e.flags & torque_flags::VALID != 0 && tau.is_finite())
        else {
            return;
        };
        if p.stiffness > 0.0 {
            self.zero.torsion += ZERO_STEP * (gear.tau - tau) / p.stiffness;
        }
        for (i, source) in self.sources.iter_mut().enumerate() {
            // Current and feed-forward have zeros of their own.
            if !self.places.stand_apart(i) {
                source.tare(sigma);
            }
        }
    }

    /// Moves the zero of the feed-forward towards the one at which it is `tau`.
    fn shift_feed_forward(&mut self, tau: f64, sigma: f64, share: f64) {
        let Some(i) = self.places.model else {
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
        if !self.zero.parameters.unknown || self.zero.started >= START_SAMPLES {
            return;
        }
        let current = self
            .places
            .current
            .and_then(|i| self.estimates.get(i))
            .copied();
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

    /// The sources' parts in the joint's torque, in order.
    #[must_use]
    pub fn roles(&self) -> &[Role] {
        &self.roles
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
        let current = self.places.current;
        let all = self.sources.iter_mut().zip(&mut self.estimates);
        for (i, (source, estimate)) in all.enumerate() {
            // The torsion's zero is no way of the rotor, along which friction builds up.
            let of_current = Some(i) == current;
            *estimate = source.update(if of_current { read } else { sample });
        }
        if let Some(estimate) = current.and_then(|i| self.estimates.get_mut(i)) {
            estimate.tau -= zero.current;
        }
        if let Some(estimate) = self.places.model.and_then(|i| self.estimates.get_mut(i)) {
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
        if self.zero_is_open() {
            self.fused.flags &= !torque_flags::VALID;
        }
        self.fused
    }

    fn tare_to(&mut self, tau: f64, sigma: f64) {
        let current = self.places.current;
        self.zero.started = START_SAMPLES;
        self.shift(tau, sigma);
        // After a sample without one it is another tare: the mean begins anew.
        self.zero.tared = match self.zero.since {
            0 | 1 => self.zero.tared.saturating_add(1),
            _ => 1,
        };
        self.zero.since = 0;
        let share = 1.0 / f64::from(self.zero.tared.min(START_SAMPLES));
        let shown = current.and_then(|i| self.estimates.get(i));
        if let Some(estimate) = shown.filter(|e| e.flags & torque_flags::VALID != 0) {
            self.zero.current += share * (estimate.tau - tau);
            if let Some(source) = current.and_then(|i| self.sources.get_mut(i)) {
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
        let gear = self.places.gear?;
        let held_back = self.sources.get(gear)?.undelayed()? - self.estimates.get(gear)?.tau;
        let usable = torque_flags::VALID | torque_flags::SATURATED;
        let valid = self.fused.flags & usable == torque_flags::VALID;
        valid.then_some(self.fused.tau + held_back)
    }

    fn show(&mut self, tau: f64, sigma: f64) -> f64 {
        let gear = self.places.gear;
        let source = gear.and_then(|i| self.sources.get_mut(i));
        source.map_or(0.0, |source| source.show(tau, sigma))
    }

    /// That of the gear, by its weight in the fused torque: of minimum variance it is the quotient of both variances.
    fn past(&self) -> f64 {
        let gear = self.places.gear;
        let gear = gear.and_then(|i| self.sources.get(i).zip(self.estimates.get(i)));
        gear.map_or(0.0, |(source, estimate)| {
            let quotient = self.fused.sigma / estimate.sigma.max(f64::MIN_POSITIVE);
            source.past() * quotient.min(1.0).powi(2)
        })
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
