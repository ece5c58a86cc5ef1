//! The daemon: the loop and everything about it that touches the world.

pub mod bus;
pub mod real_time;
