//! Feed-forward as a source: what a controller or a rigid-body model expects the joint's torque to be.
//!
//! It knows nothing of contacts: fused like the others it would hide them. So it never has a share in how the
//! torque changes. It corrects the slow part of the error of the others, as F/T sensors correct the level of
//! a torque in the loop: their difference `d` to the feed-forward, followed with [`FOLLOW_S`] and only while
//! the joint moves or the feed-forward changes. Those are what gears and friction make errors of; at rest
//! under a constant feed-forward every change of the difference is a contact. A difference that jumps is a
//! contact or a slip: the correction stays as it is until the difference is back, and what is no longer
//! confirmed fades.

use crate::joint::{JointSample, JointTorqueEstimator};
use crate::low_pass::LowPass;
use crate::output::Output;
use crate::uncertainty::Uncertainty;
use crate::validity::Validity;
use robot_state::{TorqueEstimate, torque_source};

/// Torque of a joint by its feed-forward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FeedForwardParameters {
    /// Gain: torque per feed-forward, 1; payloads that the model lacks are part of it.
    pub gain: f64,
    /// Torque without feed-forward, N·m.
    pub offset: f64,
    /// Viscous friction in the feed-forward, that the joint's torque lacks, N·m·s/rad.
    pub viscous: f64,
    /// Coulomb friction in the feed-forward, N·m.
    pub coulomb: f64,
    /// |dq| at which the sign of dq is smoothed, rad/s.
    pub sign_smoothing: f64,
    /// Standard deviation of the torque, N·m; identified without contacts.
    pub sigma: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
}

/// Parameters that the covariance of a fit is about: gain, offset, viscous and Coulomb friction.
pub const UNCERTAIN: usize = 4;

/// The feed-forward as an estimator: of samples that have none it is not valid.
#[derive(Debug, Clone)]
pub struct FeedForwardEstimator {
    parameters: FeedForwardParameters,
    output: Output,
    uncertainty: Option<Uncertainty>,
    validity: Validity,
}

impl FeedForwardEstimator {
    /// An estimator that has seen no sample.
    #[must_use]
    pub fn new(parameters: FeedForwardParameters) -> Self {
        Self {
            output: Output::new(torque_source::NONE, parameters.torque_limit, 0.0),
            uncertainty: None,
            validity: Validity::default(),
            parameters,
        }
    }

    /// The same with the covariance of its parameters, as the fit's directions, and the ranges that its
    /// data covered.
    #[must_use]
    pub fn with_uncertainty(mut self, directions: &[Vec<f64>], validity: Validity) -> Self {
        let fits = directions.iter().any(|d| d.len() == UNCERTAIN);
        self.uncertainty = fits.then(|| Uncertainty::new(directions, UNCERTAIN));
        self.validity = validity;
        self
    }
}

impl JointTorqueEstimator for FeedForwardEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        let known = sample.feed_forward.filter(|tau| tau.is_finite());
        let Some(model) = known.filter(|_| Output::usable(sample)) else {
            return self.output.held();
        };
        let (p, dq) = (&self.parameters, sample.dq);
        let direction = (dq / p.sign_smoothing.max(f64::MIN_POSITIVE)).tanh();
        let tau = p.gain * model + p.offset - p.viscous * dq - p.coulomb * direction;
        let mut variance = p.sigma * p.sigma + self.validity.torque_error(tau).powi(2);
        if let Some(uncertainty) = &mut self.uncertainty {
            let gradient = [model, 1.0, -dq, -direction];
            for (entry, value) in uncertainty.gradient().iter_mut().zip(gradient) {
                *entry = value;
            }
            variance += uncertainty.variance(1.0);
        }
        self.output.give(sample, tau, variance.sqrt())
    }

    fn tare(&mut self, sigma: f64) {
        if let Some(uncertainty) = &mut self.uncertainty {
            uncertainty.tare(1.0, sigma * sigma);
        }
    }

    fn reset(&mut self) {
        self.output.reset();
        if let Some(uncertainty) = &mut self.uncertainty {
            uncertainty.reset();
        }
    }
}

/// How the difference of the other sources to the feed-forward behaves without contacts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorrectionParameters {
    /// Standard deviation of the difference about its slow part, at rest and in motion, N·m; identified.
    pub change_sigma: [f64; 2],
    /// Rate of the feed-forward, N·m/s, that counts as motion.
    pub loading: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
}

