//! Reasons why a cycle cannot be prepared.

use core::fmt;
use problem::Problem;
use robot_state::{MAX_FT_SENSORS, MAX_JOINTS};
use whole_body::WholeBodyError;

/// Why a cycle cannot be prepared.
#[derive(Debug)]
pub enum CycleError {
    /// More joints or F/T sensors than a record holds.
    TooLarge {
        /// Joints of the robot.
        joints: usize,
        /// F/T sensors of the robot.
        sensors: usize,
    },
    /// A filter that cannot be built.
    Filter(Problem),
    /// Sensors from which the torques do not follow.
    WholeBody(WholeBodyError),
    /// A joint file whose estimators cannot be built.
    Calibration(Problem),
    /// A floating base without an IMU or a stand.
    NoImu,
}

impl fmt::Display for CycleError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLarge { joints, sensors } => write!(
                f,
                "{joints} joints and {sensors} F/T sensors; \
                 allowed: at most {MAX_JOINTS} and {MAX_FT_SENSORS}"
            ),
            Self::Filter(error) => write!(f, "filters: {error}"),
            Self::WholeBody(error) => write!(f, "whole_body: {error}"),
            Self::Calibration(error) => write!(f, "calibration: {error}"),
            Self::NoImu => write!(f, "a floating base needs an IMU, or a stand"),
        }
    }
}

impl core::error::Error for CycleError {}

impl From<Problem> for CycleError {
    fn from(error: Problem) -> Self {
        Self::Filter(error)
    }
}

impl From<WholeBodyError> for CycleError {
    fn from(error: WholeBodyError) -> Self {
        Self::WholeBody(error)
    }
}
