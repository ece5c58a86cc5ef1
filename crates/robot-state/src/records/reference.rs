//! References: what a commanding client sends each cycle.

use core::ffi::CStr;

use super::{FrameReference, MAX_FRAMES, MAX_FT_SENSORS, MAX_JOINTS, Wrench};
use crate::layout::record;

/// Most points of a piece of a trajectory.
pub const MAX_POINTS: usize = 32;

/// Declares the modes: of each its meaning, name, number, the name in snake case, and whether it follows trajectories
/// that clients send ahead.
macro_rules! modes {
    ($($(#[$meaning:meta])* $mode:ident = $number:literal, $name:literal, $ahead:literal;)*) => {
        /// A mode of the robot. Records carry its number.
        #[repr(u32)]
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        pub enum Mode {
            $($(#[$meaning])* $mode = $number,)*
        }

        impl Mode {
            /// Every mode, in the order of their numbers.
            pub const ALL: [Self; [$($number),*].len()] = [$(Self::$mode),*];

            /// The mode's name in snake case.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$mode => $name,)*
                }
            }

            /// The mode's name in snake case, as C has it.
            #[must_use]
            pub const fn c_name(self) -> &'static CStr {
                let with_end = match self {
                    $(Self::$mode => concat!($name, "\0"),)*
                };
                match CStr::from_bytes_with_nul(with_end.as_bytes()) {
                    Ok(name) => name,
                    Err(_) => c"",
                }
            }

            /// It follows trajectories that clients send ahead.
            #[must_use]
            pub const fn follows_trajectories(self) -> bool {
                match self {
                    $(Self::$mode => $ahead,)*
                }
            }
        }
    };
}

modes! {
    /// Hold the present position.
    #[default]
    Hold = 0, "hold", false;
    /// Follow `tau_d` of the client.
    Torque = 1, "torque", false;
    /// Follow `q_d dq_d ddq_d` and contact wrenches of the client by inverse dynamics.
    InverseDynamics = 2, "inverse_dynamics", true;
    /// Go to `q_d` on a trajectory that the loop plans, by inverse dynamics: all joints arrive at
    /// once and stay there.
    Position = 3, "position", false;
    /// Lead frames by springs, dampers and desired forces, and the joints besides by inverse dynamics:
    /// joints that move a frame keep their posture with the configured share of their stiffness.
    Cartesian = 4, "cartesian", false;
    /// Give way to any hand: the joints carry gravity and inertial forces of the model and nothing else,
    /// but those of `held_joints`, which follow `q_d dq_d` as in mode inverse dynamics.
    Passive = 5, "passive", false;
    /// Follow `q_d dq_d` of the client without a model of the links: the torque that a joint carries,
    /// as estimated, is fed back to its motor.
    TorqueFeedbackMotion = 6, "torque_feedback_motion", true;
    /// Follow `q_d dq_d ddq_d` by a low stiffness and a learned feed-forward beside inverse dynamics.
    LowGainTracking = 7, "low_gain_tracking", true;
    /// Follow `dq_d` of the client, within limits of acceleration and jerk, by inverse dynamics; joints come to rest before
    /// their position limits.
    Velocity = 8, "velocity", false;
    /// Stand on the feet that bear the robot: the centre of mass stays over them, the base upright, and the joints
    /// besides follow `q_d dq_d ddq_d` of the client by inverse dynamics.
    Stand = 9, "stand", false;
}

impl Mode {
    /// The mode's number in records.
    #[must_use]
    pub const fn number(self) -> u32 {
        self as u32
    }

    /// The mode with that number.
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.number() == number)
    }
}

record! {
    /// Reference of one joint.
    pub struct JointReference {
        /// q_d: desired joint angle, rad, or the target (mode position).
        pub q_d: f64,
        /// dq_d: desired velocity, rad/s, or the greatest speed on the way to the target, 0 for the
        /// configured one (mode position).
        pub dq_d: f64,
        /// ddq_d: desired acceleration, rad/s² (modes inverse dynamics, Cartesian and low-gain tracking).
        pub ddq_d: f64,
        /// tau_d: desired torque, N·m (mode torque).
        pub tau_d: f64,
        /// K_s: stiffness, N·m/rad, at most the configured one; counts where `gains_given` is 1 (not
        /// in mode torque).
        pub stiffness: f64,
        /// K_d: damping, N·m·s/rad, at most the configured one, and no smaller a share of it than
        /// `stiffness` is of the configured stiffness; counts as `stiffness` does.
        pub damping: f64,
    }
}

