//! Motor models: the command by which a drive produces a torque (D 3).

/// Relation between a drive's command and the joint's torque.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MotorModel {
    /// Position-commanded drive: `delta_q = K_tau tau + K_v dq + K_c sign(dq)` (D6).
    Position {
        /// K_tau: inverse stiffness of the drive's position loop, rad/(N·m).
        k_tau: f64,
        /// K_v: viscous friction and the loop's damping, s.
        k_v: f64,
        /// K_c: Coulomb friction, rad.
        k_c: f64,
        /// Velocity over which `sign` is smoothed, rad/s.
        sign_smoothing: f64,
    },
    /// Current-commanded drive: `tau = K1 i - K2 dq - K3 sign(dq)` (D3).
    Current {
        /// K1: joint torque per current, N·m/A.
        k1: f64,
        /// K2: viscous friction, N·m·s/rad.
        k2: f64,
        /// K3: Coulomb friction, N·m.
        k3: f64,
        /// Velocity over which `sign` is smoothed, rad/s.
        sign_smoothing: f64,
    },
}

impl MotorModel {
    /// Part of the command for the torque: delta_q, rad, or current, A.
    #[must_use]
    pub fn torque_part(&self, tau: f64) -> f64 {
        match *self {
            //= D10: delta_q = K_tau tau* + K_v dq + K_c sign(dq)
            Self::Position { k_tau, .. } => k_tau * tau,
            //= D3: i = (tau + K2 dq + K3 sign(dq)) / K1
            Self::Current { k1, .. } => tau / k1,
        }
    }

    /// Part of the command against friction at `dq`: delta_q, rad, or current, A.
    #[must_use]
    pub fn friction_part(&self, dq: f64) -> f64 {
        match *self {
            //= D10: delta_q = K_tau tau* + K_v dq + K_c sign(dq)
            Self::Position {
                k_v,
                k_c,
                sign_smoothing,
                ..
            } => k_v * dq + k_c * smooth_sign(dq, sign_smoothing),
            //= D3: i = (tau + K2 dq + K3 sign(dq)) / K1
            Self::Current {
                k1,
                k2,
                k3,
                sign_smoothing,
            } => (k2 * dq + k3 * smooth_sign(dq, sign_smoothing)) / k1,
        }
    }

    /// The torque that a command produces at `dq`: the inverse of the two parts' sum.
    #[must_use]
    pub fn torque(&self, command: f64, dq: f64) -> f64 {
        let without_friction = command - self.friction_part(dq);
        match *self {
            //= D6: delta_q = K_tau tau + K_v dq + K_c sign(dq)
            Self::Position { k_tau, .. } => without_friction / k_tau,
            //= D3: tau = K1 i - K2 dq - K3 sign(dq)
            Self::Current { k1, .. } => without_friction * k1,
        }
    }
}

/// `sign(x)` made continuous: tanh(x / width). A step at zero velocity would make the joint
/// chatter.
#[must_use]
pub fn smooth_sign(x: f64, width: f64) -> f64 {
    (x / width).tanh()
}

#[cfg(test)]
mod tests {
    use super::MotorModel;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn torque_inverts_the_command(tau in -200.0..200.0f64, dq in -5.0..5.0f64) {
            for motor in [
                MotorModel::Position { k_tau: 1.2e-4, k_v: 7e-3, k_c: 1e-4, sign_smoothing: 0.02 },
                MotorModel::Current { k1: 9.6, k2: 12.0, k3: 4.0, sign_smoothing: 0.02 },
            ] {
                let command = motor.torque_part(tau) + motor.friction_part(dq);
                prop_assert!((motor.torque(command, dq) - tau).abs() < 1e-9);
            }
        }

        #[test]
        fn friction_is_odd_and_grows_with_velocity(dq in 0.0..5.0f64) {
            let motor = MotorModel::Position { k_tau: 1.2e-4, k_v: 7e-3, k_c: 1e-4, sign_smoothing: 0.02 };
            prop_assert!((motor.friction_part(dq) + motor.friction_part(-dq)).abs() < 1e-15);
            prop_assert!(motor.friction_part(dq + 0.1) > motor.friction_part(dq));
        }
    }
}
