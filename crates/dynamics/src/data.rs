//! Memory of the algorithms, allocated once per model.

use crate::in_order::InOrder;
use crate::model::Model;
use crate::rows::{AbaRow, CrbaRow, RneaRow};
use crate::spatial::{Inertia, Motion, Se3};
use nalgebra::DMatrix;
use simd::{Instructions, Pack, WIDTH};

/// Packs of each column of an n × n matrix.
pub(crate) fn packs(n: usize) -> usize {
    n.div_ceil(WIDTH)
}

/// Results and intermediate values of every algorithm, for one model.
#[derive(Clone, Debug)]
pub struct Data {
    pub(crate) instructions: Instructions,
    pub(crate) rnea: Vec<RneaRow>,
    pub(crate) crba: Vec<CrbaRow>,
    /// Of bodies in their order; empty where limbs are side by side.
    pub(crate) in_order: InOrder,
    /// Placement of each body in its parent.
    pub(crate) in_parent: Vec<Se3>,
    /// Placement of each body in the world.
    pub(crate) in_world: Vec<Se3>,
    /// Twist of each body, in its frame.
    pub(crate) velocity: Vec<Motion>,
    /// Spatial acceleration of each body, in its frame.
    pub(crate) acceleration: Vec<Motion>,
    pub(crate) aba: Vec<AbaRow>,
    pub(crate) armature: Vec<f64>,
    /// Inertia of each body's sub-tree, in the world.
    pub(crate) subtree: Vec<Inertia>,
    /// One more than nv: idle lanes write to the last.
    pub(crate) tau: Vec<f64>,
    pub(crate) ddq: Vec<f64>,
    pub(crate) mass_matrix: DMatrix<f64>,
    pub(crate) factor: DMatrix<f64>,
    /// Columns of a factor and inverses of its pivots, where `aba` solves with `M`.
    pub(crate) columns: Vec<Pack>,
    pub(crate) inverse_pivots: Vec<f64>,
    pub(crate) zeros: Vec<f64>,
}

impl Data {
    /// Memory for `model`.
    pub fn new(model: &Model) -> Self {
        let n = model.bodies.len();
        let nv = model.nv();
        let rows = model.schedule.steps.len() + 1;
        Self {
            instructions: Instructions::detect(),
            rnea: vec![RneaRow::default(); rows],
            crba: vec![CrbaRow::ROOT; rows],
            in_order: if model.schedule.in_order {
                InOrder::new(&model.bodies, &model.schedule)
            } else {
                InOrder::default()
            },
            in_parent: vec![Se3::identity(); n],
            in_world: vec![Se3::identity(); n],
            velocity: vec![Motion::zero(); n],
            acceleration: vec![Motion::zero(); n],
            aba: vec![AbaRow::default(); rows],
            armature: vec![0.0; model.joints.len()],
            subtree: vec![Inertia::zero(); n],
            tau: vec![0.0; nv + 1],
            ddq: vec![0.0; nv + 1],
            mass_matrix: DMatrix::zeros(nv, nv),
            factor: DMatrix::zeros(nv, nv),
            columns: if model.has_mimic() || model.schedule.in_order {
                vec![Pack::ZERO; nv * packs(nv)]
            } else {
                Vec::new()
            },
            inverse_pivots: vec![0.0; nv],
            zeros: vec![0.0; model.nq()],
        }
    }
    /// Placement of each body in the world, after forward kinematics.
    pub fn placements(&self) -> &[Se3] {
        &self.in_world
    }
    /// Twist of each body, in its frame.
    pub fn velocities(&self) -> &[Motion] {
        &self.velocity
    }
    /// Spatial acceleration of each body, in its frame, after `forward_kinematics_acceleration`.
    pub fn accelerations(&self) -> &[Motion] {
        &self.acceleration
    }
    /// Chooses the instructions for `rnea`, `crba` and `aba`; those that the processor lacks are
    /// replaced by portable ones. For tests and benchmarks: `new` takes the best there are.
    pub fn set_instructions(&mut self, instructions: Instructions) {
        self.instructions = instructions;
    }
    /// `M`, after `crba` (nv × nv, both triangles).
    pub fn mass_matrix(&self) -> &DMatrix<f64> {
        &self.mass_matrix
    }
}
