//! What the simulated robot must do, in one binary: linking is what takes long.

mod can;
mod common;
mod joint;
mod parameters;
mod rigid_body;
mod stand;
mod truth;
