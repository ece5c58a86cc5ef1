//! Centre of mass.

use crate::data::Data;
use crate::model::{Base, Body, Model};
use crate::spatial::Se3;
use nalgebra::Vector3;

/// `c`: centre of mass in the world, m (3), after forward kinematics. A fixed root's mass is left
/// out, as in Pinocchio: it does not move.
pub fn center_of_mass(model: &Model, data: &Data) -> Vector3<f64> {
    let mut moment = Vector3::zeros();
    let mut mass = 0.0;
    for (body, placement) in moving_bodies(model, data) {
        moment += placement.rotation * body.inertia.first_moment
            + placement.translation * body.inertia.mass;
        mass += body.inertia.mass;
    }
    if mass > 0.0 {
        moment / mass
    } else {
        Vector3::zeros()
    }
}

/// Bodies that can move, with their placements in the world.
pub(crate) fn moving_bodies<'a>(
    model: &'a Model,
    data: &'a Data,
) -> impl Iterator<Item = (&'a Body, &'a Se3)> {
    let first = usize::from(model.base == Base::Fixed);
    model.bodies.iter().zip(&data.in_world).skip(first)
}
