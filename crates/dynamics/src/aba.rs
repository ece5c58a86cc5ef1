//! Articulated bodies: the acceleration that joint torques cause.

use crate::cholesky::{cholesky_decompose, cholesky_solve};
use crate::crba::crba;
use crate::data::Data;
use crate::kinematics::{at, base_placement, six};
use crate::model::{Base, Model};
use crate::rnea::rnea;
use crate::spatial::{Force, Inertia, Motion, Se3};
use nalgebra::{Matrix3, Matrix6, Vector3};

/// `ddq = M^-1 (tau - nle + sum J^T f)` (nv); `f_ext` as in `rnea`.
pub fn aba<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    v: &[f64],
    tau: &[f64],
    f_ext: Option<&[Force]>,
) -> &'d [f64] {
    if model.has_mimic() {
        return by_mass_matrix(model, data, q, v, tau, f_ext);
    }
    outward_velocities(model, data, q, v, f_ext);
    inward(model, data, tau);
    outward_accelerations(model, data);
    &data.ddq
}

/// Mimic joints couple bodies that the recursion takes as independent: solve with `M` instead.
fn by_mass_matrix<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    v: &[f64],
    tau: &[f64],
    f_ext: Option<&[Force]>,
) -> &'d [f64] {
    let zeros = std::mem::take(&mut data.zeros);
    rnea(model, data, q, v, &zeros, f_ext);
    data.zeros = zeros;
    let mut ddq = std::mem::take(&mut data.ddq);
    for (i, x) in ddq.iter_mut().enumerate() {
        *x = at(tau, i) - data.tau[i];
    }
    crba(model, data, q);
    cholesky_decompose(model, data);
    cholesky_solve(model, data, &mut ddq);
    data.ddq = ddq;
    &data.ddq
}

fn outward_velocities(
    model: &Model,
    data: &mut Data,
    q: &[f64],
    v: &[f64],
    f_ext: Option<&[Force]>,
) {
    let (bv, bq) = model.base_size();
    data.in_world[0] = base_placement(model, q);
    data.velocity[0] = match model.base {
        Base::Fixed => Motion::zero(),
        Base::Floating => six(v),
    };
    for (i, body) in model.bodies.iter().enumerate() {
        if i > 0 {
            let m = body.placement_at(at(q, bq + body.joint));
            let rate = body.subspace() * at(v, bv + body.joint);
            let v = m.inverse_act_motion(data.velocity[body.parent]) + rate;
            data.in_parent[i] = m;
            data.in_world[i] = data.in_world[body.parent].compose(&m);
            data.velocity[i] = v;
            data.aba[i].bias = v.cross(rate);
        }
        let v = data.velocity[i];
        data.force[i] = v.cross_force(body.inertia.mul_motion(v));
        if let Some(f) = f_ext.and_then(|f| f.get(i)) {
            data.force[i] -= *f;
        }
        data.articulated[i] = matrix(&body.inertia);
    }
}

fn inward(model: &Model, data: &mut Data, tau: &[f64]) {
    let bv = model.base_size().0;
    if model.base == Base::Floating {
        let base = six(tau);
        data.base_tau = Force::new(base.linear, base.angular);
    }
    for (i, body) in model.bodies.iter().enumerate().skip(1).rev() {
        let s = body.subspace();
        let inertia = data.articulated[i];
        let u_vector = force(&(inertia * s.to_vector()));
        let d = body.along_axis(u_vector) + model.joints[body.joint].armature;
        let u = at(tau, bv + body.joint) - body.along_axis(data.force[i]);
        let uu = u_vector.to_vector();
        let reduced = inertia - uu * uu.transpose() / d;
        let bias = data.aba[i].bias;
        let f = data.force[i] + force(&(reduced * bias.to_vector())) + u_vector * (u / d);
        data.aba[i].u_vector = u_vector;
        data.aba[i].inverse_d = 1.0 / d;
        data.aba[i].u = u;
        let m = data.in_parent[i];
        let x = action(&m.inverse());
        data.articulated[body.parent] += x.transpose() * reduced * x;
        data.force[body.parent] += m.act_force(f);
    }
}

fn outward_accelerations(model: &Model, data: &mut Data) {
    let bv = model.base_size().0;
    let up = data.in_world[0].rotation.tr_mul(&-model.gravity);
    data.acceleration[0] = Motion::new(up, Vector3::zeros());
    if model.base == Base::Floating {
        data.acceleration[0] = base_acceleration(data);
        let a = data.acceleration[0] - Motion::new(up, Vector3::zeros());
        data.ddq[..6].copy_from_slice(&a.to_array());
    }
    for (i, body) in model.bodies.iter().enumerate().skip(1) {
        let joint = data.aba[i];
        let a = data.in_parent[i].inverse_act_motion(data.acceleration[body.parent]) + joint.bias;
        let ddq = joint.inverse_d * (joint.u - a.dot(joint.u_vector));
        data.acceleration[i] = a + body.subspace() * ddq;
        data.ddq[bv + body.joint] = ddq;
    }
}

/// Acceleration of a floating base, gravity included, that balances its articulated bias and
/// the six torques of its joint.
fn base_acceleration(data: &Data) -> Motion {
    let wrench = data.base_tau - data.force[0];
    let x = data.articulated[0]
        .cholesky()
        .map(|c| c.solve(&wrench.to_vector()))
        .unwrap_or_else(|| nalgebra::Vector6::repeat(f64::NAN));
    Motion::new(x.fixed_rows::<3>(0).into(), x.fixed_rows::<3>(3).into())
}

fn force(x: &nalgebra::Vector6<f64>) -> Force {
    Force::new(x.fixed_rows::<3>(0).into(), x.fixed_rows::<3>(3).into())
}

/// Spatial inertia as a matrix.
fn matrix(inertia: &Inertia) -> Matrix6<f64> {
    let h = inertia.first_moment.cross_matrix();
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&Matrix3::from_diagonal_element(inertia.mass));
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(&-h);
    m.fixed_view_mut::<3, 3>(3, 0).copy_from(&h);
    m.fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&inertia.rotational);
    m
}

/// The matrix that does what `Se3::act_motion` does.
fn action(m: &Se3) -> Matrix6<f64> {
    let mut x = Matrix6::zeros();
    x.fixed_view_mut::<3, 3>(0, 0).copy_from(&m.rotation);
    x.fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(m.translation.cross_matrix() * m.rotation));
    x.fixed_view_mut::<3, 3>(3, 3).copy_from(&m.rotation);
    x
}
