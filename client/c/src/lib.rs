//! `libtorqued`: the client for C and, through `torqued.hpp`, for C++.
//!
//! Functions return a [`Code`]; its words are kept per thread ([`torqued_message`]). No panic leaves a
//! function: it becomes [`Code::Panicked`]. A record is read in place, in shared memory.

mod client;
mod code;
mod commander;
mod follow;
mod words;

pub use client::*;
pub use code::*;
pub use commander::*;
pub use follow::*;
pub use words::*;
