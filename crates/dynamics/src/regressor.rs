//! Joint torques as a linear function of the bodies' inertial parameters.

use crate::data::Data;
use crate::kinematics::{BaseMotion, base_placement, propagate, six};
use crate::model::{Base, Model};
use crate::spatial::{Force, Motion};
use nalgebra::{DMatrix, Vector3};

/// Inertial parameters of a body: `m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz`, the inertia about
/// the body frame's origin.
pub const PARAMETERS: usize = 10;

/// `Y` (nv × 10 bodies), with `rnea(q, v, a) = Y p` where no joint has armature.
///
/// `p` stacks the parameters of the bodies in order, the root's only where it floats. `out` has
/// as many columns.
pub fn joint_torque_regressor(
    model: &Model,
    data: &mut Data,
    q: &[f64],
    v: &[f64],
    a: &[f64],
    out: &mut DMatrix<f64>,
) {
    let (bv, bq) = model.base_size();
    let placement = base_placement(model, q);
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
    fn tail(x: &[f64], n: usize) -> &[f64] {
        x.get(n..).unwrap_or(&[])
    }
    propagate(model, data, &base, tail(q, bq), tail(v, bv), tail(a, bv));
    let first = usize::from(model.base == Base::Fixed);
    let columns = PARAMETERS * (model.bodies.len() - first);
    debug_assert_eq!(out.shape(), (model.nv(), columns));
    out.fill(0.0);
    if out.shape() != (model.nv(), columns) {
        return;
    }
    for body in first..model.bodies.len() {
        let wrenches = body_regressor(data.velocity[body], data.acceleration[body]);
        for (k, mut f) in wrenches.into_iter().enumerate() {
            let column = PARAMETERS * (body - first) + k;
            let mut i = body;
            while i > 0 {
                let b = &model.bodies[i];
                out[(bv + b.joint, column)] += b.ratio * b.along_axis(f);
                f = data.in_parent[i].act_force(f);
                i = b.parent;
            }
            if model.base == Base::Floating {
                out.view_mut((0, column), (6, 1))
                    .copy_from_slice(&f.to_array());
            }
        }
    }
}

/// Wrench of a body for each unit parameter.
fn body_regressor(v: Motion, a: Motion) -> [Force; PARAMETERS] {
    let (w, alpha) = (v.angular, a.angular);
    // Classical acceleration of the origin.
    let acceleration = a.linear + w.cross(&v.linear);
    let zero = Vector3::zeros();
    let moment = |e: Vector3<f64>| {
        let f = alpha.cross(&e) + w.cross(&w.cross(&e));
        Force::new(f, e.cross(&acceleration))
    };
    // I = e_i e_j^T (+ transpose): n = I alpha + w × I w
    let inertia = |i: usize, j: usize| {
        let times = |x: &Vector3<f64>| {
            let mut y = zero;
            y[i] += x[j];
            if i != j {
                y[j] += x[i];
            }
            y
        };
        Force::new(zero, times(&alpha) + w.cross(&times(&w)))
    };
    [
        Force::new(acceleration, zero),
        moment(Vector3::x()),
        moment(Vector3::y()),
        moment(Vector3::z()),
        inertia(0, 0),
        inertia(0, 1),
        inertia(1, 1),
        inertia(0, 2),
        inertia(1, 2),
        inertia(2, 2),
    ]
}
