//! Readings of the robot's sensors.

use crate::drive::DriveReading;
use robot_config::slots::Source;
use robot_state::Wrench;

/// All sensors as last sampled: at the end of a period, or before it by their own clocks.
#[derive(Debug, Clone)]
pub struct Readings {
    /// Drives, in the plan's order.
    pub joints: Vec<DriveReading>,
    /// F/T sensors: the wrench that the child side applies to the parent side.
    pub ft: Vec<Wrench>,
    /// Temperatures of the F/T sensors, °C.
    pub ft_temperature: Vec<f64>,
    /// IMUs: gyro, rad/s, then accelerometer, m/s².
    pub imus: Vec<[f64; 6]>,
    /// Samples of sensors with clocks of their own, up to the next period.
    pub sent: Vec<Sent>,
}

/// A sample that a sensor has sent by its own clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sent {
    /// Its source.
    pub source: Source,
    /// Time stamp of its frame, s since the start.
    pub stamp: f64,
    /// F/T sensor: force, torque; IMU: gyro, accelerometer; drive: theta, q, current, omega, status.
    pub values: [f64; 6],
}

pub(crate) fn six([x, y, z]: [f64; 3], [a, b, c]: [f64; 3]) -> [f64; 6] {
    [x, y, z, a, b, c]
}
