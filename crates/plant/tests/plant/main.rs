//! What the simulated robot must do, in one binary: linking is what takes long.
#![allow(
    clippy::disallowed_methods,
    reason = "tests read the robots' files themselves"
)]

mod can;
mod common;
mod joint;
mod parameters;
mod rigid_body;
mod stand;
mod truth;
