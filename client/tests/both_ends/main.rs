//! Daemon's end and client's end together.

mod common;
mod exchange;
mod layout_mismatch;
mod processes;
mod requests;
