//! A model (G: the compliance model) corrected by local Gaussian processes.

use super::{LocalGp, Prediction};
use crate::joint::{AnyEstimator, JointSample, JointTorqueEstimator};
use crate::output::Output;
use crate::regimes::Motion;
use robot_state::{TorqueEstimate, torque_flags, torque_source};

/// The correction of a model by its learned residual.
pub struct LocalGpEstimator {
    base: AnyEstimator,
    residual: LocalGp,
    motion: Motion,
    output: Output,
}

impl LocalGpEstimator {
    /// The correction of `base` by its residual; `torque_limit` in N·m.
    #[must_use]
    pub fn new(base: AnyEstimator, residual: LocalGp, torque_limit: f64) -> Self {
        Self {
            base,
            residual,
            motion: Motion::default(),
            output: Output::new(torque_source::ENCODER, torque_limit, 0.0),
        }
    }
}

impl JointTorqueEstimator for LocalGpEstimator {
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        let model = self.base.update(sample);
        if model.flags & torque_flags::VALID == 0 || !Output::usable(sample) {
            return self.output.held();
        }
        let gp = &self.residual;
        let x = gp.features.of(sample, sample.current, gp.gear_ratio);
        let regime = gp.regimes.mix(self.motion.update(sample, &gp.regimes));
        let Prediction { mean, variance, .. } = gp.predict(&x);
        // The share of the correction that is not applied leaves the model's own variance.
        let own = (1.0 - regime.gain) * model.sigma;
        let variance = regime.sigma * regime.sigma + regime.gain.powi(2) * variance + own * own;
        //= G6: tau = tau_model + f(q, theta, i)
        let tau = model.tau + regime.gain * mean;
        let mut estimate = self.output.give(sample, tau, variance.sqrt());
        estimate.flags |= model.flags & torque_flags::SATURATED;
        estimate.delay_s = model.delay_s;
        estimate
    }

    fn reset(&mut self) {
        self.base.reset();
        self.motion = Motion::default();
        self.output.reset();
    }
}
