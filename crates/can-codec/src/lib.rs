//! CAN frames to signals and back.
//!
//! A DBC file describes the place of each signal in its frame. [`Dbc`] reads and validates it,
//! [`Table`] compiles the signals that are used to shifts, masks and one linear map each, and
//! [`Gather`] determines when every awaited message has arrived. A table both decodes and encodes,
//! so a simulated robot uses the same two tables as the daemon. Where no CAN bus carries a frame, a
//! datagram does: [`to_datagram`], [`from_datagram`].
#![deny(unsafe_code)]

mod datagram;
mod dbc;
mod frame;
mod gather;
mod packing;
mod table;

pub use datagram::{DATAGRAM_BYTES, from_datagram, to_datagram};
pub use dbc::{Dbc, Message, Signal};
pub use frame::{EXTENDED_ID, Frame, Frames, MAX_DATA, MAX_FRAMES};
pub use gather::Gather;
pub use packing::Coding;
pub use table::{BusDbc, DecodeError, Entry, SignalMap, Table, TableError, TableProblem};
