//! Frames that mode Cartesian moves: what a client asks of each, and what the loop makes of it.

use crate::layout::record;

/// Frames that a robot's configuration can name for mode Cartesian.
pub const MAX_FRAMES: usize = 4;

/// Flag bits of a frame in mode Cartesian.
pub mod frame_flags {
    /// Position, orientation and the other values are those of this cycle.
    pub const VALID: u32 = 1;
    /// The frame is led by its wrench.
    pub const ACTIVE: u32 = 2;
    /// The wrench was limited to the configured force or torque.
    pub const WRENCH_LIMITED: u32 = 4;
    /// Stiffness or damping were lowered to what the joints may have in this pose.
    pub const GAINS_LIMITED: u32 = 8;
    /// `force_estimated` is that of an F/T sensor or of the external torques; without this bit it is
    /// not known, and nothing is fed back.
    pub const FORCE_KNOWN: u32 = 16;
    /// The desired pose has not been reached by the one that is followed yet: it is led there by the
    /// configured rate of the force.
    pub const LED: u32 = 32;
}

record! {
    /// Reference of one frame (mode Cartesian). Vectors are in the axes of the frame's base, at the
    /// frame's origin, x y z.
    pub struct FrameReference {
        /// x_d: desired position of the frame's origin in its base, m.
        pub position: [f64; 3],
        /// R_d: desired orientation of the frame in its base, a unit quaternion w x y z.
        pub orientation: [f64; 4],
        /// v_d: desired velocity, linear m/s and angular rad/s.
        pub velocity: [f64; 6],
        /// K: stiffness along and about each axis, N/m and N·m/rad.
        pub stiffness: [f64; 6],
        /// f_d: desired force and torque that the environment applies to the frame, N and N·m: a robot
        /// that presses down on a table gets an upward force.
        pub force: [f64; 6],
        /// zeta: damping ratio of the springs with the limb's inertia, 0.3 to 2.
        pub damping_ratio: f64,
        /// 1: the frame is led; 0: it is not. Together with mode hold: its pose is shown.
        pub used: u32,
        /// 1: stiffness, velocity and force are along the axes of the desired orientation; 0: along
        /// those of the base.
        pub own_axes: u32,
        /// Axes on which K_f feeds the force back, a bit for each: x y z of force, x y z of torque;
        /// their stiffness must be 0.
        pub force_axes: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
    }
}

record! {
    /// One frame in mode Cartesian, in the axes of its base, at its own origin.
    pub struct FrameCommanded {
        /// x: position of the frame's origin in its base, m.
        pub position: [f64; 3],
        /// R: orientation of the frame in its base, a unit quaternion w x y z.
        pub orientation: [f64; 4],
        /// Wrench that the frame applies to its surroundings by springs, dampers and desired force, N
        /// and N·m.
        pub wrench: [f64; 6],
        /// f_hat: wrench that the environment applies to the frame, N and N·m.
        pub force_estimated: [f64; 6],
        /// Bits of `frame_flags`.
        pub flags: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
    }
}
