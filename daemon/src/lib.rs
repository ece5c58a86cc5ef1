//! The daemon: the loop and everything about it that touches the world.

pub mod actuator_watch;
pub mod bring_up;
pub mod bus;
pub mod bus_lock;
pub mod changed_files;
pub mod control_loop;
pub mod cycle_times;
pub mod demo;
pub mod drive_watch;
pub mod ending;
pub mod failure;
pub mod log;
pub mod loop_monitor;
pub mod looper;
pub mod margins;
pub mod offsets;
pub mod real_time;
pub mod recorder;
pub mod report;
pub mod request_server;
pub mod run;
pub mod service_manager;
pub mod shared_memory;
pub mod simulation;
pub mod stored_fault;
pub mod summary;
