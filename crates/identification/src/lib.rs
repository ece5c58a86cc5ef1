//! Offline fits of what the estimators need, from recorded logs.
//!
//! Pure like every crate here: texts and rows come in, parameters go out; files are the caller's.
#![deny(unsafe_code)]

pub mod all;
pub mod blocks;
pub mod current;
pub mod deformation;
pub mod drive;
pub mod evaluate;
pub mod excitation;
pub mod feed_forward;
pub mod fusion;
pub mod gaussian_process;
pub mod gear;
pub mod inertia;
pub mod inputs;
pub mod joined;
pub mod kinematic;
pub mod learned;
pub mod least_squares;
pub mod load;
pub mod log;
pub mod motor;
pub mod network;
pub mod noise;
pub mod quasi_newton;
pub mod record;
pub mod torsion_gain;
