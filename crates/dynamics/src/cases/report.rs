//! What is answered.
#![allow(non_snake_case)]

use serde::Serialize;
use std::collections::BTreeMap;

/// A matrix, by rows.
pub type Rows = Vec<Vec<f64>>;

/// Answer.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Joints, in the order of all vectors below, after the base's six components.
    pub joints: Vec<String>,
    /// What the reader found odd in the model, each with file and line.
    #[serde(skip)]
    pub warnings: Vec<String>,
    /// Moving bodies in the order of the regressor's columns, if more was asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<String>,
    /// One per case asked for.
    pub cases: Vec<CaseReport>,
}

/// Answer to one case; the base's six components come first.
#[derive(Clone, Debug, Serialize)]
pub struct CaseReport {
    /// Inverse dynamics.
    pub tau: Vec<f64>,
    /// Mass matrix.
    pub M: Rows,
    /// Coriolis, centrifugal and gravity.
    pub nle: Vec<f64>,
    /// Gravity.
    pub g: Vec<f64>,
    /// Forward dynamics of `tau`: the accelerations again.
    pub ddq_of_tau: Vec<f64>,
    /// Centre of mass in the world.
    pub com: [f64; 3],
    /// If asked for.
    #[serde(flatten)]
    pub more: Option<More>,
    /// Frames asked for.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub frames: BTreeMap<String, FrameReport>,
}

/// What there is to compare beside forward and inverse dynamics.
#[derive(Clone, Debug, Serialize)]
pub struct More {
    /// `M^-1 (tau - bias)`, by the factors of `M`; the bias is inverse dynamics at `ddq = 0`.
    pub ddq_of_M: Vec<f64>,
    /// Jacobian of the centre of mass, in the world (3 × nv).
    pub J_com: Rows,
    /// Momentum about the centre of mass, in the world's axes, linear first.
    pub h: [f64; 6],
    /// The map from velocities to `h` (6 × nv).
    pub A: Rows,
    /// Kinetic energy, J.
    pub kinetic_energy: f64,
    /// Potential energy, J; zero at the world's origin.
    pub potential_energy: f64,
    /// Joint-torque regressor (nv × 10 bodies): `m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz` of each.
    pub regressor: Rows,
}

/// A frame in one state.
#[derive(Clone, Debug, Serialize)]
pub struct FrameReport {
    /// Position in the world.
    pub p: [f64; 3],
    /// Rotation matrix.
    pub R: Rows,
    /// In the frame's own axes, at its origin.
    pub local: FrameMotion,
    /// In the world's axes, at the world's origin.
    pub world: FrameMotion,
    /// In the world's axes, at the frame's origin.
    pub aligned: FrameMotion,
}

/// Motion of a frame, linear first.
#[derive(Clone, Debug, Serialize)]
pub struct FrameMotion {
    /// Twist.
    pub v: [f64; 6],
    /// Spatial acceleration.
    pub a: [f64; 6],
    /// Classical acceleration.
    pub a_classical: [f64; 6],
    /// Jacobian (6 × nv).
    pub J: Rows,
    /// `dJ/dt v`.
    pub dJ_v: [f64; 6],
}
