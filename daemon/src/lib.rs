//! The daemon: the loop and everything about it that touches the world.

pub mod real_time;
