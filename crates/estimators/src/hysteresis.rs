//! Hysteresis of the gear: Coulomb-limited springs in parallel (Maxwell slip), independent of rate.
//!
//! Each element follows the torsion until its stretch reaches its limit, and slips from then on: the
//! stop operator of M. A. Krasnosel'skii and A. V. Pokrovskii, Systems with Hysteresis (Springer
//! 1989), a weighted sum of which is a Prandtl-Ishlinskii operator. The torque is that of the elastic
//! gear plus those of the elements, an explicit function of torsion and state, and its stiffnesses
//! follow from slow loading loops by linear least squares. Z, G and U have no such state.

mod springs;

use crate::creep::{Creep, CreepElement};
use crate::joint::{JointSample, JointTorqueEstimator};
use crate::kinematic_error::KinematicErrorParameters;
use crate::output::Output;
use crate::tracking::{Tracking, TrackingParameters};
use crate::uncertainty::Uncertainty;
use crate::validity::Validity;
use robot_state::{TorqueEstimate, torque_source};

pub use springs::{Hysteresis, SlipElement};

/// The gear's torque against its torsion: an elastic curve and springs that slip.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GearParameters {
    /// Stiffness of the linear part, N·m/rad.
    pub linear: f64,
    /// Growth of the stiffness, N·m/rad³.
    pub cubic: f64,
    /// Wind-up around zero: (w, k) adds `k w tanh(x/w)`; w in rad, k in N·m/rad.
    pub wind_up: Vec<(f64, f64)>,
    /// Springs that slip.
    pub slipping: Vec<SlipElement>,
    /// Springs behind dampers, by which the gear creeps.
    pub creeping: Vec<CreepElement>,
    /// Damping, N·m·s/rad of torsion.
    pub damping: f64,
    /// Friction of the output bearing: springs that slip along q. Torsion does not show it, but
    /// the child link receives the gear's torque less this.
    pub bearing: Vec<SlipElement>,
    /// Viscous friction of the output bearing, N·m·s/rad.
    pub bearing_viscous: f64,
}

impl GearParameters {
    /// The elastic part's torque at torsion `x`, N·m.
    #[must_use]
    pub fn elastic(&self, x: f64) -> f64 {
        let soft = self.wind_up.iter().map(|(w, k)| k * w * (x / w).tanh());
        x * (self.linear + self.cubic * x * x) + soft.sum::<f64>()
    }

    /// Stiffness at torsion `x` in the direction of loading, N·m/rad.
    #[must_use]
    pub fn stiffness(&self, x: f64) -> f64 {
        let soft = self
            .wind_up
            .iter()
            .map(|(w, k)| k * (1.0 - (x / w).tanh().powi(2)));
        self.linear + 3.0 * self.cubic * x * x + soft.sum::<f64>()
    }
}

/// Time for which errors of a torque from elsewhere last, s: so long it counts as one.
const SHOWN_TIME_S: f64 = 0.5;
/// Standard deviations beyond which a difference is none of the past.
const NOT_PAST: f64 = 4.0;
/// Least standard deviation of the pasts' torque that another torque shows, of its own: some of its errors last.
const LEAST_SHOWN: f64 = 0.5;

/// A gear with its slipping springs' state.
#[derive(Debug, Clone)]
pub struct Gear {
    parameters: GearParameters,
    slipping: Hysteresis,
    creeping: Creep,
    bearing: Hysteresis,
}

impl Gear {
    /// A gear without history; `sample_period` in s.
    #[must_use]
    pub fn new(parameters: GearParameters, sample_period: f64) -> Self {
        Self {
            creeping: Creep::new(&parameters.creeping, sample_period),
            slipping: Hysteresis::new(&parameters.slipping),
            bearing: Hysteresis::new(&parameters.bearing),
            parameters,
        }
    }

    /// Moves to torsion `x`; gives the gear's torque there, N·m.
    pub fn update(&mut self, x: f64) -> f64 {
        self.parameters.elastic(x) + self.slipping.update(x) + self.creeping.update(x)
    }

    /// A sample without a torsion: the gear goes on to creep.
    pub fn miss(&mut self) {
        self.creeping.miss();
    }

    /// Moves the output to `q` at `dq`; gives the friction torque of its bearing, N·m.
    pub fn bearing(&mut self, q: f64, dq: f64) -> f64 {
        self.bearing.update(q) + self.parameters.bearing_viscous * dq
    }

    /// Stiffness at torsion `x` for a move in the direction of the last ones, springs that have
    /// not slipped and those behind dampers included, N·m/rad.
    #[must_use]
    pub fn stiffness(&self, x: f64) -> f64 {
        self.parameters.stiffness(x) + self.slipping.stiffness() + self.creeping.stiffness()
    }

    /// Standard deviation of the torque by the gear's past before the first sample, and by its bearing's, which
    /// moves along another way, N·m.
    #[must_use]
    pub fn unknown(&self) -> [f64; 2] {
        [self.slipping.unknown(), self.bearing.unknown()]
    }

