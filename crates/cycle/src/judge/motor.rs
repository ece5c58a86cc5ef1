//! Motor: the torque that a joint's motor makes, by its current.
//!
//! In: motor current and velocity. Out: the torque on the gear, on the link side.
//!
//! ```text
//! tau = k_1 i - k_2 omega - k_3 sign(omega)      and - J omega' where the rotor is accelerated (D3)
//! ```

use robot_config::JointParameters;

use crate::estimate::sign_smoothing;

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
