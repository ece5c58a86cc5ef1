//! Every joint's torque and every contact wrench from F/T sensors, IMU and joint motion (D 2),
//! without motor current.
//!
//! The F/T sensors cut the kinematic tree into parts. Motion propagates from the IMU to
//! every body; each part's inertial and gravity wrench, less the wrenches that the sensors at its
//! ends measure, is the sum of its contact wrenches: up to six unknowns a part, by least squares
//! where there are fewer. The remainder is the part's residual, reported with its expected standard
//! deviation. With the contact wrenches known, a backward pass over each part yields its joints'
//! torques.
//!
//! All signals of one update must have the same delay.
#![deny(unsafe_code)]

mod carried_imu;
mod conditioning;
mod contact_detector;
mod contact_force;
mod contacts;
mod covariance;
mod cross_check;
mod delay_compensation;
mod error;
mod estimator;
mod layout;
mod least_squares;
mod mechanics;
mod momentum;
mod parameters;
mod pieces;
mod placements;
mod sigma;
mod solution;
mod switching;
mod tare;

pub use carried_imu::CarriedImu;
pub use conditioning::FtConditioning;
pub use contact_detector::{
    ContactDetector, ContactDetectorParameters, ContactState, ContactThresholds, ExternalTorque,
};
pub use contact_force::ContactForce;
pub use cross_check::{Cause, CrossCheck, CrossCheckParameters, Sources};
pub use delay_compensation::{
    DelayCompensator, DelayCompensatorParameters, DelayedTorque, LEVEL_CREEP_SHARE,
};
pub use error::{ContactProblem, WholeBodyError};
pub use estimator::{ContactEstimate, PartEstimate, WholeBody, WholeBodyEstimate, WholeBodyInput};
pub use layout::part_of_link;
pub use momentum::{MomentumObserver, MomentumObserverParameters};
pub use parameters::{
    ContactKind, ContactParameters, FtSensorParameters, Hypothesis, ImuParameters, LastingErrors,
    MotionSource, Place, Residual, Weighting, WholeBodyParameters,
};
pub use switching::{ContactSwitch, ContactSwitchParameters, LoadRule};
pub use tare::{Tare, TareError, TareParameters, TareResult};
