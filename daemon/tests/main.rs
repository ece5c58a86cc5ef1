//! All tests of `daemon` in one program, which is built and linked once.

mod black_box;
mod common;
mod looper;
mod nodes;
mod offsets;
mod operator;
mod other_users;
mod recorder;
mod replay;
mod request_server;
mod service;
mod shared_memory;
mod simulate;
mod simulator;
mod tare;
