//! Judge of the fused torque: on a real arm's logs and on a family of structurally different joints.
//!
//! In: the tool's own fits and estimators. Out: errors and the ratio of error to sigma, for every joint,
//! training and scenario. The family shares no code with the estimators nor with the project's plant.

pub mod arm;
pub mod course;
pub mod drives;
pub mod family;
pub mod fit;
pub mod laws;
pub mod page;
pub mod random;
pub mod real;
pub mod results;
pub mod score;
pub mod simulate;
pub mod specimen;
