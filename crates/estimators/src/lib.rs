//! Estimators of joint torque: pure, allocation-free after construction.
#![deny(unsafe_code)]

pub mod compliance;
pub mod encoder;
pub mod joint;
pub mod kinematic_error;
pub mod low_pass;
pub mod savitzky_golay;
pub mod wave_generator;
pub mod whole_body;
