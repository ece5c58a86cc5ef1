//! One torque from several sources: a mean of those whose variance is near the least.
//!
//! The errors of the sources are strongly correlated (most depend on the same torsion), and the
//! correlation changes with the load: weights by the full covariance are optimal on the data they
//! were fitted to and wrong on others. So only a source whose variance is
//! within [`MAX_VARIANCE_RATIO`] of the least takes part, with the more weight the smaller its
//! variance. The variance is the one identified per regime (at rest or in motion, under steady or
//! changing load), raised when a source itself reports a larger sigma than it did then, as a learned
//! one does away from its data, and the gear's outside of the ranges of its fit.
//!
//! The torque from the current does not depend on the torsion: both groups are combined with minimum
//! variance, sample by sample. An innovation test compares them: where they are further apart than their
//! variances allow, the published sigma covers it; where they agree better since a tare of an unknown zero, or have
//! hardly changed, it is smaller ([`crate::agreement`]).
//!
//! A torque at its clamp is a bound: the torque is at least that. Where the other group bears it out within two
//! standard deviations it counts as ever; where the other has passed it, it says nothing more; where the other
//! contradicts it, it takes no part, and the disagreement still counts. A torsion beyond the gear's range concerns
//! every source from the torsion. Within a group, whose sources err alike, nothing independent contradicts a bound:
//! there only a source whose reference is within its own range loses its weight. A feed-forward corrects the slow error of both
//! ([`crate::feed_forward`]).

mod group;

use crate::agreement::Agreement;
use crate::feed_forward::{Correction, CorrectionParameters};
use crate::joint::JointSample;
use crate::output::Output;
use crate::role::{Places, Role};
use group::clamped;
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

/// One source of a fusion.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FusedSource {
    /// Its part in the joint's torque.
    pub role: Role,
    /// Its errors, regime by regime.
    pub errors: [SourceError; REGIMES],
    /// Whether it takes part in the fused torque; else its sigma is published as the fit found it, no more.
    pub fused: bool,
}

/// Weights of the sources, regime by regime.
#[derive(Debug, Clone, PartialEq)]
pub struct FusionParameters {
    /// |dq| above which the joint moves, rad/s.
    pub moving: f64,
    /// |rate of the torsion| at which the load changes slowly, faster, suddenly, rad/s.
    pub loading: [f64; BOUNDS],
    /// The sources, in their order.
    pub sources: Vec<FusedSource>,
    /// Time over which the variances change from one regime to another, s.
    pub blend: f64,
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
    /// Rated torque, N·m.
    pub rated_torque: f64,
    /// Factor of the current's variance while the motor has not moved for a while: friction then hides
    /// part of the torque, also where a changing load moves gear and link a little. It counts where the torsion's zero
    /// is known.
    pub rest_factor: f64,
    /// Whether the torsion's zero is unknown until a tare.
    pub zero_unknown: bool,
    /// How the other sources differ from a feed-forward that takes part.
    pub correction: Option<CorrectionParameters>,
}

/// Combines sources into one torque.
#[derive(Debug, Clone)]
pub struct Fusion {
    parameters: FusionParameters,
    sources: usize,
    /// Those that take part.
    places: Places,
    /// Share of each regime in the present variances.
    shares: [f64; REGIMES],
    /// Torsion and its smoothed rate.
    torsion: Option<(f64, f64)>,
    output: Output,
    /// Square of the innovation over its variance, averaged.
    disagreement: f64,
    /// Time for which it has been too large, s, and whether that counts as lasting.
    apart_s: f64,
    disagrees: bool,
    /// Angle of the motor behind a low-pass, rad, and the share of motion that its way from there shows.
    rotor: Option<f64>,
    motion: f64,
    correction: Option<Correction>,
    /// Whether there was a tare.
    tared: bool,
    /// How well torsion and current agree since then.
    agreement: Agreement,
    /// Standard deviation of each source's present estimate, N·m.
    sigmas: [f64; MAX_SOURCES],
}

/// Time over which the disagreement of the groups is averaged, s.
const DISAGREEMENT_TIME_S: f64 = 1.0;
/// Mean square of the innovation over its variance that counts as a disagreement, and the one below which
/// it is over: three and two standard deviations.
const APART: [f64; 2] = [9.0, 4.0];
/// Time for which it lasts before it is reported, s.
const LASTS_S: f64 = 2.0;
/// Time over which motion must last to count, s.
const MOTION_TIME_S: f64 = 0.3;
/// Way of the motor one way within that time from which on it moves, rad: its friction is then that of motion. A
/// shorter way is that of the gear's torsion and of the bristles of friction, whatever the link's velocity.
const MOTION_WAY: f64 = 1.0;
/// Square of an innovation over its variance up to which one sample agrees: two standard deviations.
const AGREEMENT: f64 = 4.0;

