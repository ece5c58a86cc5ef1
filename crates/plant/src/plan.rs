//! The robot by its configuration.

use crate::drive::DriveSheet;

/// A joint by its configuration.
#[derive(Debug, Clone)]
pub struct JointPlan {
    /// The joint's name in the URDF.
    pub name: String,
    /// The kind of drive, `[drive.NAME]` in `sim.toml`.
    pub drive: String,
    /// The drive's data sheet.
    pub sheet: DriveSheet,
    /// The drive has the states of CiA 402, and starts switched off; otherwise it is always on.
    pub states: bool,
}

/// The robot by its configuration.
#[derive(Debug, Clone)]
pub struct Plan {
    /// True for a base that moves freely.
    pub floating: bool,
    /// Joints in config order.
    pub joints: Vec<JointPlan>,
    /// Frames of the F/T sensors.
    pub ft_sensors: Vec<String>,
    /// Frames of the IMUs.
    pub imus: Vec<String>,
    /// Time between two samples of the sensors, s.
    pub period: f64,
}
