//! Motor: the torque that a joint's motor makes, by its current.
//!
//! In: motor current and velocity. Out: the torque on the gear, on the link side.
//!
//! ```text
//! tau = k_1 i - k_2 omega - k_3 sign(omega)      and - J omega' where the rotor is accelerated (D3)
//! ```

use robot_config::JointParameters;

use crate::estimate::sign_smoothing;

/// Viscous friction beyond the configured one that a motor may have, share of the torque limit per rad/s or m/s. Found
/// with a leg of another make: 0.7, as 160 N·m·s/rad where 1 is configured, with a torque limit of 233 N·m.
const MORE_FRICTION: f64 = 1.0;
/// Time for which two witnesses that contradicted each other are not believed together, s.
/// Chosen; no experiment recorded.
const APART_S: f64 = 0.5;

/// A joint's motor, on the link side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motor {
    /// Torque per current, N·m/A.
    pub(super) k_1: f64,
    /// Viscous friction, N·m·s/rad.
    pub(super) k_2: f64,
    /// Coulomb friction, N·m.
    pub(super) k_3: f64,
    /// Rotor's inertia, kg·m².
    pub(super) inertia: f64,
    /// N: gear ratio, 1.
    pub(super) gear_ratio: f64,
    /// Velocity over which friction changes sign, rad/s.
    pub(super) smoothing: f64,
    /// Viscous friction that it may have besides, N·m·s/rad.
    more_friction: f64,
}

impl Motor {
    /// For tests: torque constant of 6 N·m/A, friction of 4 N·m.
    #[cfg(test)]
    pub(super) const EXAMPLE: Self = Self {
        k_1: 6.0,
        k_2: 0.0,
        k_3: 4.0,
        inertia: 0.0,
        gear_ratio: 100.0,
        smoothing: 0.01,
        more_friction: 110.0,
    };

    pub(super) fn new(joint: &JointParameters) -> Self {
        let (n, motor) = (joint.encoders.gear_ratio, &joint.estimator.wave_generator);
        Self {
            k_1: n * motor.torque_constant,
            k_2: n * n * motor.viscous_friction,
            k_3: n * motor.friction,
            inertia: n * n * joint.rotor_inertia,
            gear_ratio: n,
            smoothing: sign_smoothing(joint),
            more_friction: MORE_FRICTION * joint.limits.torque,
        }
    }

    /// Torque at a current, A, and a velocity, rad/s, that does not change.
    pub(super) fn torque(&self, current: f64, omega: f64) -> f64 {
        let direction = (omega / self.smoothing).tanh();
        //= D3: tau = K1 i - K2 dq - K3 sign(dq)
        self.k_1 * current - self.k_2 * omega - self.k_3 * direction
    }

    /// Whether the motor turns by more than `widths` of those over which friction changes sign: its friction is then
    /// known.
    pub(super) fn turns(&self, omega: f64, widths: f64) -> bool {
        omega.abs() > widths * self.smoothing
    }
}

/// Discerns an encoder that errs from a hand that turns a motor of more friction than configured. Of the torque by
/// torsion both motor current and F/T sensors then show an error, as of such an encoder's. But the hand's is there
/// before the motor turns, and friction's grows with the velocity: for a while one is without the other.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct HandOrEncoder {
    /// Time for which the errors are not believed together, s.
    left_s: f64,
}

impl HandOrEncoder {
    /// Whether a hand may be what the errors of the torque by torsion show: by motor current, and by F/T sensors and model,
    /// N·m, which errors of the models leave `apart` at most; at a velocity, rad/s, link side.
    pub(super) fn is_hand(
        &mut self,
        motor: &Motor,
        [by_current, by_level]: [f64; 2],
        omega: f64,
        apart: f64,
        dt: f64,
    ) -> bool {
        if (by_level - by_current).abs() > apart {
            self.left_s = APART_S;
        } else {
            self.left_s = (self.left_s - dt).max(0.0);
        }
        let opposes = by_current * omega < 0.0;
        let is_friction = opposes && by_current.abs() < motor.more_friction * omega.abs();
        is_friction && self.left_s > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hand pushes with 30 N·m from 0.1 s on. The motor, of a friction of 100 N·m·s/rad, turns within 30 ms.
    #[test]
    fn friction_grows_with_the_velocity_and_an_encoder_shows_one_error() {
        let mut of_hand = HandOrEncoder::default();
        let mut of_encoder = HandOrEncoder::default();
        for k in 0..300 {
            let pushed = k >= 100;
            let level = if pushed { -30.0 } else { 0.0 };
            let omega = (0.01 * f64::from(k - 100)).clamp(0.0, 0.3);
            let hand = [-100.0 * omega, level];
            let is_hand = of_hand.is_hand(&Motor::EXAMPLE, hand, omega, 10.0, 1e-3);
            assert_eq!(is_hand, k > 100, "{k}");
            let encoder = [level; 2];
            assert!(!of_encoder.is_hand(&Motor::EXAMPLE, encoder, omega, 10.0, 1e-3));
        }
    }
}
