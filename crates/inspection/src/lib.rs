//! Inspection of recorded channels before anything is computed from them.
//!
//! Stamps and one channel's values come in; what goes out is the channel with every defect mended
//! that has one mending, the rows that hold no measurement, and [`Finding`]s: what was found,
//! where, how grave it is, and what cures it.
//!
//! Every rule compares a channel with itself: steps with the channel's ordinary steps, a sample
//! with its neighbours. Nothing is assumed about the machine that was recorded.
#![deny(unsafe_code)]

mod channel;
mod finding;
mod frozen;
mod sources;
mod spikes;
mod statistics;
mod wraps;

pub use channel::{Channel, Inspected, Quantity, inspect};
pub use finding::{Defect, Finding, Severity};
pub use frozen::{frozen, held};
pub use sources::{held_rows, marks, sources};
pub use spikes::spikes;
pub use wraps::{Unwrapped, range_of_wraps, unwrap};
