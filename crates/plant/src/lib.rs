//! The simulated robot: the truth that every estimator is judged against.
//!
//! Pure and deterministic: time passes when a SYNC frame arrives ([`CanRobot`]) or when the caller
//! says so ([`SimRobot::advance`], [`JointRig::advance`]); all randomness comes from `sim.toml`'s
//! seed. No model code is shared with the estimators. `README.md` beside the sources lists every
//! effect, and which of them the estimators know.
//!
//! The joint torque told as truth, `tau`, is what gear and output bearing together apply to the
//! child link along +q, so that `M(q) a + h(q, v) - sum J^T f = S^T tau`.
#![deny(unsafe_code)]

pub mod articulated;
pub mod can_robot;
pub mod contact;
pub mod controller;
pub mod friction;
pub mod joint;
pub mod parameters;
pub mod random;
pub mod rig;
pub mod robot;
pub mod sampling;
pub mod sensors;
pub mod spatial;
pub mod start;
pub mod transmission;
pub mod tree;
pub mod truth;
pub mod urdf;

pub use can_robot::CanRobot;
pub use joint::{Command, DriveReading, DriveSheet, Joint};
pub use parameters::SimParameters;
pub use rig::{JointRig, RigLoad, RigSample, RigTiming};
pub use robot::{JointPlan, Plan, Readings, SimRobot};
pub use sampling::Sent;
pub use transmission::KinematicError;
pub use truth::{ExternalTruth, JointTruth, Truth};
