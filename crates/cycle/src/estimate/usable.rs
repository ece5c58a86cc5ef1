//! Usable: what of a record may be relied on.

use robot_state::{CycleRecord, TorqueEstimate, torque_flags};

/// What is odd about any signal that enters the equations of motion.
pub(crate) fn all_flags(record: &CycleRecord) -> u32 {
    let joints = record.joints.iter().take(record.joint_count as usize);
    let sensors = record.ft.iter().take(record.ft_count as usize);
    let joints = joints.fold(0, |all, joint| all | joint.measured.flags);
    sensors.fold(joints | record.imu.flags, |all, sensor| all | sensor.flags)
}

/// A saturated torque says nothing but its sign.
pub(crate) fn valid(estimate: &TorqueEstimate) -> Option<&TorqueEstimate> {
    let usable = torque_flags::VALID | torque_flags::SATURATED;
    (estimate.flags & usable == torque_flags::VALID).then_some(estimate)
}
