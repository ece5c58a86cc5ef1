//! One simulated joint on its bench, the runs that calibrate it, and the scenarios of the papers;
//! beside them a real joint.
//!
//! The bench is the plant's ([`plant::JointRig`]): it shares no model with the estimators, and its
//! hysteresis, position-dependent friction, further kinematic harmonics, gain errors and skew are
//! always on.

pub mod joint;
pub mod judge;
pub mod lara8;
pub mod page;
pub mod plot;
pub mod run;
pub mod scenario;
