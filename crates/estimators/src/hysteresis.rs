//! Hysteresis of the gear: Coulomb-limited springs in parallel (Maxwell slip), independent of rate.
//!
//! Each element follows the torsion until its stretch reaches its limit, and slips from then on: the
//! stop operator of M. A. Krasnosel'skii and A. V. Pokrovskii, Systems with Hysteresis (Springer
//! 1989), a weighted sum of which is a Prandtl-Ishlinskii operator. The torque is that of the elastic
//! gear plus those of the elements, an explicit function of torsion and state, and its stiffnesses
//! follow from slow loading loops by linear least squares. Z, G and U have no such state.

use crate::joint::{JointSample, JointTorqueEstimator};
use crate::kinematic_error::KinematicErrorParameters;
use crate::output::Output;
use crate::tracking::{Tracking, TrackingParameters};
use crate::uncertainty::Uncertainty;
use crate::validity::Validity;
use robot_state::{TorqueEstimate, torque_source};

/// One spring that slips.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlipElement {
    /// r: stretch at which it slips, rad, link side.
    pub limit: f64,
    /// k: its stiffness, N·m/rad.
    pub stiffness: f64,
}

/// Springs that slip, with their stretch.
#[derive(Debug, Clone, PartialEq)]
pub struct Hysteresis {
    elements: Vec<(SlipElement, f64)>,
    /// Torsion of the last step, rad; none before the first.
    last: Option<f64>,
}

impl Hysteresis {
    /// Elements without stretch.
    #[must_use]
    pub fn new(elements: &[SlipElement]) -> Self {
        Self {
            elements: elements.iter().map(|e| (*e, 0.0)).collect(),
            last: None,
        }
    }

    /// Moves to a torsion; gives the torque of all elements there, N·m.
    ///
    /// The first torsion counts as reached from zero, along the virgin curve.
    pub fn update(&mut self, torsion: f64) -> f64 {
        let moved = torsion - self.last.unwrap_or(0.0);
        if !moved.is_finite() {
            return self.torque();
        }
        self.last = Some(torsion);
        //= H Stop: s_j = min(max(s_j + x - x_last, -r_j), r_j)
        for (element, stretch) in &mut self.elements {
            *stretch = (*stretch + moved).clamp(-element.limit, element.limit);
        }
        self.torque()
    }

    /// Torque of all elements, N·m.
    #[must_use]
    pub fn torque(&self) -> f64 {
        //= H Prandtl-Ishlinskii: tau = sum_j k_j s_j
        self.elements
            .iter()
            .map(|(element, stretch)| element.stiffness * stretch)
            .sum()
    }

    /// Largest torque of all elements together, N·m.
    #[must_use]
    pub fn capacity(&self) -> f64 {
        self.elements
            .iter()
            .map(|(e, _)| (e.stiffness * e.limit).abs())
            .sum()
    }

    /// Stiffness of the elements that have not slipped, N·m/rad.
    #[must_use]
    pub fn stiffness(&self) -> f64 {
        let holding = |(element, stretch): &&(SlipElement, f64)| stretch.abs() < element.limit;
        self.elements
            .iter()
            .filter(holding)
            .map(|(element, _)| element.stiffness)
            .sum()
    }

    /// The elements' stretches, rad.
    pub fn stretches(&self) -> impl Iterator<Item = f64> {
        self.elements.iter().map(|(_, stretch)| *stretch)
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.last = None;
        self.elements
            .iter_mut()
            .for_each(|(_, stretch)| *stretch = 0.0);
    }
}

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

/// A gear with its slipping springs' state.
#[derive(Debug, Clone)]
pub struct Gear {
    parameters: GearParameters,
    slipping: Hysteresis,
    bearing: Hysteresis,
}

impl Gear {
    /// A gear without history.
    #[must_use]
    pub fn new(parameters: GearParameters) -> Self {
        Self {
            slipping: Hysteresis::new(&parameters.slipping),
            bearing: Hysteresis::new(&parameters.bearing),
            parameters,
        }
    }

    /// Moves to torsion `x`; gives the gear's torque there, N·m.
    pub fn update(&mut self, x: f64) -> f64 {
        self.parameters.elastic(x) + self.slipping.update(x)
    }

