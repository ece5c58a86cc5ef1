//! The public side of a drive: data sheet, set point, reading.

use crate::kinematic_error::KinematicError;
use robot_state::JointKind;

/// Quantity of a drive's set point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// Position, rad link side.
    Position,
    /// Motor current, A.
    Current,
}

/// A drive's data sheet.
#[derive(Debug, Clone)]
pub struct DriveSheet {
    /// Kind of the joint: link-side quantities are in m and N of a prismatic one.
    pub kind: JointKind,
    /// N: gear ratio, 1 or rad/m.
    pub gear_ratio: f64,
    /// K_t: torque constant, motor side, N·m/A.
    pub torque_constant: f64,
    /// J_m: rotor inertia, kg·m².
    pub rotor_inertia: f64,
    /// Counts per turn of the motor encoder.
    pub motor_counts_per_turn: f64,
    /// Counts of the link encoder for `2 pi` of the joint, rad or m.
    pub link_counts_per_turn: f64,
    /// Quantity of the set points.
    pub command: Command,
    /// The calibrated part of the kinematic error; the true one has further harmonics.
    pub kinematic_error: KinematicError,
}

/// Readings of a drive's sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveReading {
    /// theta: motor angle over many turns, rad.
    pub theta: f64,
    /// q: link angle, rad.
    pub q: f64,
    /// i: current, A.
    pub current: f64,
    /// omega: motor velocity as the drive filters it, rad/s.
    pub omega: f64,
    /// Status word; a drive without states reports that it is enabled.
    pub status: u32,
    /// What it reports of itself besides.
    pub report: DriveReport,
}

/// What a drive reports of itself besides its sample.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DriveReport {
    /// Temperature of its winding, °C, in whole degrees.
    pub temperature: f64,
    /// Voltage of its supply, V.
    pub voltage: f64,
    /// Its own torque: that of its current by its data sheet, N·m at the joint.
    pub torque: f64,
    /// Number of its error; 0: none.
    pub error: u32,
}
