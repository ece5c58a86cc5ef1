//! No current: where any would drive a joint that is to stand.

use super::{Limited, Limiter};

impl Limiter {
    /// No current at all, at once, whatever was sent before.
    pub fn no_current(&mut self, asked: f64) -> Limited {
        (self.last, self.last_torque) = (0.0, 0.0);
        (self.kept_back, self.keeps_back) = (0.0, 0);
        Limited {
            asked,
            applied: 0.0,
            flags: 0,
        }
    }
}
