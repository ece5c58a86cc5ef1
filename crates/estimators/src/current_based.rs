//! Joint torque from the motor current (D3): independent of both encoders' difference.
//!
//! Friction keeps its state at rest: it follows the rotor's way, not the sign of a velocity that is noise there.
//! Stops in parallel along theta/N (as in [`crate::hysteresis`]) take the place of sign(dq): a Maxwell-slip
//! model of friction (F. Al-Bender, V. Lampaert, J. Swevers, The generalized Maxwell-slip model, IEEE Trans.
//! Automatic Control 50(11), 2005, without its sliding dynamics).

use crate::hysteresis::{Hysteresis, SlipElement};
use crate::joint::{DRIVE_OFF, JointSample, JointTorqueEstimator};
use crate::output::Output;
use crate::uncertainty::Uncertainty;
use crate::validity::Validity;
use robot_state::{TorqueEstimate, torque_source};

/// Motor model with friction, link side (D3), and the rotor's inertia.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurrentParameters {
    /// K1: torque per current, N·m/A, link side.
    pub k_1: f64,
    /// K2: viscous friction, N·m·s/rad, link side.
    pub k_2: f64,
    /// K3: Coulomb friction, N·m, link side.
    pub k_3: f64,
    /// K4: Coulomb friction per torque carried, as gears that mesh have it, 1; D3 has none.
    pub k_4: f64,
    /// J N²: the rotor's inertia seen from the link, kg·m²; 0 neglects it as D3 does.
    pub inertia: f64,
    /// Current without torque, A.
    pub offset: f64,
    /// |dq| at which sign(dq) is smoothed, rad/s, link side; without presliding.
    pub sign_smoothing: f64,
    /// Ways of theta/N over which friction builds up, rad, and the share of each; none: sign(dq).
    pub presliding: [(f64, f64); STOPS],
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// Pole of the low-pass on current and acceleration, 0 to below 1.
    pub low_pass_pole: f64,
    /// Standard deviation of the torque while the joint turns, N·m; identified.
    pub sigma: f64,
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
}

/// Torque from motor current less friction.
#[derive(Debug, Clone)]
pub struct CurrentEstimator {
    parameters: CurrentParameters,
    low_pass: crate::low_pass::LowPass,
    last_dq: Option<f64>,
    output: Output,
    uncertainty: Option<Uncertainty>,
    validity: Validity,
    /// Stops, and the theta/N at which they begin.
    friction: Option<(Hysteresis, Option<f64>)>,
    /// Torque of the last sample and its smoothed rate, N·m and N·m/s.
    last: Option<(f64, f64)>,
}

/// Stops of the friction.
pub const STOPS: usize = 3;
/// Friction by sign(dq).
pub const NO_PRESLIDING: [(f64, f64); STOPS] = [(0.0, 0.0); STOPS];
/// Parameters that the covariance of a fit is about: K1, offset (as torque), K2, K3, inertia, K4.
pub const UNCERTAIN: usize = 6;
/// Usual errors of data sheets and of friction measured without load, relative standard deviations:
/// the torque constant's tolerance, friction over temperature, wear and joints alike, the rotor's
/// inertia with the wave generator's. By index of the parameter.
const DATA_SHEET: [(usize, f64); 4] = [(0, 0.05), (2, 0.3), (3, 0.3), (4, 0.1)];
/// Share of the torque that meshing gears lose and data sheets do not state, 1: K4's standard
/// deviation.
const MESHING_LOSS: f64 = 0.05;
/// Time over which the rate of the load is smoothed, s.
const RATE_TIME_S: f64 = 0.01;

impl CurrentEstimator {
    /// An estimator that has seen no sample.
    #[must_use]
    pub fn new(parameters: CurrentParameters) -> Self {
        let low_pass = crate::low_pass::LowPass::new(parameters.low_pass_pole);
        let delay_s = low_pass.delay_samples() * parameters.sample_period;
        Self {
            output: Output::new(torque_source::CURRENT, parameters.torque_limit, delay_s),
            low_pass,
            last_dq: None,
            uncertainty: None,
            validity: Validity::default(),
            last: None,
            friction: stops(&parameters.presliding),
            parameters,
        }
    }

