//! The daemon: the loop and everything about it that touches the world.

pub mod bus;
pub mod control_loop;
pub mod demo;
pub mod failure;
pub mod offsets;
pub mod real_time;
pub mod request_server;
pub mod run;
pub mod shared_memory;
pub mod summary;
