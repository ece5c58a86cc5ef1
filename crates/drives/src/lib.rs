//! Drives that exist: what each family says and hears, without a clock or a bus of its own.
//!
//! Bytes and time come in, bytes go out. [`canopen`] is what every CANopen device shares, [`cia402`]
//! the drives among them, [`family`] the actuators with frames of their makers' own, [`scan`] finds out who is on a bus.
#![deny(unsafe_code)]

pub mod canopen;
pub mod cia402;
pub mod family;
pub mod scan;
