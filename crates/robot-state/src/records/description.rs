//! Names and constants of a robot.

use super::{MAX_CONTACT_SETS, MAX_FRAMES, MAX_FT_SENSORS, MAX_JOINTS};
use crate::joint_kind::JointKind;
use crate::layout::record;
use crate::name::Name;

record! {
    /// Names and constants of the robot, published once.
    pub struct Description {
        /// The robot's name.
        pub robot: Name,
        /// Cycles a second, Hz.
        pub rate_hz: f64,
        /// Joints in use.
        pub joint_count: u32,
        /// F/T sensors in use.
        pub ft_count: u32,
        /// Names of the joints, in the order of every record's `joints`.
        pub joint_names: [Name; MAX_JOINTS],
        /// Names of the F/T sensors, in the order of every record's `ft`.
        pub ft_names: [Name; MAX_FT_SENSORS],
        /// Kinds of the joints, numbers of `JointKind`. Of a prismatic joint every link-side quantity of
        /// every record is in m where its documentation has rad, and in N where it has N·m.
        pub joint_kinds: [u32; MAX_JOINTS],
        /// Torque limits of the joints, N·m.
        pub torque_limits: [f64; MAX_JOINTS],
        /// Lower position limits of the joints, rad.
        pub position_min: [f64; MAX_JOINTS],
        /// Upper position limits of the joints, rad.
        pub position_max: [f64; MAX_JOINTS],
        /// Contact sets in use.
        pub contact_set_count: u32,
        /// Frames that mode Cartesian can lead.
        pub frame_count: u32,
        /// Names of the contact sets; the first is in use at the start.
        pub contact_set_names: [Name; MAX_CONTACT_SETS],
        /// Names of the frames, in the order of every record's `frames`.
        pub frame_names: [Name; MAX_FRAMES],
    }
}

impl Description {
    /// The kind of a joint.
    #[must_use]
    pub fn joint_kind(&self, joint: usize) -> JointKind {
        let number = self.joint_kinds.get(joint).copied().unwrap_or_default();
        JointKind::from_number(number)
    }
}
