//! Stand: how far the level of a joint's torque may change while the joint stands.
//!
//! In: the joint's angle, the fast source's torque, the level that the delayed source asks for. Out:
//! the level within what turning and torque explain since the joint came to stand. For
//! [`LEVEL_SETTLING_TIME`] after a motion the level follows freely, as it is late.

use super::{DelayCompensatorParameters, LEVEL_TIME};

/// Time after a motion until which the level still follows, s.
const LEVEL_SETTLING_TIME: f64 = 3.0 * LEVEL_TIME;
/// Change of the level of a joint that stands, share of the torque limit: creep of the gear, noise.
pub const LEVEL_CREEP_SHARE: f64 = 5e-4;
/// The same per change of the torque, which the fast source's scale and hysteresis make wrong; and the
/// change that is none, share of the torque limit.
const SCALE_SHARE: f64 = 0.3;
const SAME_SHARE: f64 = 0.01;

/// A joint that stands, and what its level may be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stand {
    angle: f64,
    /// b when it came to stand, N·m.
    pub(super) level: f64,
    /// Time left for which the level follows, s.
    settling: f64,
    /// Least and greatest torque by the fast source, N·m.
    torques: Option<(f64, f64)>,
}

impl Stand {
    pub(super) fn at(angle: f64, level: f64, settling: f64) -> Self {
        Self {
            angle,
            level,
            settling,
            torques: None,
        }
    }

    /// The level that `asked` is limited to.
    pub(super) fn bound(
        &mut self,
        p: &DelayCompensatorParameters,
        angle: f64,
        torque: f64,
        asked: f64,
    ) -> f64 {
        let way = (angle - self.angle).abs();
        if way > p.stands_within {
            *self = Self::at(angle, asked, LEVEL_SETTLING_TIME);
            return asked;
        }
        let (low, high) = self.torques.unwrap_or((torque, torque));
        let (low, high) = (low.min(torque), high.max(torque));
        if self.settling > 0.0 {
            self.settling -= p.sample_period;
            self.level = asked;
            return asked;
        }
        self.torques = Some((low, high));
        let change = LEVEL_CREEP_SHARE * p.torque_limit
            + SCALE_SHARE * (high - low - SAME_SHARE * p.torque_limit).max(0.0)
            + p.error_per_angle * way;
        // max and min, not clamp: they cannot panic.
        asked.max(self.level - change).min(self.level + change)
    }
}
