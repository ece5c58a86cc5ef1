//! The robot as its user knows it.

use crate::drive::DriveSheet;

/// A joint as its user knows it.
#[derive(Debug, Clone)]
pub struct JointPlan {
    /// The joint's name in the URDF.
    pub name: String,
    /// The kind of drive, `[drive.NAME]` in `sim.toml`.
    pub drive: String,
    /// The drive's data sheet.
    pub sheet: DriveSheet,
}

/// The robot as its user knows it.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Whether the base moves freely.
    pub floating: bool,
    /// Joints in the user's order.
    pub joints: Vec<JointPlan>,
    /// Frames of the F/T sensors.
    pub ft_sensors: Vec<String>,
    /// Frame of the IMU.
    pub imu: Option<String>,
    /// Time between two samples of the sensors, s.
    pub period: f64,
}