    /// An estimator whose parameters are a data sheet's: no fit has narrowed their usual errors, and
    /// its sigma holds them.
    #[must_use]
    pub fn of_data_sheet(parameters: CurrentParameters) -> Self {
        let p = &parameters;
        let values = [p.k_1, 0.0, p.k_2, p.k_3, p.inertia, 1.0];
        let errors = DATA_SHEET.into_iter().chain([(5, MESHING_LOSS)]);
        let directions: Vec<Vec<f64>> = errors
            .map(|(k, error)| {
                let mut direction = vec![0.0; UNCERTAIN];
                direction[k] = error * values[k];
                direction
            })
            .collect();
        Self::new(parameters).with_uncertainty(&directions, Validity::default())
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

    /// Direction of friction, -1 to 1.
    fn direction(&mut self, sample: &JointSample) -> f64 {
        let p = &self.parameters;
        let Some((stops, begin)) = &mut self.friction else {
            return (sample.dq / p.sign_smoothing.max(f64::MIN_POSITIVE)).tanh();
        };
        let place = sample.theta / p.gear_ratio;
        //= T Presliding: sign(dq) -> sum_j w_j s_j / r_j,  s_j = min(max(s_j + x - x_last, -r_j), r_j),  x = theta/N
        stops.update(place - *begin.get_or_insert(place))
    }

    /// Variance outside of what the data covered, (N·m)². Of torques beyond it only the loss of meshing gears is
    /// unknown: the motor's own is linear in the current, and the covariance of K1 holds how far that is off.
    fn outside(&mut self, tau: f64, dq: f64) -> f64 {
        let period = self.parameters.sample_period;
        let rate = self.last.map_or(0.0, |(last, rate)| {
            rate + period / (RATE_TIME_S + period) * ((tau - last) / period - rate)
        });
        self.last = Some((tau, rate));
        let v = &self.validity;
        let errors = [
            MESHING_LOSS * v.beyond(tau),
            v.velocity_error(dq),
            v.loading_error(rate),
        ];
        errors.iter().map(|error| error * error).sum()
    }
}

/// Stops of unit friction in all; none without shares.
fn stops(presliding: &[(f64, f64); STOPS]) -> Option<(Hysteresis, Option<f64>)> {
    let usable = |(way, share): &&(f64, f64)| *way > 0.0 && *share > 0.0;
    let element = |(way, share): &(f64, f64)| SlipElement {
        limit: *way,
        stiffness: share / way,
    };
    let elements: Vec<SlipElement> = presliding.iter().filter(usable).map(element).collect();
    (!elements.is_empty()).then(|| (Hysteresis::new(&elements), None))
}

impl JointTorqueEstimator for CurrentEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        if !Output::usable(sample) {
            self.last_dq = None;
            return self.output.held();
        }
        if sample.flags & DRIVE_OFF != 0 {
            (self.last_dq, self.last) = (None, None);
            self.low_pass.reset();
            return self.output.held();
        }
        let direction = self.direction(sample);
        let p = &self.parameters;
        let JointSample { dq, current, .. } = *sample;
        let ddq = self
            .last_dq
            .map_or(0.0, |last| (dq - last) / p.sample_period);
        self.last_dq = Some(dq);
        //= D3: tau = K1 i - K2 dq - (K3 + K4 |tau|) sign(dq), solved for tau
        let driven = p.k_1 * (current - p.offset) - p.inertia * ddq;
        let carried = self.low_pass.update(driven) - p.k_2 * dq - p.k_3 * direction;
        let tau = carried / (1.0 + p.k_4 * direction * carried.signum());
        // At rest friction may point either way: uniform between its bounds.
        let unknown = (p.k_3 + p.k_4 * tau.abs()) * (1.0 - direction.abs()) / 3f64.sqrt();
        let mut variance = p.sigma * p.sigma + unknown * unknown;
        if let Some(uncertainty) = &mut self.uncertainty {
            let loss = -direction * tau.abs();
            let gradient = [current, 1.0, -dq, -direction, -ddq, loss];
            for (entry, value) in uncertainty.gradient().iter_mut().zip(gradient) {
                *entry = value;
            }
            variance += uncertainty.variance(1.0);
        }
        let sigma = (variance + self.outside(tau, dq)).sqrt();
        self.output.give(sample, tau, sigma)
    }

    fn tare(&mut self, sigma: f64) {
        // The zero that compensates the error there is a torque's.
        if let Some(uncertainty) = &mut self.uncertainty {
            uncertainty.tare(1.0, sigma * sigma);
        }
    }

    fn reset(&mut self) {
        if let Some(uncertainty) = &mut self.uncertainty {
            uncertainty.reset();
        }
        self.low_pass.reset();
        self.last_dq = None;
        self.last = None;
        if let Some((stops, begin)) = &mut self.friction {
            stops.reset();
            *begin = None;
        }
        self.output.reset();
    }
}
