//! Every joint's torque and every contact's wrench from F/T sensors, IMU and joint motion (D 2): no
//! motor is asked.
//!
//! The F/T sensors cut the kinematic tree into parts. What the IMU measured moves to every body; each
//! part's inertial and gravity wrench, less what the sensors at its ends measure, must be the work
//! of its contacts: up to six unknowns a part, by least squares where there are fewer. What the
//! contacts cannot explain is told as the part's residual, beside the size that sensors and model
//! let expect. With the contacts known, a backward pass over each part yields its joints' torques.
//!
//! Signals that enter together must be late by the same time.
#![deny(unsafe_code)]

mod conditioning;
mod contacts;
mod cross_check;
mod delay_compensation;
mod error;
mod estimator;
mod layout;
mod least_squares;
mod mechanics;
mod momentum;
mod parameters;
mod sigma;
mod solution;
mod switching;
mod tare;

pub use conditioning::FtConditioning;
pub use cross_check::{Cause, CrossCheck, CrossCheckParameters, Sources};
pub use delay_compensation::{DelayCompensator, DelayCompensatorParameters, DelayedTorque};
pub use error::{ContactProblem, WholeBodyError};
pub use estimator::{ContactEstimate, PartEstimate, WholeBody, WholeBodyEstimate, WholeBodyInput};
pub use layout::part_of_link;
pub use momentum::{MomentumObserver, MomentumObserverParameters};
pub use parameters::{
    ContactKind, ContactParameters, FtSensorParameters, Hypothesis, ImuParameters, MotionSource,
    Place, Residual, Weighting, WholeBodyParameters,
};
pub use switching::{ContactSwitch, ContactSwitchParameters, LoadRule};
pub use tare::{Tare, TareError, TareParameters, TareResult};
