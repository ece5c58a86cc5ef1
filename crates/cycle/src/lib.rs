//! The 1 kHz computation: frames in, frames and a record out.
//!
//! [`Cycle::step`] runs the stages one after the other, a file or folder each: `measure`, `estimate`, `judge`, `decide`,
//! `mode`, `joint` (laws and limits), `emit`. The same function runs in the daemon, in tests and in replay: `now` is an
//! argument, nothing allocates after construction, and the same frames give the same bytes.
#![deny(unsafe_code)]

mod cycle;
mod decide;
mod emit;
mod estimate;
mod events;
mod inputs;
mod joint;
mod judge;
mod measure;
mod mode;
mod time;

pub use cycle::{Cycle, STAGES};
pub use inputs::ClientInput;
pub use supervisor::OperatorRequest;
pub use time::{Instants, Stamp};