    /// Moves the output to `q` at `dq`; gives the friction torque of its bearing, N·m.
    pub fn bearing(&mut self, q: f64, dq: f64) -> f64 {
        self.bearing.update(q) + self.parameters.bearing_viscous * dq
    }

    /// Stiffness at torsion `x` for a move in the direction of the last ones, springs that have
    /// not slipped included, N·m/rad.
    #[must_use]
    pub fn stiffness(&self, x: f64) -> f64 {
        self.parameters.stiffness(x) + self.slipping.stiffness()
    }

    /// The curves.
    #[must_use]
    pub fn parameters(&self) -> &GearParameters {
        &self.parameters
    }

    /// Forgets the past.
    pub fn reset(&mut self) {
        self.slipping.reset();
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
}

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
        let springs = self.wind_up.len() + self.slipping.len() + self.bearing.len();
        2 + springs + 2 + ENCODER_PARAMETERS
    }
}

/// Cosines and sines of the harmonics of [`LINK_ORDERS`] and [`MOTOR_ORDERS`].
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
        let fits = directions.iter().any(|d| d.len() == count);
        self.uncertainty = fits.then(|| Uncertainty::new(directions, count));
        self.validity = validity;
        self
    }

    /// Variance of the torque at tracked torsion `x` from that of the parameters, (N·m)².
    fn parameter_variance(&mut self, sample: &JointSample, x: f64, rate: f64) -> f64 {
        let Some(uncertainty) = &mut self.uncertainty else {
            return 0.0;
        };
        let (p, slope) = (&self.parameters.gear, self.slope);
        let own = [x, x * x * x].into_iter();
        let soft = p.wind_up.iter().map(|(w, _)| w * (x / w).tanh());
        let springs = self.gear.slipping.stretches();
        let bearing = self.gear.bearing.stretches().map(|s| -s);
        let rates = [-sample.dq, rate, -slope * sample.dq, -slope];
        let waves = harmonics(sample.q, sample.theta).map(|h| -slope * h);
        let all = own.chain(soft).chain(springs).chain(bearing);
        let all = all.chain(rates).chain(waves);
        for (entry, value) in uncertainty.gradient().iter_mut().zip(all) {
            *entry = value;
        }
        uncertainty.variance(slope)
    }

    /// An estimator that has seen no sample.
    #[must_use]
    pub fn new(parameters: HysteresisParameters) -> Self {
        Self {
            gear: Gear::new(parameters.gear.clone()),
            output: Output::new(torque_source::ENCODER, parameters.torque_limit, 0.0),
            tracking: Tracking::new(parameters.tracking, parameters.sample_period),
            uncertainty: None,
            validity: Validity::default(),
            slope: parameters.gear.linear,
            parameters,
        }
    }
}

impl JointTorqueEstimator for HysteresisEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        if !Output::usable(sample) {
            return self.output.held();
        }
        let p = &self.parameters;
        let torsion = sample.theta / p.gear_ratio - sample.q;
        let x = torsion - p.kinematic_error.error(sample.q, sample.theta);
        // The cubic may decrease far outside of the fitted range: the torsion is clamped to that of
        // the linear part at twice the limit.
        let furthest = 2.0 * p.torque_limit / p.gear.linear.max(f64::MIN_POSITIVE);
        let (x, rate) = self.tracking.update(x.clamp(-furthest, furthest));
        let carried = self.gear.update(x.clamp(-furthest, furthest)) + p.gear.damping * rate;
        let tau = carried - self.gear.bearing(sample.q, sample.dq);
        let tau = tau.clamp(-p.torque_limit, p.torque_limit);
        let own = p.gear.stiffness(x).abs() * p.torsion_sigma;
        self.slope = self.gear.stiffness(x);
        let outside = self.validity.torque_error(tau);
        let variance = self.parameter_variance(sample, x, rate);
        let sigma = (own * own + outside * outside + variance).sqrt();
        let limit = self.parameters.torque_limit;
        self.output.give(sample, tau, sigma.min(limit))
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
        if let Some(uncertainty) = &mut self.uncertainty {
            uncertainty.reset();
        }
    }
}