impl Fusion {
    /// A fusion of at most [`MAX_SOURCES`] sources.
    #[must_use]
    pub fn new(parameters: FusionParameters) -> Self {
        let sources = &parameters.sources;
        debug_assert!(sources.len() <= MAX_SOURCES);
        let places = Places::of(sources.iter().map(|s| s.fused.then_some(s.role)));
        let correction = parameters.correction.filter(|_| places.model.is_some());
        Self {
            places,
            output: Output::new(torque_source::FUSED, parameters.torque_limit, 0.0),
            shares: FIRST,
            correction: correction.map(Correction::new),
            sources: sources.len().min(MAX_SOURCES),
            torsion: None,
            disagreement: 1.0,
            apart_s: 0.0,
            disagrees: false,
            rotor: None,
            motion: 0.0,
            tared: false,
            agreement: Agreement::default(),
            sigmas: [f64::INFINITY; MAX_SOURCES],
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
        let known = self.parameters.sources.get(source);
        let errors = known.map(|known| known.errors).unwrap_or_default();
        let (mut variance, mut reported) = (0.0, 0.0);
        for (share, known) in self.shares.iter().zip(errors) {
            if !known.variance.is_finite() {
                return f64::INFINITY;
            }
            variance += share * known.variance;
            reported += share * known.reported * known.reported;
        }
        let excess = (estimate.sigma * estimate.sigma - reported).max(0.0);
        // The sigma of a model with a covariance grows by what its parameters add; that of others in
        // proportion to their errors.
        let has_covariance = self.places.gear == Some(source) || self.places.stand_apart(source);
        let share = if has_covariance {
            1.0
        } else {
            variance / reported.max(1e-18)
        };
        // Two sources without any error are as good as each other.
        variance.max(1e-18) + share * excess
    }

    /// The torque of the other sources, corrected by the feed-forward where it is valid.
    fn corrected(
        &mut self,
        others: (f64, f64),
        sources: &[TorqueEstimate],
        variances: &[f64],
    ) -> (f64, f64) {
        let motion = self.motion;
        let (Some(correction), Some(i)) = (&mut self.correction, self.places.model) else {
            return others;
        };
        match sources.get(i).zip(variances.get(i)) {
            Some((model, variance)) if variance.is_finite() => {
                correction.update(others, (model.tau, *variance), motion)
            }
            _ => others,
        }
    }

    /// How the other sources differ from the feed-forward beyond the slow part, N·m, and the share of
    /// motion.
    #[must_use]
    pub fn change(&self) -> Option<(f64, f64)> {
        self.correction.as_ref()?.change()
    }

    /// The sources have been zeroed to a torque that is known with a standard deviation, N·m.
    pub fn tare(&mut self, sigma: f64) {
        self.tared = true;
        self.agreement = Agreement::since(sigma);
        self.rotor = None;
        if let Some(correction) = &mut self.correction {
            correction.tare();
        }
    }

    /// Variances of all sources: those from the torsion share the gear's parameters.
    fn variances(&self, sources: &[TorqueEstimate]) -> [f64; MAX_SOURCES] {
        let mut variances = [f64::INFINITY; MAX_SOURCES];
        let count = self.sources.min(sources.len());
        for (i, (variance, source)) in variances.iter_mut().zip(sources).take(count).enumerate() {
            *variance = self.variance(i, source);
        }
        let gear = self.places.gear;
        let Some((gear, known)) = gear.and_then(|i| Some((i, self.parameters.sources.get(i)?)))
        else {
            return variances;
        };
        let usual: f64 = (self.shares.iter().zip(&known.errors))
            .map(|(share, error)| share * error.variance)
            .sum();
        let excess = variances.get(gear).map_or(0.0, |now| now - usual);
        if excess.is_finite() && excess > 0.0 {
            for (i, variance) in variances.iter_mut().enumerate() {
                if i != gear && !self.places.stand_apart(i) {
                    *variance += excess;
                }
            }
        }
        variances
    }

    /// Standard deviation of each source's last estimate, N·m; infinite for one that takes no part.
    #[must_use]
    pub fn sigmas(&self) -> &[f64] {
        &self.sigmas
    }

    /// Mean square of the innovation between torsion and current over its variance: about 1 where both are
    /// as good as their sigmas.
    #[must_use]
    pub fn disagreement(&self) -> f64 {
        self.disagreement
    }

    /// Whether torsion and current have been too far apart for some seconds, and still are.
    #[must_use]
    pub fn disagrees(&self) -> bool {
        self.disagrees
    }

    /// Takes the disagreement of one more sample into account.
    fn compare(&mut self, chi: f64) {
        let period = self.parameters.sample_period;
        let step = period / (DISAGREEMENT_TIME_S + period);
        self.disagreement += step * (chi.min(100.0) - self.disagreement);
        let [begins, ends] = APART;
        self.apart_s = if self.disagreement > begins {
            self.apart_s + period
        } else {
            0.0
        };
        self.disagrees = if self.disagrees {
            self.disagreement > ends
        } else {
            self.apart_s > LASTS_S
        };
    }

    /// Torque and variance where one group stands at its clamp and the other does not bear it out: that of the other
    /// alone.
    fn one_sided(
        &mut self,
        group: (f64, f64, bool),
        current: (f64, f64, bool),
    ) -> Option<(f64, f64)> {
        let (bound, other) = match (group.2, current.2) {
            (true, false) => (group, current),
            (false, true) => (current, group),
            _ => return None,
        };
        let short = bound.0.signum() * (bound.0 - other.0);
        let chi = short.max(0.0).powi(2) / (bound.1 + other.1);
        if short > 0.0 && chi <= AGREEMENT {
            return None;
        }
        self.compare(chi);
        Some((other.0, other.1))
    }

    /// Torque and variance of the sources from the torsion, and of the current, at motor angle `theta`, under their
    /// joint covariance, with the innovation test: the published variance covers their disagreement, and follows
    /// their agreement since a tare of an unknown zero. The weights do not: agreement shows the sum of both variances,
    /// not which is less.
    fn combine(&mut self, group: (f64, f64), current: (f64, f64), theta: f64) -> (f64, f64) {
        let ((a, var_a), (b, var_b)) = (group, current);
        let sum = var_a + var_b;
        //= T Innovation: chi² = (tau_a - tau_b)² / (var_a + var_b)
        let chi = (a - b) * (a - b) / sum;
        self.compare(chi);
        let raised = (chi / AGREEMENT).max(self.disagreement).max(1.0);
        //= T Minimum variance: tau = (var_b tau_a + var_a tau_b) / (var_a + var_b)
        let tau = (var_b * a + var_a * b) / sum;
        // Only so: after an unloaded turn, whose sigmas are right, agreement would make them too small.
        if !(self.tared && self.parameters.zero_unknown) {
            return (tau, var_a * var_b / sum * raised);
        }
        let rated = self.parameters.rated_torque;
        self.agreement.update(chi, [tau, theta], rated);
        let [var_a, var_b] = self.agreement.lowered(var_a, var_b);
        let most = self.agreement.most([a, b], rated);
        (tau, (var_a * var_b / (var_a + var_b) * raised).min(most))
    }

    /// Follows the motor: share of motion in the last while, 0 to 1.
    fn follow(&mut self, theta: f64) {
        if !theta.is_finite() {
            return;
        }
        let period = self.parameters.sample_period;
        let rotor = self.rotor.get_or_insert(theta);
        *rotor += period / (MOTION_TIME_S + period) * (theta - *rotor);
        self.motion = ((theta - *rotor).abs() / MOTION_WAY).min(1.0).powi(2);
    }

    /// The fused torque of the sources' estimates of one sample.
    pub fn update(&mut self, sample: &JointSample, sources: &[TorqueEstimate]) -> TorqueEstimate {
        let regime = self.regime(sample);
        let p = &self.parameters;
        let step = p.sample_period / (p.blend + p.sample_period);
        for (r, share) in self.shares.iter_mut().enumerate() {
            *share += step * (f64::from(u8::from(r == regime)) - *share);
        }
        let mut variances = self.variances(sources);
        for (sigma, variance) in self.sigmas.iter_mut().zip(variances) {
            *sigma = variance.sqrt();
        }
        for (source, variance) in self.parameters.sources.iter().zip(&mut variances) {
            if !source.fused {
                *variance = f64::INFINITY;
            }
        }
        self.exclude_clamped(&mut variances, sources);
        self.follow(sample.theta);
        // An unknown zero of the torsion follows the current, and is known after a tare.
        let factor = if self.parameters.zero_unknown && !self.tared {
            1.0
        } else {
            self.parameters.rest_factor
        };
        let hidden = 1.0 + (factor - 1.0) * (1.0 - self.motion);
        let least = (variances.iter().enumerate())
            .filter(|(i, _)| !self.places.stand_apart(*i))
            .map(|(_, variance)| *variance)
            .fold(f64::INFINITY, f64::min);
        let current = (self.places.current)
            .and_then(|i| Some((sources.get(i)?, *variances.get(i)?)))
            .filter(|(_, variance)| variance.is_finite())
            .map(|(e, variance)| (e.tau, hidden * variance, clamped(e)));
        let group = self.group(sources, &variances, least);
        let mut saturated = group.saturated;
        let (tau, variance) = match (current, group.sum > 0.0) {
            (Some(current), true) => {
                let of_group = (group.tau, group.variance, group.clamped);
                match self.one_sided(of_group, current) {
                    Some(other) => {
                        saturated = false;
                        other
                    }
                    None => {
                        let group = (group.tau, group.variance);
                        self.combine(group, (current.0, current.1), sample.theta)
                    }
                }
            }
            (Some((tau, variance, _)), false) => (tau, variance),
            (None, true) => (group.tau, group.variance),
            (None, false) => return self.output.held(),
        };
        let (tau, variance) = self.corrected((tau, variance), sources, &variances);
        let mut estimate = self.output.give(sample, tau, variance.sqrt());
        estimate.delay_s = group.delay;
        if saturated {
            estimate.flags |= torque_flags::SATURATED;
        }
        estimate
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        self.torsion = None;
        self.disagreement = 1.0;
        (self.apart_s, self.disagrees) = (0.0, false);
        (self.rotor, self.motion) = (None, 0.0);
        self.tared = false;
        self.agreement = Agreement::default();
        if let Some(correction) = &mut self.correction {
            correction.reset();
        }
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
