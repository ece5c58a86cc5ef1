//! Drives that exist: what each family says and hears, without a clock or a bus of its own.
//!
//! Bytes and time come in, bytes go out. [`canopen`] is what every CANopen device shares, [`cia402`]
//! the drives among them.
#![deny(unsafe_code)]

pub mod canopen;
pub mod cia402;
