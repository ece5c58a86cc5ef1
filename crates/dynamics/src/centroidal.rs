//! Centre of mass, centroidal momentum, and how velocities map to them.

use crate::body::Body;
use crate::data::Data;
use crate::model::{Base, Model};
use crate::spatial::{Force, Inertia, Motion, Se3};
use nalgebra::{Matrix3xX, Matrix6xX, Vector3};

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

/// `J_c` (3 × nv), after forward kinematics: the centre of mass moves with `J_c v` in the world.
pub fn center_of_mass_jacobian(model: &Model, data: &mut Data, out: &mut Matrix3xX<f64>) {
    let mass: f64 = moving_bodies(model, data).map(|b| b.0.inertia.mass).sum();
    debug_assert_eq!(out.ncols(), model.nv());
    out.fill(0.0);
    columns(model, data, |column, momentum| {
        if column < out.ncols() {
            let mut c = out.column_mut(column);
            c += momentum.linear / mass;
        }
    });
}

/// `A` (6 × nv), after forward kinematics: momentum about the centre of mass, in the world's axes,
/// is `A v`.
pub fn centroidal_map(model: &Model, data: &mut Data, out: &mut Matrix6xX<f64>) {
    let center = center_of_mass(model, data);
    debug_assert_eq!(out.ncols(), model.nv());
    out.fill(0.0);
    columns(model, data, |column, momentum| {
        if column < out.ncols() {
            let mut c = out.column_mut(column);
            c += about(momentum, &center).to_vector();
        }
    });
}

/// `h`: momentum about the centre of mass, in the world's axes, N·s and N·m·s, after
/// `forward_kinematics_velocity`.
pub fn centroidal_momentum(model: &Model, data: &Data) -> Force {
    let mut sum = Force::zero();
    let first = usize::from(model.base == Base::Fixed);
    for (i, body) in model.bodies.iter().enumerate().skip(first) {
        sum += data.in_world[i].act_force(body.inertia.mul_motion(data.velocity[i]));
    }
    about(sum, &center_of_mass(model, data))
}

/// A wrench or momentum about the world's origin, taken about another point.
fn about(f: Force, point: &Vector3<f64>) -> Force {
    Force::new(f.linear, f.angular - point.cross(&f.linear))
}

/// Momentum of the robot about the world's origin for unit speed of each component of `v`.
fn columns(model: &Model, data: &mut Data, mut add: impl FnMut(usize, Force)) {
    for (i, body) in model.bodies.iter().enumerate() {
        data.subtree[i] = body.inertia.transformed(&data.in_world[i]);
    }
    for (i, body) in model.bodies.iter().enumerate().skip(1).rev() {
        let own: Inertia = data.subtree[i];
        data.subtree[body.parent] += own;
        let twist = data.in_world[i].act_motion(body.subspace() * body.ratio);
        let column = model.base_size().0 + body.joint;
        add(column, data.subtree[i].mul_motion(twist));
    }
    if model.base == Base::Floating {
        for k in 0..6 {
            let mut unit = [0.0; 6];
            unit[k] = 1.0;
            let twist = data.in_world[0].act_motion(Motion::from_array(unit));
            add(k, data.subtree[0].mul_motion(twist));
        }
    }
}
