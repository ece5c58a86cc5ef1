//! Estimators of joint torque: pure, allocation-free after construction.
#![deny(unsafe_code)]

pub mod compliance;
pub mod joint;
pub mod kinematic_error;
pub mod wave_generator;
