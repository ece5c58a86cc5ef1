//! The 1 kHz computation: frames in, frames and a record out.
//!
//! [`Cycle::step`] runs three groups of stages, a folder each: `measure`, `estimate`, `command`.
//! The same function runs in the daemon, in tests and in replay: `now` is an argument, nothing
//! allocates after construction, and the same frames give the same bytes.
#![deny(unsafe_code)]

mod command;
mod cycle;
mod estimate;
mod events;
mod measure;
mod time;

pub use command::ClientInput;
pub use cycle::Cycle;
pub use supervisor::OperatorRequest;
pub use time::{Instants, Stamp};
