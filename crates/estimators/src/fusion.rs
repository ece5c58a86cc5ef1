//! One torque from several sources: a mean of those whose variance is near the least.
//!
//! The errors of the sources are strongly correlated (most depend on the same torsion), and the
//! correlation changes with the load: weights by the full covariance are optimal on the data they
//! were fitted to and wrong on others. So only a source whose variance is
//! within [`MAX_VARIANCE_RATIO`] of the least takes part, with the more weight the smaller its
//! variance. The variance is the one identified per regime (at rest or in motion, under steady or
//! changing load), raised when a source itself reports a larger sigma than it did then, as a learned
//! one does away from its data.

use crate::joint::JointSample;
use crate::output::Output;
use robot_state::{TorqueEstimate, torque_flags, torque_source};

/// Sources that can be fused, at most.
pub const MAX_SOURCES: usize = 12;
/// Bounds between the rates at which the load changes.
pub const BOUNDS: usize = 3;
/// Regimes: twice the number of bounds that the torsion's rate exceeds, and one more in motion.
pub const REGIMES: usize = 2 * (BOUNDS + 1);
/// A source whose variance exceeds the least of all by this factor has no weight.
pub const MAX_VARIANCE_RATIO: f64 = 2.0;

/// Errors of one source in one regime, as identified.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SourceError {
    /// Variance of the source's error, (N·m)².
    pub variance: f64,
    /// Root mean square of the sigma that the source reported during identification, N·m.
    pub reported: f64,
}

/// Weights of the sources, regime by regime.
#[derive(Debug, Clone, PartialEq)]
pub struct FusionParameters {
    /// |dq| above which the joint moves, rad/s.
    pub moving: f64,
    /// |rate of the torsion| at which the load changes slowly, faster, suddenly, rad/s.
    pub loading: [f64; BOUNDS],
    /// Per regime: the sources' errors, in the sources' order.
    pub errors: [Vec<SourceError>; REGIMES],
    /// Time over which the variances change from one regime to another, s.
    pub blend: f64,
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
}

/// Combines sources into one torque.
#[derive(Debug, Clone)]
pub struct Fusion {
    parameters: FusionParameters,
    sources: usize,
    /// Share of each regime in the present variances.
    shares: [f64; REGIMES],
    /// Torsion and its smoothed rate.
    torsion: Option<(f64, f64)>,
    output: Output,
}

impl Fusion {
    /// A fusion of at most [`MAX_SOURCES`] sources.
    #[must_use]
    pub fn new(sources: usize, parameters: FusionParameters) -> Self {
        debug_assert!(sources <= MAX_SOURCES);
        Self {
            output: Output::new(torque_source::FUSED, parameters.torque_limit, 0.0),
            shares: FIRST,
            sources: sources.min(MAX_SOURCES),
            torsion: None,
            parameters,
        }
    }

    /// The regime of a sample (see [`REGIMES`]); call once per sample, in order.
    pub fn regime(&mut self, sample: &JointSample) -> usize {
        let p = &self.parameters;
        let torsion = sample.theta / p.gear_ratio - sample.q;
        if !torsion.is_finite() {
            return 0;
        }
        let pole = p.sample_period / (p.blend + p.sample_period);
        let rate = match self.torsion {
            Some((last, rate)) => {
                let now = ((torsion - last) / p.sample_period).clamp(-1e3, 1e3);
                rate + pole * (now - rate)
            }
            None => 0.0,
        };
        self.torsion = Some((torsion, rate));
        let exceeded = p.loading.iter().filter(|bound| rate.abs() > **bound);
        2 * exceeded.count() + usize::from(sample.dq.abs() > p.moving)
    }

    /// Variance of a source's present estimate, (N·m)²; infinite if it is not valid.
    fn variance(&self, source: usize, estimate: &TorqueEstimate) -> f64 {
        if estimate.flags & torque_flags::VALID == 0 {
            return f64::INFINITY;
        }
        let (mut variance, mut reported) = (0.0, 0.0);
        for (share, errors) in self.shares.iter().zip(&self.parameters.errors) {
            let known = errors.get(source).copied().unwrap_or_default();
            variance += share * known.variance;
            reported += share * known.reported * known.reported;
        }
        let inflation = (estimate.sigma * estimate.sigma / reported.max(1e-18)).max(1.0);
        // Two sources without any error are as good as each other.
        variance.max(1e-18) * inflation
    }

    /// The fused torque of the sources' estimates of one sample.
    pub fn update(&mut self, sample: &JointSample, sources: &[TorqueEstimate]) -> TorqueEstimate {
        let regime = self.regime(sample);
        let p = &self.parameters;
        let step = p.sample_period / (p.blend + p.sample_period);
        for (r, share) in self.shares.iter_mut().enumerate() {
            *share += step * (f64::from(u8::from(r == regime)) - *share);
        }
        let mut variances = [f64::INFINITY; MAX_SOURCES];
        let count = self.sources.min(sources.len());
        for (i, (variance, source)) in variances.iter_mut().zip(sources).take(count).enumerate() {
            *variance = self.variance(i, source);
        }
        let least = variances.iter().copied().fold(f64::INFINITY, f64::min);
        if !least.is_finite() {
            return self.output.held();
        }
        let (mut sum, mut tau, mut delay, mut square) = (0.0, 0.0, 0.0, 0.0);
        let mut saturated = 0;
        for (source, variance) in sources.iter().zip(variances).take(count) {
            // Relative to the least: most for the best, down to 0 at the bound, without a step.
            let weight = (least / variance - 1.0 / MAX_VARIANCE_RATIO).max(0.0);
            if weight == 0.0 {
                continue;
            }
            sum += weight;
            tau += weight * source.tau;
            delay += weight * source.delay_s;
            // Errors count as fully correlated: averaging then reduces nothing.
            square += weight * variance;
            saturated |= source.flags & torque_flags::SATURATED;
        }
        let mut estimate = self.output.give(sample, tau / sum, (square / sum).sqrt());
        estimate.delay_s = delay / sum;
        estimate.flags |= saturated;
        estimate
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        self.torsion = None;
        self.shares = FIRST;
        self.output.reset();
    }
}

/// At first the joint counts as being at rest.
const FIRST: [f64; REGIMES] = {
    let mut shares = [0.0; REGIMES];
    shares[0] = 1.0;
    shares
};
