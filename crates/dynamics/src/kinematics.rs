//! Forward kinematics: placements, twists and accelerations of all bodies.

use crate::data::Data;
use crate::model::{Base, Model};
use crate::spatial::{Motion, Se3};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Motion of the root, where it is not that of `q`, `v` and `a`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BaseMotion {
    /// Placement of the root in the world.
    pub(crate) placement: Se3,
    /// Twist of the root, in its frame.
    pub(crate) velocity: Motion,
    /// Spatial acceleration of the root, in its frame; proper (`a - g`) if its wrenches shall
    /// contain weight.
    pub(crate) acceleration: Motion,
}

/// Component `i`, or zero where the caller's vector is too short.
#[inline]
pub(crate) fn at(x: &[f64], i: usize) -> f64 {
    debug_assert!(i < x.len(), "vector too short: {} of {}", x.len(), i + 1);
    x.get(i).copied().unwrap_or(0.0)
}

/// Six components of the base.
#[inline]
pub(crate) fn six(x: &[f64]) -> Motion {
    Motion::from_array(std::array::from_fn(|i| at(x, i)))
}

/// Placement of a floating base from `q`; a quaternion that is not of length 1 is normalised.
#[inline]
pub(crate) fn base_placement(model: &Model, q: &[f64]) -> Se3 {
    match model.base {
        Base::Fixed => Se3::identity(),
        Base::Floating => {
            let quaternion = Quaternion::new(at(q, 6), at(q, 3), at(q, 4), at(q, 5));
            let rotation = UnitQuaternion::try_new(quaternion, 1e-12).unwrap_or_default();
            Se3::new(
                rotation.to_rotation_matrix().into_inner(),
                Vector3::new(at(q, 0), at(q, 1), at(q, 2)),
            )
        }
    }
}

/// Root and joints' part of `(q, v, a)`.
#[inline]
fn split<'a>(model: &Model, q: &'a [f64], v: &'a [f64], a: &'a [f64]) -> [&'a [f64]; 3] {
    let (bv, bq) = model.base_size();
    let tail = |x: &'a [f64], n| x.get(n..).unwrap_or(&[]);
    [tail(q, bq), tail(v, bv), tail(a, bv)]
}

/// Placements of all bodies.
pub fn forward_kinematics(model: &Model, data: &mut Data, q: &[f64]) {
    let joints = q.get(model.base_size().1..).unwrap_or(&[]);
    data.in_world[0] = base_placement(model, q);
    for (i, body) in model.bodies.iter().enumerate().skip(1) {
        let angle = at(joints, body.joint) * body.ratio + body.offset;
        data.in_parent[i] = body.placement_at(angle);
        data.in_world[i] = data.in_world[body.parent].compose(&data.in_parent[i]);
    }
}

/// Placements and twists of all bodies.
pub fn forward_kinematics_velocity(model: &Model, data: &mut Data, q: &[f64], v: &[f64]) {
    let joints = v.get(model.base_size().0..).unwrap_or(&[]);
    forward_kinematics(model, data, q);
    data.velocity[0] = match model.base {
        Base::Fixed => Motion::zero(),
        Base::Floating => six(v),
    };
    for (i, body) in model.bodies.iter().enumerate().skip(1) {
        let rate = at(joints, body.joint) * body.ratio;
        data.velocity[i] = data.in_parent[i].inverse_act_motion(data.velocity[body.parent])
            + body.subspace() * rate;
    }
}

/// Placements, twists and spatial accelerations of all bodies (without gravity).
pub fn forward_kinematics_acceleration(
    model: &Model,
    data: &mut Data,
    q: &[f64],
    v: &[f64],
    a: &[f64],
) {
    let [jq, jv, ja] = split(model, q, v, a);
    let floating = model.base == Base::Floating;
    let base = BaseMotion {
        placement: base_placement(model, q),
        velocity: if floating { six(v) } else { Motion::zero() },
        acceleration: if floating { six(a) } else { Motion::zero() },
    };
    propagate(model, data, &base, jq, jv, ja);
}

/// Placements, twists and accelerations of all bodies from the root's motion and the joints'
/// (`joint_count` components each), whatever the model's base.
pub(crate) fn propagate(
    model: &Model,
    data: &mut Data,
    base: &BaseMotion,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
) {
    data.in_world[0] = base.placement;
    data.velocity[0] = base.velocity;
    data.acceleration[0] = base.acceleration;
    for (i, body) in model.bodies.iter().enumerate().skip(1) {
        let s = body.subspace();
        let m = body.placement_at(at(q, body.joint) * body.ratio + body.offset);
        let rate = s * (at(dq, body.joint) * body.ratio);
        let v = m.inverse_act_motion(data.velocity[body.parent]) + rate;
        data.acceleration[i] = m.inverse_act_motion(data.acceleration[body.parent])
            + s * (at(ddq, body.joint) * body.ratio)
            + v.cross(rate);
        data.in_parent[i] = m;
        data.in_world[i] = data.in_world[body.parent].compose(&m);
        data.velocity[i] = v;
    }
}

/// Motion of an inertial measurement unit as it measures it, in its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuMotion {
    /// `omega`, rad/s (3).
    pub angular_velocity: Vector3<f64>,
    /// Rate of `omega`, rad/s² (3); zero if neglected.
    pub angular_acceleration: Vector3<f64>,
    /// Acceleration of the frame's origin minus gravity, m/s² (3).
    pub proper_acceleration: Vector3<f64>,
}
