//! Kinetic and potential energy.

use crate::centroidal::moving_bodies;
use crate::data::Data;
use crate::kinematics::at;
use crate::model::Model;

/// `T = v^T M v / 2`, J, armature included, after `forward_kinematics_velocity` with the same `v`.
pub fn kinetic_energy(model: &Model, data: &Data, v: &[f64]) -> f64 {
    let bodies = model.bodies.iter().zip(&data.velocity);
    let rigid: f64 = bodies.map(|(b, v)| v.dot(b.inertia.mul_motion(*v))).sum();
    let base = model.base_size().0;
    let joints = model.joints.iter().enumerate();
    let armature: f64 = joints
        .map(|(i, j)| j.armature * at(v, base + i).powi(2))
        .sum();
    0.5 * (rigid + armature)
}

/// `V = -sum m g·c`, J, zero at the world's origin, after forward kinematics.
pub fn potential_energy(model: &Model, data: &Data) -> f64 {
    let bodies = moving_bodies(model, data);
    let moment =
        bodies.map(|(b, m)| m.rotation * b.inertia.first_moment + m.translation * b.inertia.mass);
    -model.gravity.dot(&moment.sum())
}
