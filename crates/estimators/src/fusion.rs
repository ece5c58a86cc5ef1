//! One torque from several sources, weighted by what their errors have in common.
//!
//! The errors of the sources are correlated (most look at the same torsion), so the weights are
//! those of the best linear unbiased estimate under the errors' covariance, `w = C^-1 1 / (1' C^-1
//! 1)`, with a covariance identified per regime: at rest or in motion, under steady or changing
//! load. A source that is not valid drops out; negative weights are not taken.

use crate::joint::JointSample;
use crate::output::Output;
use robot_state::{TorqueEstimate, torque_flags, torque_source};

/// Most sources that can be fused.
pub const MAX_SOURCES: usize = 12;
/// Regimes: bit 0 in motion, bit 1 load changing.
pub const REGIMES: usize = 4;

/// How sources are weighted.
#[derive(Debug, Clone, PartialEq)]
pub struct FusionParameters {
    /// |dq| above which the joint moves, rad/s.
    pub moving: f64,
    /// |rate of the torsion| above which the load changes, rad/s.
    pub loading: f64,
    /// Per regime: covariance of the sources' errors, row by row, (N·m)².
    pub covariance: [Vec<f64>; REGIMES],
    /// Time over which the weights change from one regime to another, s.
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
    /// Per regime: weights and variance with every source valid.
    regimes: [([f64; MAX_SOURCES], f64); REGIMES],
    /// Share of each regime in the present weights.
    shares: [f64; REGIMES],
    /// Torsion and its smoothed rate.
    torsion: Option<(f64, f64)>,
    output: Output,
}

impl Fusion {
    /// A fusion of as many sources as the covariances have rows, at most [`MAX_SOURCES`].
    #[must_use]
    pub fn new(sources: usize, parameters: FusionParameters) -> Self {
        debug_assert!(sources <= MAX_SOURCES);
        let sources = sources.min(MAX_SOURCES);
        let regimes = std::array::from_fn(|r| weights(sources, &parameters.covariance[r]));
        let mut shares = [0.0; REGIMES];
        shares[0] = 1.0;
        Self {
            output: Output::new(torque_source::FUSED, parameters.torque_limit, 0.0),
            regimes,
            shares,
            sources,
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
        usize::from(sample.dq.abs() > p.moving) | usize::from(rate.abs() > p.loading) << 1
    }

    /// The torque that the sources' estimates of one sample amount to.
    pub fn update(&mut self, sample: &JointSample, sources: &[TorqueEstimate]) -> TorqueEstimate {
        let regime = self.regime(sample);
        let p = &self.parameters;
        let step = p.sample_period / (p.blend + p.sample_period);
        for (r, share) in self.shares.iter_mut().enumerate() {
            *share += step * (f64::from(u8::from(r == regime)) - *share);
        }
        let (mut sum, mut tau, mut delay, mut variance) = (0.0, 0.0, 0.0, 0.0);
        let mut saturated = 0;
        for (i, source) in sources.iter().enumerate().take(self.sources) {
            if source.flags & torque_flags::VALID == 0 {
                continue;
            }
            let by_regime = self.shares.iter().zip(&self.regimes);
            // A source that is left alone counts, whatever its weight among all.
            let weight = by_regime.map(|(share, (w, _))| share * w[i]).sum::<f64>() + 1e-9;
            sum += weight;
            tau += weight * source.tau;
            delay += weight * source.delay_s;
            // What a source says of itself beyond the ordinary counts in full.
            variance += weight * weight * source.sigma * source.sigma;
            if weight > 0.5 {
                saturated |= source.flags & torque_flags::SATURATED;
            }
        }
        if sum <= 0.0 {
            return self.output.held();
        }
        let by_regime = self.shares.iter().zip(&self.regimes);
        let expected: f64 = by_regime
            .map(|(share, (_, variance))| share * variance)
            .sum();
        let sigma = (variance / (sum * sum)).max(expected).sqrt();
        let mut estimate = self.output.give(sample, tau / sum, sigma);
        estimate.delay_s = delay / sum;
        estimate.flags |= saturated;
        estimate
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        self.torsion = None;
        self.shares = [0.0; REGIMES];
        self.shares[0] = 1.0;
        self.output.reset();
    }
}

/// Weights of least variance that are not negative, and that variance.
///
/// Sources whose weight comes out negative are dropped one by one, the worst first: with
/// covariances from data, a negative weight trusts a difference of errors that need not last.
fn weights(sources: usize, covariance: &[f64]) -> ([f64; MAX_SOURCES], f64) {
    let mut used: Vec<usize> = (0..sources).collect();
    let mut out = [0.0; MAX_SOURCES];
    let at = |i: usize, j: usize| covariance.get(i * sources + j).copied().unwrap_or(0.0);
    while !used.is_empty() {
        let n = used.len();
        let largest = used.iter().fold(1e-12f64, |m, &i| m.max(at(i, i)));
        let c = nalgebra::DMatrix::from_fn(n, n, |a, b| {
            // A trace of independence: two sources that agree in everything share their weight.
            at(used[a], used[b]) + if a == b { 1e-6 * largest } else { 0.0 }
        });
        let solved = c
            .cholesky()
            .map(|c| c.solve(&nalgebra::DVector::from_element(n, 1.0)));
        let Some(w) = solved else {
            // No covariance at all: the best alone.
            let best = used
                .iter()
                .copied()
                .min_by(|&a, &b| at(a, a).total_cmp(&at(b, b)));
            let best = best.unwrap_or(0);
            out[best] = 1.0;
            return (out, at(best, best));
        };
        let worst = (0..n).min_by(|&a, &b| w[a].total_cmp(&w[b])).unwrap_or(0);
        if w[worst] >= 0.0 || n == 1 {
            let sum = w.sum();
            for (i, w) in used.iter().zip(w.iter()) {
                out[*i] = w / sum;
            }
            return (out, 1.0 / sum);
        }
        used.remove(worst);
    }
    (out, 0.0)
}
