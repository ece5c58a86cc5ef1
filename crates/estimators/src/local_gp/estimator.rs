//! A model (G: the compliance model) corrected by local Gaussian processes.

use super::{LocalGp, Prediction};
use crate::joint::{JointSample, JointTorqueEstimator};
use crate::output::Output;
use crate::regimes::Motion;
use robot_state::{TorqueEstimate, torque_flags, torque_source};

/// The correction of a model by a residual that may be learned on.
pub struct LocalGpEstimator {
    base: Box<dyn JointTorqueEstimator + Send>,
    residual: triple_buffer::Output<LocalGp>,
    motion: Motion,
    output: Output,
}

impl LocalGpEstimator {
    /// The correction of `base` by a residual that stays as it is.
    #[must_use]
    pub fn new(
        base: Box<dyn JointTorqueEstimator + Send>,
        residual: &LocalGp,
        torque_limit: f64,
    ) -> Self {
        Self::learning(base, triple_buffer::triple_buffer(residual).1, torque_limit)
    }

    /// The correction of `base` by the newest residual that an updater has finished.
    ///
    /// The newest one is taken at each sample by an exchange of two indices: the loop never waits
    /// for the updater and never frees what that one allocated.
    #[must_use]
    pub fn learning(
        base: Box<dyn JointTorqueEstimator + Send>,
        residual: triple_buffer::Output<LocalGp>,
        torque_limit: f64,
    ) -> Self {
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
        let gp = self.residual.read();
        let x = gp.features.of(sample, sample.current, gp.gear_ratio);
        let regime = gp.regimes.mix(self.motion.update(sample, &gp.regimes));
        let Prediction { mean, variance, .. } = gp.predict(&x);
        // What is not taken of the correction leaves the model's own doubt.
        let own = (1.0 - regime.gain) * model.sigma;
        let doubt = regime.sigma * regime.sigma + regime.gain.powi(2) * variance + own * own;
        //= G: tau = tau_model + y
        let tau = model.tau + regime.gain * mean;
        let mut estimate = self.output.give(sample, tau, doubt.sqrt());
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