    /// The torque is larger by `error`, N·m, as another one shows for a time of `period`, s, with a standard deviation
    /// of `sigma`, N·m: what is not known of both pasts follows. Gives the change of the torque, N·m.
    pub fn learn(&mut self, error: f64, sigma: f64, period: f64) -> f64 {
        let variances = self.unknown().map(|unknown| unknown * unknown);
        let (all, others) = (variances.iter().sum::<f64>(), sigma * sigma);
        if !(all > 0.0 && others > 0.0 && error * error <= NOT_PAST * NOT_PAST * (all + others)) {
            return 0.0;
        }
        let weight = period / (SHOWN_TIME_S + period);
        let gain = weight * (all / (weight * all + others)).min(1.0);
        let left = if all > LEAST_SHOWN * LEAST_SHOWN * others {
            1.0 - gain
        } else {
            1.0
        };
        let parts = variances.map(|variance| gain * error * variance / all);
        self.slipping.learn(parts[0], left) - self.bearing.learn(-parts[1], left)
    }

    /// The curves.
    #[must_use]
    pub fn parameters(&self) -> &GearParameters {
        &self.parameters
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.slipping.reset();
        self.creeping.reset();
        self.bearing.reset();
    }
}

/// Compliance model with hysteresis, as an estimator of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct HysteresisParameters {
    /// The gear.
    pub gear: GearParameters,
    /// Kinematic error.
    pub kinematic_error: KinematicErrorParameters,
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// The filter that tracks the torsion. It precedes the springs, which noise would move to and
    /// fro.
    pub tracking: TrackingParameters,
    /// Standard deviation of the torsion that the model leaves, rad; identified.
    pub torsion_sigma: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
}

/// Torque from the torsion and its past.
#[derive(Debug, Clone)]
pub struct HysteresisEstimator {
    parameters: HysteresisParameters,
    gear: Gear,
    tracking: Tracking,
    output: Output,
    uncertainty: Option<Uncertainty>,
    validity: Validity,
    /// Slope of the torque in the torsion at the last sample, N·m/rad.
    slope: f64,
    last: Option<Last>,
}

/// The last sample.
#[derive(Debug, Clone, Copy)]
struct Last {
    /// Torque, N·m, and what the torsion's filter holds back of it.
    tau: f64,
    held_back: f64,
    /// Its variance without that of the pasts, (N·m)².
    variance: f64,
}

/// Parameters that no fit has, behind those of the fit: the pasts of gear and bearing before the first sample, the
/// gear's slope below and above the torques that its data covered.
const NOT_FITTED: usize = 4;

/// Orders of the harmonics of q and theta that a fit under load may still find.
pub const LINK_ORDERS: [u32; 2] = [1, 2];
/// Those of theta.
pub const MOTOR_ORDERS: [u32; 3] = [1, 2, 4];
/// Parameters of the encoders behind those of the gear: skew, zero, harmonics.
pub const ENCODER_PARAMETERS: usize = 2 + 2 * (LINK_ORDERS.len() + MOTOR_ORDERS.len());

impl GearParameters {
    /// Parameters that the covariance of a fit is about, those of the encoders included.
    #[must_use]
    pub fn uncertain(&self) -> usize {
        let springs = self.wind_up.len() + self.slipping.len() + self.creeping.len();
        2 + springs + self.bearing.len() + 2 + ENCODER_PARAMETERS
    }
}

/// Cosines and sines of the harmonics of [`LINK_ORDERS`] and [`MOTOR_ORDERS`]; `q`: times w_l, where that is not 1.
#[must_use]
pub fn harmonics(q: f64, theta: f64) -> [f64; ENCODER_PARAMETERS - 2] {
    let (s, c) = q.sin_cos();
    let (st, ct) = theta.sin_cos();
    let twice = |(s, c): (f64, f64)| (2.0 * s * c, c * c - s * s);
    let (s2, c2) = twice((s, c));
    let (st2, ct2) = twice((st, ct));
    let (st4, ct4) = twice((st2, ct2));
    [c, s, c2, s2, ct, st, ct2, st2, ct4, st4]
}

impl HysteresisEstimator {
    /// The same with the covariance of its parameters, as the fit's directions, and the ranges that its
    /// data covered.
    #[must_use]
    pub fn with_uncertainty(mut self, directions: &[Vec<f64>], validity: Validity) -> Self {
        let count = self.parameters.gear.uncertain();
        let fitting = directions.iter().filter(|d| d.len() == count);
        let mut all: Vec<Vec<f64>> = fitting
            .map(|d| d.iter().copied().chain([0.0; NOT_FITTED]).collect())
            .collect();
        if !all.is_empty() {
            // Each of standard deviation 1.
            all.extend((0..NOT_FITTED).map(|own| {
                let unit = (0..NOT_FITTED).map(move |k| f64::from(u8::from(k == own)));
                vec![0.0; count].into_iter().chain(unit).collect()
            }));
        }
        self.uncertainty = (!all.is_empty()).then(|| Uncertainty::new(&all, count + NOT_FITTED));
        self.validity = validity;
        self
    }

