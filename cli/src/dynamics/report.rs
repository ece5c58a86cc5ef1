//! The report that is printed.
#![allow(non_snake_case)]

use problem::Problem;
use serde::Serialize;
use std::collections::BTreeMap;

/// A matrix, by rows.
pub(super) type Rows = Vec<Vec<f64>>;

/// Results of all cases.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Report {
    /// Joints, in the order of all vectors below, after the base's six components.
    pub(super) joints: Vec<String>,
    /// Odd but usable parts of the URDF, each with file and line.
    #[serde(skip)]
    pub(super) warnings: Vec<Problem>,
    /// Moving bodies in the order of the regressor's columns, if `more` was requested.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) bodies: Vec<String>,
    /// One per requested case.
    pub(super) cases: Vec<CaseReport>,
}

/// Results of one case; the base's six components come first.
#[derive(Clone, Debug, Serialize)]
pub(super) struct CaseReport {
    /// Inverse dynamics.
    pub(super) tau: Vec<f64>,
    /// Mass matrix.
    pub(super) M: Rows,
    /// Coriolis, centrifugal and gravity.
    pub(super) nle: Vec<f64>,
    /// Gravity.
    pub(super) g: Vec<f64>,
    /// Forward dynamics of `tau`: the accelerations again.
    pub(super) ddq_of_tau: Vec<f64>,
    /// Centre of mass in the world.
    pub(super) com: [f64; 3],
    /// If requested.
    #[serde(flatten)]
    pub(super) more: Option<More>,
    /// Requested frames.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(super) frames: BTreeMap<String, FrameReport>,
}

impl CaseReport {
    /// False where a number overflowed. Accelerations may be infinite: of a joint that moves no mass.
    pub(super) fn is_finite(&self) -> bool {
        let vectors = [&self.tau, &self.nle, &self.g].into_iter().flatten();
        let mut numbers = vectors.chain(self.M.iter().flatten()).chain(&self.com);
        numbers.all(|x| x.is_finite())
            && self.more.iter().all(More::is_finite)
            && self.frames.values().all(FrameReport::is_finite)
    }
}

impl More {
    fn is_finite(&self) -> bool {
        let matrices = [&self.J_com, &self.A, &self.regressor].into_iter();
        let energies = [self.kinetic_energy, self.potential_energy];
        let mut numbers = matrices.flatten().flatten().chain(&self.h).chain(&energies);
        numbers.all(|x| x.is_finite())
    }
}

impl FrameReport {
    fn is_finite(&self) -> bool {
        let motions = [&self.local, &self.world, &self.aligned];
        let mut numbers = motions.into_iter().flat_map(|m| {
            let vectors = [&m.v, &m.a, &m.a_classical, &m.dJ_v].into_iter().flatten();
            vectors.chain(m.J.iter().flatten())
        });
        numbers.all(|x| x.is_finite()) && self.p.iter().all(|x| x.is_finite())
    }
}

/// Quantities beside forward and inverse dynamics.
#[derive(Clone, Debug, Serialize)]
pub(super) struct More {
    /// `M^-1 (tau - bias)`, by the factors of `M`; the bias is inverse dynamics at `ddq = 0`.
    pub(super) ddq_of_M: Vec<f64>,
    /// Jacobian of the centre of mass, in the world (3 × nv).
    pub(super) J_com: Rows,
    /// Momentum about the centre of mass, in the world's axes, linear first.
    pub(super) h: [f64; 6],
    /// The map from velocities to `h` (6 × nv).
    pub(super) A: Rows,
    /// Kinetic energy, J.
    pub(super) kinetic_energy: f64,
    /// Potential energy, J; zero at the world's origin.
    pub(super) potential_energy: f64,
    /// Joint-torque regressor (nv × 10 bodies): `m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz` of each.
    pub(super) regressor: Rows,
}

/// A frame in one state.
#[derive(Clone, Debug, Serialize)]
pub(super) struct FrameReport {
    /// Position in the world.
    pub(super) p: [f64; 3],
    /// Rotation matrix.
    pub(super) R: Rows,
    /// In the frame's own axes, at its origin.
    pub(super) local: FrameMotion,
    /// In the world's axes, at the world's origin.
    pub(super) world: FrameMotion,
    /// In the world's axes, at the frame's origin.
    pub(super) aligned: FrameMotion,
}

/// Motion of a frame, linear first.
#[derive(Clone, Debug, Serialize)]
pub(super) struct FrameMotion {
    /// Twist.
    pub(super) v: [f64; 6],
    /// Spatial acceleration.
    pub(super) a: [f64; 6],
    /// Classical acceleration.
    pub(super) a_classical: [f64; 6],
    /// Jacobian (6 × nv).
    pub(super) J: Rows,
    /// `dJ/dt v`.
    pub(super) dJ_v: [f64; 6],
}
