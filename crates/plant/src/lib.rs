//! The simulated robot: the truth that every estimator is judged against.
#![deny(unsafe_code)]

pub mod can_robot;
pub mod contact;
pub mod controller;
pub mod friction;
pub mod joint;
pub mod parameters;
pub mod random;
pub mod rig;
pub mod robot;
pub mod sensors;
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
pub use transmission::KinematicError;
pub use truth::{ExternalTruth, JointTruth, Truth};
