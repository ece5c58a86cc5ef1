//! Rest: friction that the loop adds in mode torque to a joint that nothing brings back.
//!
//! A hinge under gravity finds a pose in which a slightly wrong torque is in balance; a slide finds none: the
//! smallest error beyond its own friction accelerates it for as long as it lasts, and the torque of the gear is
//! controlled so well that little of the drive's friction is left. An error cannot be distinguished from a torque
//! that somebody wants, so what is no larger than the torque's error moves nothing. It is a bristle (Dahl) on the link:
//!
//! ```text
//! tau = within(K_s (a - q) - K_d dq, F)        a follows q, at most F / K_s away
//! ```
//!
//! which takes energy from a joint in motion, and never gives it more than it has stored. Spring and damper are
//! those whose margins were judged.

use control::JointGains;
use robot_config::{JointParameters, Parameters};
use robot_state::JointKind;
use whole_body::LEVEL_CREEP_SHARE;

use crate::estimate::KINEMATIC_SLOPE;

/// Gravity, m/s².
const G: f64 = 9.81;

/// F: the torque that the loop's friction holds, N·m. Unless configured, of a prismatic joint what the torque of a
/// joint that stands may be wrong by: creep of its level, kinematic error over the way within which it stands, and
/// the rigid-body model's error of the greatest weight that it can bear.
pub(super) fn friction(joint: &JointParameters, parameters: &Parameters) -> f64 {
    let limits = &joint.limits;
    let least = match joint.kind {
        JointKind::Revolute => 0.0,
        JointKind::Prismatic => {
            let creep = LEVEL_CREEP_SHARE * limits.torque;
            let kinematic = KINEMATIC_SLOPE * joint.estimator.compliance.k_fs0 * limits.gives_way;
            let model = parameters.whole_body.sigma_model * joint.link_inertia * G;
            creep + kinematic + model
        }
    };
    joint.torque_friction.unwrap_or(least).min(limits.torque)
}

/// Share of the torque limit by which the torque of a joint that was let go may be wrong. It covers the level that a
/// joint keeps which stands, hysteresis and windup of its gear, and the model's weight. Chosen; no experiment recorded.
const LET_GO_SHARE: f64 = 0.002;

/// F of a joint that mode passive lets go, N·m: no gravity brings it back, as its torque carries its weight.
pub(super) fn friction_let_go(joint: &JointParameters, parameters: &Parameters) -> f64 {
    let least = match joint.torque_friction {
        Some(_) => 0.0,
        None => LET_GO_SHARE * joint.limits.torque,
    };
    friction(joint, parameters).max(least)
}

/// Standard deviations within which a torque is that nothing has levelled. Chosen; no experiment recorded.
const SIGMAS: f64 = 3.0;

/// Standard deviations of the torque by encoders that a joint which was let go is held against: none where F/T sensors
/// level that torque, or a calibration has shown what the gear is.
pub(super) fn unknown_level(joint: &JointParameters, parameters: &Parameters) -> f64 {
    let is_levelled = parameters.torque_law.uses_sensors() && !parameters.ft_sensors.is_empty();
    if is_levelled || joint.calibration.is_some() || joint.torque_friction.is_some() {
        0.0
    } else {
        SIGMAS
    }
}

/// The bristle: where it is fixed, rad.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rest {
    anchor: f64,
}

impl Rest {
    pub(super) fn at(q: f64) -> Self {
        Self { anchor: q }
    }

    /// Torque of the stand-still hold, N·m.
    pub(super) fn torque(&mut self, (q, dq): (f64, f64), gains: &JointGains, friction: f64) -> f64 {
        if !(friction > 0.0 && gains.k_s > 0.0) {
            return 0.0;
        }
        let most = friction / gains.k_s;
        // max and min, not clamp: they cannot panic.
        let stretch = (self.anchor - q).max(-most).min(most);
        self.anchor = q + stretch;
        (gains.k_s * stretch - gains.k_d * dq)
            .max(-friction)
            .min(friction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAINS: JointGains = JointGains {
        k_p: 0.0,
        k_i: 0.0,
        k_s: 1e5,
        k_d: 500.0,
    };
    const DT: f64 = 1e-3;

    /// A mass of 40 kg under a constant force, for a time: way and velocity.
    fn after(force: f64, from: f64, friction: f64, s: f64) -> (f64, f64) {
        let (mut q, mut dq) = (0.0, from);
        let mut rest = Rest::at(q);
        for _ in 0..(s / DT) as usize {
            dq += DT / 40.0 * (force + rest.torque((q, dq), &GAINS, friction));
            q += DT * dq;
        }
        (q, dq)
    }

    #[test]
    fn an_error_below_the_friction_moves_nothing_and_a_motion_ends() {
        let (q, dq) = after(4.0, 0.0, 5.0, 10.0);
        // The bristle is as long as 5e-5, and swings in.
        assert!(q < 1e-4 && dq.abs() < 1e-6, "{q} {dq}");
        let (q, dq) = after(0.0, 0.01, 5.0, 1.0);
        assert!(q < 1e-3 && dq.abs() < 1e-5, "{q} {dq}");
    }

    #[test]
    fn a_torque_beyond_it_moves_the_joint_by_the_rest() {
        let (_, dq) = after(25.0, 0.0, 5.0, 1.0);
        assert!((dq - 0.5).abs() < 0.02, "{dq}");
        let (_, free) = after(4.0, 0.0, 0.0, 1.0);
        assert!((free - 0.1).abs() < 1e-9, "{free}");
    }
}
