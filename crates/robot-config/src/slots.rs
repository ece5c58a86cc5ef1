//! Indices of the quantities among the values that the tables decode and encode.
//!
//! Receive: the IMUs and the F/T sensors that a record can hold, then the joints. Send: a set-point and a
//! control word for each joint.

use crate::parameters::Parameters;
use robot_state::{MAX_FT_SENSORS, MAX_FURTHER_IMUS};

const AXES: usize = 6;
/// Six axes and a temperature.
const PER_FT: usize = AXES + 1;
const FTS: usize = AXES * (1 + MAX_FURTHER_IMUS);
const JOINTS: usize = FTS + PER_FT * MAX_FT_SENSORS;
const PER_JOINT: usize = 9;
/// Of these, the first that a drive reports of itself at a rate of its own.
const FIRST_TOLD: usize = 5;

/// The source of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// An IMU, by its index.
    Imu(usize),
    /// An F/T sensor, by its index.
    Ft(usize),
    /// A joint, by its index.
    Joint(usize),
}

/// The source of a receive slot's value.
#[must_use]
pub const fn source(slot: usize) -> Source {
    if slot < FTS {
        Source::Imu(slot / AXES)
    } else if slot < JOINTS {
        Source::Ft((slot - FTS) / PER_FT)
    } else {
        Source::Joint((slot - JOINTS) / PER_JOINT)
    }
}

/// The slot is of what a drive reports of itself besides its sample, which nothing waits for.
#[must_use]
pub const fn is_reported(slot: usize) -> bool {
    slot >= JOINTS && (slot - JOINTS) % PER_JOINT >= FIRST_TOLD
}

/// Axis x y z of an IMU's angular velocity, rad/s.
#[must_use]
pub const fn gyro(imu: usize, axis: usize) -> usize {
    AXES * imu + axis
}

/// Axis x y z of an IMU's acceleration minus gravity, m/s².
#[must_use]
pub const fn accelerometer(imu: usize, axis: usize) -> usize {
    gyro(imu, 3 + axis)
}

/// Axis of an F/T sensor before conditioning: force x y z in N, torque x y z in N·m; in the
/// signals' own units where the sensor has a calibration matrix.
#[must_use]
pub const fn ft(sensor: usize, axis: usize) -> usize {
    FTS + PER_FT * sensor + axis
}

/// T: temperature of an F/T sensor, °C; stays as it is where the sensor sends none.
#[must_use]
pub const fn ft_temperature(sensor: usize) -> usize {
    ft(sensor, AXES)
}

/// theta: motor-side angle modulo its wrap, rad.
#[must_use]
pub const fn motor_angle(joint: usize) -> usize {
    JOINTS + PER_JOINT * joint
}

/// q: link-side angle modulo its wrap, rad.
#[must_use]
pub const fn link_angle(joint: usize) -> usize {
    motor_angle(joint) + 1
}

/// i: motor current, A.
#[must_use]
pub const fn current(joint: usize) -> usize {
    motor_angle(joint) + 2
}

/// omega: motor-side velocity, rad/s; stays as it is where the drive sends none.
#[must_use]
pub const fn velocity(joint: usize) -> usize {
    motor_angle(joint) + 3
}

/// The drive's status word; stays as it is where the drive sends none.
#[must_use]
pub const fn status(joint: usize) -> usize {
    motor_angle(joint) + 4
}

/// Temperature of the drive, °C.
#[must_use]
pub const fn temperature(joint: usize) -> usize {
    motor_angle(joint) + FIRST_TOLD
}

/// Voltage of the drive's supply, V.
#[must_use]
pub const fn voltage(joint: usize) -> usize {
    temperature(joint) + 1
}

/// The drive's own torque, N·m at the joint.
#[must_use]
pub const fn drive_torque(joint: usize) -> usize {
    temperature(joint) + 2
}

/// Number of the drive's error; 0: none.
#[must_use]
pub const fn drive_error(joint: usize) -> usize {
    temperature(joint) + 3
}

/// Number of values that the receive table fills at most.
#[must_use]
pub fn receive_len(parameters: &Parameters) -> usize {
    motor_angle(parameters.joints.len())
}

/// The commanded position, rad, or current, A.
#[must_use]
pub const fn command(joint: usize) -> usize {
    2 * joint
}

/// The control word of a joint's drive.
#[must_use]
pub const fn control(joint: usize) -> usize {
    2 * joint + 1
}

/// Signals that a joint's drive is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sent {
    /// The set-point of a joint, by its index.
    Command(usize),
    /// The control word of a joint's drive, by its index.
    Control(usize),
}

/// The use of a send slot's value.
#[must_use]
pub const fn sent(slot: usize) -> Sent {
    match slot % 2 {
        0 => Sent::Command(slot / 2),
        _ => Sent::Control(slot / 2),
    }
}

/// Number of values that the send table takes.
#[must_use]
pub fn send_len(parameters: &Parameters) -> usize {
    command(parameters.joints.len())
}