    /// Variance of the torque `tau` at tracked torsion `x` from that of the parameters, and from torques that the
    /// data did not cover, (N·m)².
    fn parameter_variance(&mut self, sample: &JointSample, [x, rate, tau]: [f64; 3]) -> f64 {
        let Some(uncertainty) = &mut self.uncertainty else {
            return self.validity.torque_error(tau).powi(2);
        };
        let (p, slope) = (&self.parameters.gear, self.slope);
        let own = [x, x * x * x].into_iter();
        let soft = p.wind_up.iter().map(|(w, _)| w * (x / w).tanh());
        let springs = self.gear.slipping.stretches();
        let creeping = self.gear.creeping.stretches();
        let bearing = self.gear.bearing.stretches().map(|s| -s);
        let rates = [-sample.dq, rate, -slope * sample.dq, -slope];
        let link = self.parameters.kinematic_error.w_link * sample.q;
        let waves = harmonics(link, sample.theta).map(|h| -slope * h);
        let all = own
            .chain(soft)
            .chain(springs)
            .chain(bearing)
            .chain(creeping);
        let outside = self.validity.torque_errors(tau);
        let all = all.chain(rates).chain(waves);
        let all = all.chain(self.gear.unknown()).chain(outside);
        for (entry, value) in uncertainty.gradient().iter_mut().zip(all) {
            *entry = value;
        }
        uncertainty.variance(slope)
    }

    /// An estimator that has seen no sample.
    #[must_use]
    pub fn new(parameters: HysteresisParameters) -> Self {
        Self {
            gear: Gear::new(parameters.gear.clone(), parameters.sample_period),
            output: Output::new(torque_source::ENCODER, parameters.torque_limit, 0.0),
            tracking: Tracking::new(parameters.tracking, parameters.sample_period),
            uncertainty: None,
            validity: Validity::default(),
            slope: parameters.gear.linear,
            last: None,
            parameters,
        }
    }
}

impl JointTorqueEstimator for HysteresisEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        if !Output::usable(sample) {
            self.gear.miss();
            self.last = None;
            return self.output.held();
        }
        let p = &self.parameters;
        let torsion = sample.theta / p.gear_ratio - sample.q;
        let x = torsion - p.kinematic_error.error(sample.q, sample.theta);
        // The cubic may decrease far outside of the fitted range: the torsion is clamped to that of
        // the linear part at twice the limit.
        let furthest = 2.0 * p.torque_limit / p.gear.linear.max(f64::MIN_POSITIVE);
        let read = x.clamp(-furthest, furthest);
        let (x, rate) = self.tracking.update(read);
        let carried = self.gear.update(x.clamp(-furthest, furthest)) + p.gear.damping * rate;
        let tau = carried - self.gear.bearing(sample.q, sample.dq);
        let tau = tau.clamp(-p.torque_limit, p.torque_limit);
        let own = p.gear.stiffness(x).abs() * p.torsion_sigma;
        self.slope = self.gear.stiffness(x);
        let variance = self.parameter_variance(sample, [x, rate, tau]);
        let sigma = (own * own + variance).sqrt();
        let pasts: f64 = self.gear.unknown().iter().map(|past| past * past).sum();
        self.last = Some(Last {
            tau,
            held_back: self.slope * (read - x),
            variance: own * own + (variance - pasts).max(0.0),
        });
        let limit = self.parameters.torque_limit;
        self.output.give(sample, tau, sigma.min(limit))
    }

    fn undelayed(&self) -> Option<f64> {
        let tau = self.last.map(|last| last.tau + last.held_back);
        tau.filter(|tau| tau.abs() < self.parameters.torque_limit)
    }

    fn show(&mut self, tau: f64, sigma: f64) -> f64 {
        // A tare has shown the past already.
        let tared = self.uncertainty.as_ref().is_none_or(Uncertainty::tared);
        let Some(last) = self.last.filter(|_| !tared) else {
            return 0.0;
        };
        let sigma = (sigma * sigma + last.variance).sqrt();
        (self.gear).learn(tau - last.tau, sigma, self.parameters.sample_period)
    }

    fn past(&self) -> f64 {
        let tared = self.uncertainty.as_ref().is_none_or(Uncertainty::tared);
        if tared {
            return 0.0;
        }
        let [gear, bearing] = self.gear.unknown();
        gear.hypot(bearing)
    }

    fn tare(&mut self, sigma: f64) {
        let slope = self.slope;
        if let Some(uncertainty) = &mut self.uncertainty {
            uncertainty.tare(slope, sigma * sigma);
        }
    }

    fn reset(&mut self) {
        self.gear.reset();
        self.tracking.reset();
        self.output.reset();
        self.last = None;
        if let Some(uncertainty) = &mut self.uncertainty {
            uncertainty.reset();
        }
    }
}
