//! The simulated robot: the reference that every estimator is compared with.
//!
//! Pure and deterministic: time passes when a SYNC frame arrives ([`CanRobot`]) or at the
//! caller's request ([`SimRobot::advance`], [`JointRig::advance`]); all randomness comes from `sim.toml`'s
//! seed. No model code is shared with the estimators. `README.md` beside the sources lists every
//! effect, and which of them the estimators model.
//!
//! The true joint torque, `tau`, is what gear and output bearing together apply to the
//! child link along +q, so that `M(q) a + h(q, v) - sum J^T f = S^T tau`.
#![deny(unsafe_code)]

pub mod articulated;
pub mod can_robot;
pub mod clock;
pub mod contact;
pub mod controller;
pub mod drive;
pub mod drive_faults;
pub mod drive_states;
pub mod friction;
pub mod joint;
pub mod kinematic_error;
mod nodes;
pub mod parameters;
pub mod past;
pub mod plan;
pub mod random;
pub mod readings;
pub mod rig;
pub mod robot;
pub mod sensors;
pub mod spatial;
pub mod surroundings;
pub mod transmission;
pub mod transport;
pub mod tree;
pub mod truth;
pub mod urdf;

pub use can_robot::CanRobot;
pub use drive::{Command, DriveReading, DriveSheet};
pub use drive_faults::{DriveFaults, EncoderFault, SetPointFault};
pub use drive_states::{DriveError, DriveStates};
pub use joint::Joint;
pub use kinematic_error::KinematicError;
pub use parameters::SimParameters;
pub use plan::{JointPlan, Plan};
pub use readings::{Readings, Sent};
pub use rig::{JointRig, RigLoad, RigSample, RigTiming};
pub use robot::SimRobot;
pub use truth::{ExternalTruth, JointTruth, Truth};
