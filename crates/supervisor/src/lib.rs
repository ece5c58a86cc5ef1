//! Whether and how far a robot may move: states of robot and drives, the lease of the command,
//! plausibility of joints, limits of commands.
//!
//! Nothing here commands a motion; everything here can withhold one. No reaction depends on the
//! sensor that failed: a hold keeps the last set-point, whatever the encoders say.
#![deny(unsafe_code)]

mod commanders;
mod drive;
mod following;
mod hold_watch;
mod in_a_row;
mod lease;
mod limiter;
mod plausibility;
mod robot;
mod runaway_watch;
mod signal;
mod swing_watch;

pub use commanders::Commanders;
pub use drive::{
    ControlWords, Drive, DriveGoal, DriveProfile, DriveTrouble, StatusBits, StatusPattern,
};
pub use following::{Deviation, Following, FollowingParameters, Shown};
pub use hold_watch::{Held, HoldWatch, HoldWatchParameters};
pub use in_a_row::{count_in_a_row, time_in_a_row};
pub use lease::{Holder, Lease, Verdict};
pub use limiter::{Braking, Limited, Limiter, Limits, Motion};
pub use plausibility::{MotorSample, Plausibility, PlausibilityParameters, Sample, Trust};
pub use robot::{JointCondition, OperatorRequest, Refusal, RobotMachine, Safety};
pub use runaway_watch::{RunawayParameters, RunawayWatch};
pub use signal::{Liveness, SignalMonitor, SignalParameters};
pub use swing_watch::{SwingTorque, SwingWatch, SwingWatchParameters};
