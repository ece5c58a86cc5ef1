//! Commanded values: written by the stage `command` from estimated and measured ones.

use super::{FrameCommanded, MAX_FRAMES, MAX_JOINTS};
use crate::layout::record;

/// Flag bits of a joint's command: which limits acted, and whether it is sent.
pub mod command_flags {
    /// Position limit, or the braking distance before it.
    pub const POSITION_LIMITED: u32 = 1;
    /// Torque limit.
    pub const TORQUE_LIMITED: u32 = 2;
    /// Lead of the command over the measured position.
    pub const LEAD_LIMITED: u32 = 4;
    /// Velocity limit.
    pub const VELOCITY_LIMITED: u32 = 8;
    /// Limit of the torque's rate of change.
    pub const TORQUE_RATE_LIMITED: u32 = 16;
    /// Limit of the mechanical power.
    pub const POWER_LIMITED: u32 = 32;
    /// The command was NaN or infinite; the last one stands.
    pub const NOT_FINITE: u32 = 64;
    /// The command is sent; without this bit the joint's drive gets none.
    pub const ENGAGED: u32 = 128;
    /// The limit of the torque's rate took no more than noise of the command: no event.
    pub const RATE_TRIMMED: u32 = 256;
}

record! {
    /// Command of one joint and its contributions.
    pub struct JointCommanded {
        /// tau_d: desired torque, N·m (D12).
        pub tau_d: f64,
        /// tau*: desired torque plus feedback on the estimated torque, N·m (D11).
        pub tau_star: f64,
        /// delta_q: commanded offset to the measured position, rad (D10).
        pub delta_q: f64,
        /// The command before all limits, rad or A; `flags` names the limits that changed it.
        pub asked: f64,
        /// q_c: commanded position after all limits, rad (position-commanded drives).
        pub q_c: f64,
        /// i_c: commanded current after all limits, A (current-commanded drives).
        pub current_c: f64,
        /// Contribution to the command of the torque feed-forward, rad or A (D 5.5).
        pub feedforward_torque: f64,
        /// Contribution to the command of the friction feed-forward, rad or A.
        pub feedforward_friction: f64,
        /// Contribution to the command of the position error, rad or A.
        pub feedback_position: f64,
        /// Contribution to the command of the velocity error, rad or A.
        pub feedback_velocity: f64,
        /// Contribution to the command of the acceleration error, rad or A.
        pub feedback_acceleration: f64,
        /// Contribution to the command of the contact force error, rad or A.
        pub feedback_force: f64,
        /// Distance of the set-point that torque, velocity and position of the drive show from those
        /// sent last, rad or A; zero while no set-points are sent.
        pub following_error: f64,
        /// Delay from the sample that a command is computed from to its effect in the motor's current,
        /// s, as measured while a client is followed; 0 until it is known.
        pub command_delay_s: f64,
        /// Standard deviation of `command_delay_s`, s.
        pub command_delay_sigma_s: f64,
        /// Torque that the command may ask for at present, N·m: the joint's limit, less while its drive is
        /// hot; zero while no set-points are sent.
        pub torque_limit: f64,
        /// Bits of `command_flags`.
        pub flags: u32,
        /// Number of the drive's `DriveState`; a drive without states counts as enabled.
        pub drive_state: u32,
    }
}

record! {
    /// Commanded values of one cycle.
    pub struct CommandedRecord {
        /// The joints, in config order.
        pub joints: [JointCommanded; MAX_JOINTS],
        /// The frames of mode Cartesian, in config order; all zeros while a client uses none.
        pub frames: [FrameCommanded; MAX_FRAMES],
        /// Mode stand: bit s is 1 where the robot stands on the foot of F/T sensor s; 0 in other modes.
        pub stands_on: u64,
    }
}
