//! Tests of the simulated robot, in one binary: linking takes most of the time.

mod can;
mod common;
mod documented_keys;
mod joint;
mod parameters;
mod rigid_body;
mod stand;
mod truth;
