//! Rigid-body dynamics of a robot read from URDF: exact, deterministic, without allocation after
//! construction.
//!
//! An immutable [`Model`], a preallocated [`Data`], and free functions `algorithm(&model, &mut
//! data, ...)`, one file each. Conventions are Pinocchio's: `q = [p (3), quaternion xyzw (4),
//! joints]`, `v = [linear, angular in base axes, joints]`, six-vectors linear first, bodies' twists
//! in their own frames; see [`Model`] for the differences.
//!
//! Vectors that are too short are read as if zeros followed (and are an error in debug builds):
//! nothing in the loop panics.
#![deny(unsafe_code)]

mod aba;
mod body;
mod centroidal;
mod cholesky;
mod configuration;
mod crba;
mod data;
mod energy;
mod frames;
mod in_order;
mod jacobian;
mod kinematics;
mod lane_schedule;
mod model;
mod regressor;
mod rnea;
mod rows;
mod spatial;
mod urdf;

pub use aba::aba;
pub use body::{Body, JointKind};
pub use centroidal::{
    center_of_mass, center_of_mass_jacobian, centroidal_map, centroidal_momentum,
};
pub use cholesky::{cholesky_decompose, cholesky_solve};
pub use configuration::{Random, integrate, neutral};
pub use crba::crba;
pub use data::Data;
pub use energy::{kinetic_energy, potential_energy};
pub use frames::{
    ReferenceFrame, frame_acceleration, frame_classical_acceleration, frame_placement,
    frame_velocity,
};
pub use jacobian::{frame_jacobian, frame_jacobian_rate_times_velocity};
pub use kinematics::{
    ImuMotion, forward_kinematics, forward_kinematics_acceleration, forward_kinematics_velocity,
};
pub use model::{Base, Frame, GRAVITY, Joint, JointLimits, Model};
pub use regressor::{PARAMETERS, joint_torque_regressor};
pub use rnea::{gravity, nle, rnea};
pub use simd::Instructions;
pub use spatial::{Force, Inertia, Motion, Se3};
pub use urdf::{UrdfOptions, urdf_with_inertias};
