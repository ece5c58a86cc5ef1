//! Drives: the command by which a drive makes a torque (D 3).

/// A drive: what its commands are, and the joint torque that they make.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DriveModel {
    /// A drive that takes positions.
    Position(PositionDrive),
    /// A drive that takes currents.
    Current(CurrentDrive),
}

/// A position-commanded drive: `delta_q = K_tau tau + K_v dq + K_c sign(dq)` (D6). Its loop is a spring and a damper
/// between set-point and motor, in series with the gear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionDrive {
    /// K_tau: angle by which a command leads the link for a torque, through drive and gear, rad/(N·m).
    pub k_tau: f64,
    /// The share of it that is the drive's: from the command to the motor side, rad/(N·m).
    pub k_tau_motor: f64,
    /// K_v: viscous friction and the loop's damping, s.
    pub k_v: f64,
    /// K_c: Coulomb friction, rad.
    pub k_c: f64,
    /// Velocity over which `sign` is smoothed, rad/s.
    pub sign_smoothing: f64,
    /// Errors below this make no torque, rad.
    pub dead_zone: f64,
    /// 1/T_i: rate of the velocity loop's integral, 1/s; 0: it has none.
    pub integral: f64,
}

/// A current-commanded drive: `tau = K1 i - K2 dq - K3 sign(dq)` (D3).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurrentDrive {
    /// K1: joint torque per current, N·m/A.
    pub k_1: f64,
    /// K2: viscous friction, N·m·s/rad.
    pub k_2: f64,
    /// K3: Coulomb friction, N·m.
    pub k_3: f64,
    /// Velocity over which `sign` is smoothed, rad/s.
    pub sign_smoothing: f64,
    /// Greatest |current|, A.
    pub current_limit: f64,
}

impl DriveModel {
    /// Part of the command for the torque: delta_q, rad, or current, A.
    #[must_use]
    pub fn torque_part(&self, tau: f64) -> f64 {
        match self {
            //= D10: delta_q = K_tau tau* + K_v dq + K_c sign(dq)
            Self::Position(drive) => drive.k_tau * tau,
            //= D3: i = (tau + K2 dq + K3 sign(dq)) / K1
            Self::Current(drive) => tau / drive.k_1,
        }
    }

    /// Part of the command against friction at `dq`: delta_q, rad, or current, A.
    #[must_use]
    pub fn friction_part(&self, dq: f64) -> f64 {
        match self {
            //= D10: delta_q = K_tau tau* + K_v dq + K_c sign(dq)
            Self::Position(drive) => {
                drive.k_v * dq + drive.k_c * smooth_sign(dq, drive.sign_smoothing)
            }
            //= D3: i = (tau + K2 dq + K3 sign(dq)) / K1
            Self::Current(drive) => {
                (drive.k_2 * dq + drive.k_3 * smooth_sign(dq, drive.sign_smoothing)) / drive.k_1
            }
        }
    }

    /// The torque that a command produces at `dq`: the inverse of the two parts' sum.
    #[must_use]
    pub fn torque(&self, command: f64, dq: f64) -> f64 {
        let without_friction = command - self.friction_part(dq);
        match self {
            //= D6: delta_q = K_tau tau + K_v dq + K_c sign(dq)
            Self::Position(drive) => without_friction / drive.k_tau,
            //= D3: tau = K1 i - K2 dq - K3 sign(dq)
            Self::Current(drive) => without_friction * drive.k_1,
        }
    }

    /// Whether the drive takes positions, not currents.
    #[must_use]
    pub fn takes_position(&self) -> bool {
        matches!(self, Self::Position(_))
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
    use super::{CurrentDrive, DriveModel, PositionDrive};
    use proptest::prelude::*;

    const POSITION: DriveModel = DriveModel::Position(PositionDrive {
        k_tau: 1.2e-4,
        k_tau_motor: 0.8e-4,
        k_v: 7e-3,
        k_c: 1e-4,
        sign_smoothing: 0.02,
        dead_zone: 0.0,
        integral: 0.0,
    });
    const CURRENT: DriveModel = DriveModel::Current(CurrentDrive {
        k_1: 9.6,
        k_2: 12.0,
        k_3: 4.0,
        sign_smoothing: 0.02,
        current_limit: 10.0,
    });

    proptest! {
        #[test]
        fn torque_inverts_the_command(tau in -200.0..200.0f64, dq in -5.0..5.0f64) {
            for drive in [POSITION, CURRENT] {
                let command = drive.torque_part(tau) + drive.friction_part(dq);
                prop_assert!((drive.torque(command, dq) - tau).abs() < 1e-9);
            }
        }

        #[test]
        fn friction_is_odd_and_grows_with_velocity(dq in 0.0..5.0f64) {
            prop_assert!((POSITION.friction_part(dq) + POSITION.friction_part(-dq)).abs() < 1e-15);
            prop_assert!(POSITION.friction_part(dq + 0.1) > POSITION.friction_part(dq));
        }
    }
}
