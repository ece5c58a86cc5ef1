//! Joint torque from the motor current (D3): independent of both encoders' difference.

use crate::joint::{JointSample, JointTorqueEstimator};
use crate::output::Output;
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
    /// |dq| at which sign(dq) is smoothed, rad/s, link side.
    pub sign_smoothing: f64,
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
}

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
            parameters,
        }
    }
}

impl JointTorqueEstimator for CurrentEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        if !Output::usable(sample) {
            self.last_dq = None;
            return self.output.held();
        }
        let p = &self.parameters;
        let JointSample { dq, current, .. } = *sample;
        let ddq = self
            .last_dq
            .map_or(0.0, |last| (dq - last) / p.sample_period);
        self.last_dq = Some(dq);
        let direction = (dq / p.sign_smoothing.max(f64::MIN_POSITIVE)).tanh();
        //= D3: tau = K1 i - K2 dq - (K3 + K4 |tau|) sign(dq), solved for tau
        let driven = p.k_1 * (current - p.offset) - p.inertia * ddq;
        let carried = self.low_pass.update(driven) - p.k_2 * dq - p.k_3 * direction;
        let tau = carried / (1.0 + p.k_4 * direction * carried.signum());
        // At rest friction may point either way: uniform between its bounds.
        let unknown = (p.k_3 + p.k_4 * tau.abs()) * (1.0 - direction.abs()) / 3f64.sqrt();
        self.output.give(sample, tau, p.sigma.hypot(unknown))
    }

    fn reset(&mut self) {
        self.low_pass.reset();
        self.last_dq = None;
        self.output.reset();
    }
}