/// Slow correction of a torque by the feed-forward.
#[derive(Debug, Clone, PartialEq)]
pub struct Correction {
    parameters: CorrectionParameters,
    /// Slow part of the difference, N·m, and the time of motion that it comes from, s; at the start time
    /// counts as well.
    difference: f64,
    seen: f64,
    /// Share of it that motion since its last confirmation has made obsolete.
    obsolete: f64,
    /// The difference has jumped, and has not been back for [`BACK_S`].
    apart: bool,
    back: f64,
    rate: LowPass,
    last: Option<f64>,
    /// Difference beyond its slow part, N·m, and the share of motion, at the last sample.
    change: Option<(f64, f64)>,
}

/// Torque and variance.
pub type Torque = (f64, f64);

/// Time in motion within which the correction follows, s: friction and gear err so fast.
pub const FOLLOW_S: f64 = 0.3;
/// Time at the start from which the correction is taken without motion, s.
const START_S: f64 = 0.1;
/// Time in motion after which a correction that is not confirmed is worth nothing, s.
const OBSOLETE_S: f64 = 3.0;
/// Standard deviations by which the difference has jumped, and within which it is back.
const APART: [f64; 2] = [3.0, 2.0];
/// Time for which it must be back, s.
const BACK_S: f64 = 0.1;
/// Time over which the feed-forward's rate is smoothed, s.
const RATE_S: f64 = 0.1;
/// Share of the rate that counts as motion below which its noise is none.
const QUIET: f64 = 0.2;

impl Correction {
    /// A correction of nothing.
    #[must_use]
    pub fn new(parameters: CorrectionParameters) -> Self {
        let pole = (-parameters.sample_period / RATE_S).exp();
        Self {
            parameters,
            difference: 0.0,
            seen: 0.0,
            obsolete: 0.0,
            apart: false,
            back: 0.0,
            rate: LowPass::new(pole),
            last: None,
            change: None,
        }
    }

    /// The torque `(tau, variance)` of the other sources corrected by that of the feed-forward; `motion`: share
    /// of motion in the last while.
    pub fn update(&mut self, others: Torque, feed_forward: Torque, motion: f64) -> Torque {
        let ((tau, variance), (model, model_variance)) = (others, feed_forward);
        let active = self.activity(model, motion);
        let [rest, moving] = self.parameters.change_sigma;
        let sigma = rest + active * (moving - rest);
        self.follow(tau - model, active, sigma);
        let d = self.difference;
        // A difference beyond both sigmas is an error of the model, or a payload that it lacks.
        let model_variance = model_variance.max(d * d - variance);
        //= T Feed-forward: tau = tau_ab - g d,  g = var_ab / (var_ab + var_ff)
        let kept = variance / (variance + model_variance).max(f64::MIN_POSITIVE);
        let share = kept * (1.0 - self.obsolete);
        let left = (1.0 - share) * variance + share * sigma * sigma;
        (tau - share * d, left.min(variance))
    }

    /// Share of time that counts as motion: of the joint, or of the load as the feed-forward has it.
    fn activity(&mut self, model: f64, motion: f64) -> f64 {
        let p = &self.parameters;
        let change = self.last.map_or(0.0, |last| model - last);
        self.last = Some(model);
        let rate = self.rate.update(change / p.sample_period).abs();
        let loading = (rate / p.loading.max(f64::MIN_POSITIVE) - QUIET) / (1.0 - QUIET);
        motion.max(loading.clamp(0.0, 1.0))
    }

    /// Follows the difference where it changes as errors of gear and friction do.
    fn follow(&mut self, difference: f64, active: f64, sigma: f64) {
        let period = self.parameters.sample_period;
        let [jumped, back] = APART;
        let starting = self.seen < START_S;
        self.change = (!starting).then_some((difference - self.difference, active));
        let change = (difference - self.difference).abs();
        if !starting {
            self.apart |= change > jumped * sigma;
            self.back = if change < back * sigma {
                self.back + period
            } else {
                0.0
            };
            self.apart &= self.back < BACK_S;
        }
        let moved = active * period;
        if self.apart {
            self.obsolete += moved / OBSOLETE_S * (1.0 - self.obsolete);
            return;
        }
        // A mean at first, then the last while.
        let step = if starting { period } else { moved };
        self.seen = (self.seen + step).min(FOLLOW_S);
        let share = step / self.seen.max(step).max(f64::MIN_POSITIVE);
        self.difference += share.min(1.0) * (difference - self.difference);
        self.obsolete -= share.min(1.0) * self.obsolete;
    }

    /// The torque has become known to all sources: they are zeroed to it.
    pub fn tare(&mut self) {
        (self.difference, self.obsolete) = (0.0, 0.0);
        (self.apart, self.back, self.seen) = (false, 0.0, START_S);
    }

    /// Difference to the feed-forward beyond its slow part, N·m, and the share of motion, at the last
    /// sample; none at the start.
    #[must_use]
    pub fn change(&self) -> Option<(f64, f64)> {
        self.change
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        *self = Self::new(self.parameters);
    }
}
