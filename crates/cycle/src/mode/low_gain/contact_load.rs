//! ContactLoad: the torque of contacts that a softly held joint carries.
//!
//! In: the joint's angle and `-J^T f_hat` by the F/T sensors. Out: what of it is fed forward. Against a soft spring a
//! sensor that errs would set the joint in motion, and nothing else shows that it errs while the joint stands: so the
//! torque of a joint that stands is the one that it came to stand with. A joint that has turned follows, with a lag.

use whole_body::LEVEL_CREEP_SHARE;

/// Time after a motion for which the torque follows, and with which lag, s: as the level of a torque does.
const FOLLOWS_S: f64 = 1.5;
const LAG_S: f64 = 0.1;

/// Torque that a joint bears.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ContactLoad {
    /// Where it stands, rad.
    angle: f64,
    /// The torque that it came to stand with, N·m.
    torque: f64,
    /// Time for which the torque still follows, s.
    follows: f64,
}

impl ContactLoad {
    pub(super) fn at(angle: f64, torque: f64) -> Self {
        Self {
            angle,
            torque,
            follows: 0.0,
        }
    }

    /// The torque to be fed forward, N·m; `within`: way within which the joint stands, rad.
    pub(super) fn follow(
        &mut self,
        (angle, torque): (f64, f64),
        (within, limit): (f64, f64),
        dt: f64,
    ) -> f64 {
        if !(angle.is_finite() && torque.is_finite() && self.torque.is_finite()) {
            *self = Self::at(angle, torque);
            return torque;
        }
        if (angle - self.angle).abs() > within {
            (self.angle, self.follows) = (angle, FOLLOWS_S);
        }
        if self.follows > 0.0 {
            self.follows -= dt;
            self.torque += (torque - self.torque) * (dt / LAG_S).min(1.0);
            return self.torque;
        }
        let creep = LEVEL_CREEP_SHARE * limit;
        self.torque + (torque - self.torque).max(-creep).min(creep)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STANDS: (f64, f64) = (0.01, 100.0);
    const DT: f64 = 1e-3;

    #[test]
    fn a_joint_that_stands_keeps_its_torque_and_one_that_turns_follows() {
        let mut load = ContactLoad::at(1.0, 5.0);
        for _ in 0..2000 {
            let torque = load.follow((1.004, 25.0), STANDS, DT);
            assert!((torque - 5.0).abs() < 0.06, "{torque}");
        }
        let mut last = load.follow((1.004, 25.0), STANDS, DT);
        for _ in 0..1000 {
            let torque = load.follow((1.02, 25.0), STANDS, DT);
            assert!((torque - last).abs() < 0.3, "{torque} after {last}");
            last = torque;
        }
        assert!((last - 25.0).abs() < 0.01, "{last}");
    }

    #[test]
    fn what_is_no_number_is_forgotten() {
        let mut load = ContactLoad::at(1.0, f64::NAN);
        assert_eq!(load.follow((1.0, 3.0), STANDS, DT), 3.0);
        assert_eq!(load.follow((1.0, 3.0), STANDS, DT), 3.0);
    }
}
