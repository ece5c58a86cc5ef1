//! Control of joint torque: drives, torque loop, inverse dynamics (D 3, D 4).
//!
//! In: measured and estimated values, references. Out: commands of position- or current-commanded
//! drives. Everything is a pure function or a small state that the cycle owns; nothing allocates
//! after construction.
#![deny(unsafe_code)]

mod balance;
mod carried;
mod cartesian;
mod drive;
mod gains;
mod inverse_dynamics;
pub mod margins;
mod point_to_point;
pub mod predictive;
mod six;
mod sole;
mod stepping;
mod support;
mod torque_loop;
mod trajectory;
mod velocity_stream;

pub use balance::{Balance, BalanceInput, Balanced, MAX_FEET};
pub use carried::{CarriedTorque, largest_follow};
pub use cartesian::{
    CartesianLaw, CartesianLimits, CartesianTarget, CartesianWrench, DAMPING_RATIOS, Limb,
    pose_error, unit_quaternion,
};
pub use drive::{CurrentDrive, DriveModel, PositionDrive, smooth_sign};
pub use gains::{EquivalentGains, JointGains};
pub use inverse_dynamics::InverseDynamics;
pub use point_to_point::{MotionLimits, PlannedMotion, PointToPoint};
pub use sole::Sole;
pub use stepping::Stepping;
pub use support::{Imbalance, Support};
pub use torque_loop::TorqueLoop;
pub use trajectory::{BufferedTrajectory, TrajectoryLimits, interpolate};
pub use velocity_stream::{VelocityPlanner, VelocityStream};
