//! Bounds, flags and held values: common to all estimators.

use crate::joint::{DRIVE_OFF, JointSample};
use robot_state::{TorqueEstimate, measured_flags, torque_flags};

/// Bounds an estimator's output, and keeps the last one for cycles without a usable sample.
#[derive(Debug, Clone)]
pub(crate) struct Output {
    limit: f64,
    delay_s: f64,
    last: TorqueEstimate,
}

impl Output {
    pub(crate) fn new(source: u32, limit: f64, delay_s: f64) -> Self {
        let last = TorqueEstimate {
            source,
            ..TorqueEstimate::default()
        };
        Self {
            limit,
            delay_s,
            last,
        }
    }

    pub(crate) fn reset(&mut self) {
        *self = Self::new(self.last.source, self.limit, self.delay_s);
    }

    /// Whether the sample is finite and of an encoder that has answered.
    pub(crate) fn usable(sample: &JointSample) -> bool {
        let JointSample {
            q,
            theta,
            dq,
            omega,
            current,
            flags,
            feed_forward: _,
        } = *sample;
        let finite = [q, theta, dq, omega, current].iter().all(|x| x.is_finite());
        finite && flags & measured_flags::NEVER == 0
    }

    /// The last value, marked as not to be used.
    pub(crate) fn held(&mut self) -> TorqueEstimate {
        self.last.flags &= !torque_flags::VALID;
        self.last
    }

    /// A new value; held if it is not finite.
    pub(crate) fn give(&mut self, sample: &JointSample, tau: f64, sigma: f64) -> TorqueEstimate {
        if !(tau.is_finite() && sigma >= 0.0) {
            return self.held();
        }
        let mut flags = torque_flags::VALID;
        if tau.abs() >= self.limit {
            flags |= torque_flags::SATURATED;
        }
        if sample.flags & !DRIVE_OFF != 0 {
            flags |= torque_flags::DEGRADED;
        }
        self.last = TorqueEstimate {
            tau: tau.clamp(-self.limit, self.limit),
            sigma: sigma.min(self.limit),
            delay_s: self.delay_s,
            source: self.last.source,
            flags,
        };
        self.last
    }
}
