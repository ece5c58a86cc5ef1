//! The record of a frame: pose, wrench and flags.

use control::{CartesianWrench, unit_quaternion};
use dynamics::Se3;
use nalgebra::{Matrix3, Vector6};
use robot_state::{FrameCommanded, frame_flags};

use super::frame_check::Placements;
use super::frames::Frame;

/// w x y z.
fn quaternion(rotation: &Matrix3<f64>) -> [f64; 4] {
    let [x, y, z, w] = unit_quaternion(rotation).coords.into();
    [w, x, y, z]
}

impl Frame {
    pub(super) fn pose_record(&self, placements: &Placements) -> FrameCommanded {
        let pose = placements.between(self.parameters.base, self.parameters.link);
        FrameCommanded {
            position: pose.translation.into(),
            orientation: quaternion(&pose.rotation),
            flags: frame_flags::VALID,
            ..FrameCommanded::default()
        }
    }

    pub(super) fn record(
        &self,
        pose: &Se3,
        wrench: &CartesianWrench,
        force: Option<Vector6<f64>>,
    ) -> FrameCommanded {
        let flag = |on: bool, flag: u32| if on { flag } else { 0 };
        FrameCommanded {
            position: pose.translation.into(),
            orientation: quaternion(&pose.rotation),
            wrench: wrench.sum().into(),
            force_estimated: force.unwrap_or_default().into(),
            flags: frame_flags::VALID
                | frame_flags::ACTIVE
                | flag(wrench.limited, frame_flags::WRENCH_LIMITED)
                | flag(wrench.shares != [1.0; 2], frame_flags::GAINS_LIMITED)
                | flag(wrench.led, frame_flags::LED)
                | flag(force.is_some(), frame_flags::FORCE_KNOWN),
            reserved: 0,
        }
    }
}
