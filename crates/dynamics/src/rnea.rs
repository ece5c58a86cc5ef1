//! Recursive Newton-Euler: the joint torques of a motion.

use crate::data::Data;
use crate::kinematics::{BaseMotion, at, base_placement, propagate, six};
use crate::model::{Base, Model};
use crate::spatial::{Force, Motion};
use nalgebra::Vector3;

/// `tau = M(q) a + nle(q, v) - sum J^T f` (nv).
///
/// `f_ext`: wrenches that the environment applies to each body, in the body's frame, one per body
/// (body 0 included).
pub fn rnea<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    v: &[f64],
    a: &[f64],
    f_ext: Option<&[Force]>,
) -> &'d [f64] {
    let (bv, bq) = model.base_size();
    let placement = base_placement(model, q);
    // Gravity enters as if the base accelerated upwards.
    let up = placement.rotation.tr_mul(&-model.gravity);
    let mut base = BaseMotion {
        placement,
        velocity: Motion::zero(),
        acceleration: Motion::new(up, Vector3::zeros()),
    };
    if model.base == Base::Floating {
        base.velocity = six(v);
        base.acceleration += six(a);
    }
    let tail = |x: &'_ [f64], n: usize| -> std::ops::Range<usize> { n.min(x.len())..x.len() };
    propagate(
        model,
        data,
        &base,
        &q[tail(q, bq)],
        &v[tail(v, bv)],
        &a[tail(a, bv)],
    );
    torques(model, data, f_ext);
    for (i, joint) in model.joints.iter().enumerate() {
        data.tau[bv + i] += joint.armature * at(a, bv + i);
    }
    &data.tau
}

/// `nle(q, v)`: Coriolis, centrifugal and gravity torques (nv).
pub fn nle<'d>(model: &Model, data: &'d mut Data, q: &[f64], v: &[f64]) -> &'d [f64] {
    let zeros = std::mem::take(&mut data.zeros);
    rnea(model, data, q, v, &zeros, None);
    data.zeros = zeros;
    &data.tau
}

/// `g(q)`: gravity torques (nv).
pub fn gravity<'d>(model: &Model, data: &'d mut Data, q: &[f64]) -> &'d [f64] {
    let zeros = std::mem::take(&mut data.zeros);
    rnea(model, data, q, &zeros, &zeros, None);
    data.zeros = zeros;
    &data.tau
}

/// Backward pass: from the motion in `data` to wrenches and torques.
fn torques(model: &Model, data: &mut Data, f_ext: Option<&[Force]>) {
    for (i, body) in model.bodies.iter().enumerate() {
        data.force[i] = body.inertia.wrench(data.velocity[i], data.acceleration[i]);
        if let Some(f) = f_ext.and_then(|f| f.get(i)) {
            data.force[i] -= *f;
        }
    }
    let base = model.base_size().0;
    data.tau.fill(0.0);
    for (i, body) in model.bodies.iter().enumerate().skip(1).rev() {
        let f = data.force[i];
        data.tau[base + body.joint] += body.ratio * body.along_axis(f);
        let on_parent = data.in_parent[i].act_force(f);
        data.force[body.parent] += on_parent;
    }
    if model.base == Base::Floating {
        data.tau[..6].copy_from_slice(&data.force[0].to_array());
    }
}
