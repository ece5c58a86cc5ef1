//! The same frames without a kernel: between two threads, or with a peer that is called.

mod lock_step;
mod threads;

pub use lock_step::{Listener, LockStep, Peer, SimulatedDeadline, VirtualClock, VirtualDeadline};
pub use threads::{InProcess, pair};
