//! Daemon's end and client's end together.

mod common;
mod exchange;
mod keep;
mod layout_mismatch;
mod processes;
mod requests;
