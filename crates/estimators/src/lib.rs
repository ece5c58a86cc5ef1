//! Estimators of joint torque: pure, allocation-free after construction.
#![deny(unsafe_code)]

mod agreement;
pub mod compliance;
pub mod creep;
pub mod current_based;
pub mod deformation;
pub mod encoder;
mod exponential;
pub mod features;
pub mod feed_forward;
pub mod filter_bank;
mod fir;
pub mod front_end;
pub mod fusion;
pub mod hysteresis;
pub mod joint;
pub mod kalman;
pub mod kinematic_error;
pub mod local_gp;
pub mod low_pass;
pub mod matched_filter;
pub mod network;
mod output;
pub mod radius;
pub mod regimes;
pub mod role;
pub mod savitzky_golay;
pub mod set;
pub mod tracking;
pub mod uncertainty;
pub mod validity;
pub mod wave_generator;