record! {
    /// Reference of the robot.
    pub struct Reference {
        /// Session of the commander: a random number other than 0, a new one whenever it asks for
        /// the lease.
        pub session: u64,
        /// Instant at which the session began, ns on the machine's `CLOCK_MONOTONIC`. A session
        /// older than one that has had the lease never gets it.
        pub session_began_ns: u64,
        /// Count of the session's references, this one included: it must advance.
        pub sequence: u64,
        /// Instant of sending, ns on the machine's `CLOCK_MONOTONIC`: the reference's age counts
        /// from it.
        pub sent_ns: u64,
        /// Trajectory whose points give `q_d dq_d ddq_d` of every cycle, or 0: those of this reference
        /// (modes inverse dynamics, torque-feedback motion and low-gain tracking). It counts from the trajectory's first piece on.
        pub trajectory: u64,
        /// Mode passive: bit k is 1 where joint k is held at `q_d`, with its `stiffness` and `damping` or the
        /// configured ones; the other joints are let go.
        pub held_joints: u64,
        /// Number of a `Mode`: 0 hold, 1 torque, 2 inverse dynamics, 3 position, 4
        /// Cartesian, 5 passive, 6 torque-feedback motion, 7 low-gain tracking, 8 velocity, 9 stand.
        pub mode: u32,
        /// Joints in use; must equal the robot's.
        pub joint_count: u32,
        /// Priority of the session, that of its first reference: it takes the lease over from a
        /// session of lower priority.
        pub priority: u32,
        /// Process of the commander, to be named to others.
        pub pid: u32,
        /// 1: the last reference of its session, which gives the lease back; the robot holds.
        pub gives_back: u32,
        /// 1: `contact_wrench` is followed; 0: what the ground carries in the desired motion is.
        pub contact_wrench_given: u32,
        /// 1: the joints' `stiffness` and `damping` hold; 0: those of the configuration for the mode.
        pub gains_given: u32,
        /// Mode stand: bit s is 1 where the client lifts the foot of F/T sensor s. The robot stands on the others alone
        /// before it is free (`stands_on` of the record), then its joints follow `q_d` from where they are.
        pub lifted_feet: u32,
        /// The joints, in config order.
        pub joints: [JointReference; MAX_JOINTS],
        /// f_d: desired wrench of the environment on each end-effector, at the frame of its F/T
        /// sensor, in config order (mode inverse dynamics).
        pub contact_wrench: [Wrench; MAX_FT_SENSORS],
        /// The frames, in config order (mode Cartesian).
        pub frames: [FrameReference; MAX_FRAMES],
        /// Mode stand: horizontal offset of the centre of mass from the middle of the soles that bear the robot, forward
        /// and to the left as the base stood when the mode began, m.
        pub center_of_mass_offset: [f64; 2],
    }
}

record! {
    /// One joint at one point of a trajectory.
    pub struct JointPoint {
        /// q_d, rad.
        pub q_d: f64,
        /// dq_d, rad/s.
        pub dq_d: f64,
        /// ddq_d, rad/s².
        pub ddq_d: f64,
    }
}

record! {
    /// All joints at one point of a trajectory.
    pub struct TrajectoryPoint {
        /// The joints, in config order.
        pub joints: [JointPoint; MAX_JOINTS],
    }
}

record! {
    /// A piece of a trajectory, sent ahead. The loop interpolates between its points in every cycle,
    /// exact at the points and continuous up to the acceleration. It replaces what was buffered
    /// after its first point, and must agree with it there.
    pub struct TrajectoryPiece {
        /// Session of the commander.
        pub session: u64,
        /// Number of the trajectory, of the client's choice, other than 0; references name it.
        pub trajectory: u64,
        /// Count of the session's pieces, this one included: it must advance.
        pub sequence: u64,
        /// Time of the first point since the trajectory's begin, ns. The trajectory begins in the
        /// cycle that first follows it; its first piece has 0 here.
        pub begins_ns: u64,
        /// Time between two points, ns.
        pub spacing_ns: u64,
        /// Joints in use; must equal the robot's.
        pub joint_count: u32,
        /// Points in use, at least 2.
        pub point_count: u32,
        /// The points.
        pub points: [TrajectoryPoint; MAX_POINTS],
    }
}
