//! The true quantities: the record that estimates are compared with.

use crate::articulated::Dynamics;
use crate::spatial::{split, stack};
use crate::tree::{Frame, State};
use nalgebra::{Matrix3, Vector3, Vector6};
use robot_state::Wrench;

/// True quantities of a joint.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct JointTruth {
    /// tau: torque that the transmission (gear and bearing) applies to the child link along +q, N·m.
    pub tau: f64,
    /// T: torque between gear and output bearing, N·m.
    pub gear_torque: f64,
    /// q: link angle, rad.
    pub q: f64,
    /// dq: link velocity, rad/s.
    pub dq: f64,
    /// ddq: link acceleration, rad/s².
    pub ddq: f64,
    /// theta: motor angle, rad.
    pub theta: f64,
    /// omega: motor velocity, rad/s.
    pub omega: f64,
    /// i: motor current, A.
    pub current: f64,
}

/// An external wrench on a link.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ExternalTruth {
    /// The link's name.
    pub link: String,
    /// The wrench about the link's origin in the link's axes.
    pub wrench: Wrench,
}

/// Everything true at one instant: `M(q) a + h(q, v) - sum J^T f = S^T tau` holds to rounding.
#[derive(Debug, Clone)]
pub struct Truth {
    /// Time since the start, s.
    pub time: f64,
    /// Joints, in the plan's order.
    pub joints: Vec<JointTruth>,
    /// Base position in the world, m.
    pub base_position: [f64; 3],
    /// Base orientation in the world, quaternion x y z w.
    pub base_orientation: [f64; 4],
    /// Base velocity in base axes, linear then angular, m/s and rad/s.
    pub base_velocity: [f64; 6],
    /// Base spatial acceleration in base axes, linear then angular, m/s² and rad/s².
    pub base_acceleration: [f64; 6],
    /// Centre of mass in the world, m.
    pub centre_of_mass: [f64; 3],
    /// F/T sensors without their errors.
    pub ft: Vec<Wrench>,
    /// External wrenches: feet, then harness, then pushes, each in the order of `sim.toml`.
    pub external: Vec<ExternalTruth>,
}

impl Truth {
    pub(crate) fn new(joints: usize, ft: usize, external: usize) -> Self {
        Self {
            time: 0.0,
            joints: vec![JointTruth::default(); joints],
            base_position: [0.0; 3],
            base_orientation: [0.0, 0.0, 0.0, 1.0],
            base_velocity: [0.0; 6],
            base_acceleration: [0.0; 6],
            centre_of_mass: [0.0; 3],
            ft: vec![Wrench::default(); ft],
            external: vec![ExternalTruth::default(); external],
        }
    }

    pub(crate) fn set_base(&mut self, state: &State, acceleration: &Vector6<f64>) {
        let rotation = state.orientation.to_rotation_matrix().into_inner();
        self.base_position = state.position.into();
        self.base_orientation = state.orientation.coords.into();
        self.base_velocity = in_base(&state.twist, &rotation, &state.position);
        self.base_acceleration = in_base(acceleration, &rotation, &state.position);
    }
}

/// A motion about the world's origin, brought to a frame: linear then angular, frame axes.
fn in_base(motion: &Vector6<f64>, rotation: &Matrix3<f64>, position: &Vector3<f64>) -> [f64; 6] {
    let (angular, linear) = split(motion);
    let here = rotation.tr_mul(&(linear + angular.cross(position)));
    stack(here, rotation.tr_mul(&angular)).into()
}

impl ExternalTruth {
    pub(crate) fn set(&mut self, frame: &Frame, dynamics: &Dynamics, wrench: &Vector6<f64>) {
        if self.link != frame.name {
            self.link.clone_from(&frame.name);
        }
        let (rotation, position) = dynamics.placement(frame);
        let (torque, force) = split(wrench);
        self.wrench.force = rotation.tr_mul(&force).into();
        self.wrench.torque = rotation.tr_mul(&(torque - position.cross(&force))).into();
    }
}
