//! Forward kinematics: placements, twists and accelerations of all bodies.

use crate::data::Data;
use crate::model::{Base, Model};
use crate::spatial::{Force, Motion, Se3};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Motion of the root, given from outside instead of by `q`, `v` and `a`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseMotion {
    /// Placement of the root in the world.
    pub placement: Se3,
    /// Twist of the root, in its frame.
    pub velocity: Motion,
    /// Spatial acceleration of the root, in its frame; proper (`a - g`) if its wrenches shall
    /// contain weight.
    pub acceleration: Motion,
}

impl BaseMotion {
    /// At the world's origin, at rest, without gravity.
    pub fn rest() -> Self {
        Self {
            placement: Se3::identity(),
            velocity: Motion::zero(),
            acceleration: Motion::zero(),
        }
    }
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
///
/// With the proper acceleration of an IMU the result needs neither the base's pose nor gravity.
pub fn propagate(
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

/// Wrench that each body's joint applies to it, in its frame, after `propagate` (of a body of the
/// root: the wrench that holds the root). `f_ext` as in `rnea`.
pub fn joint_wrenches<'d>(
    model: &Model,
    data: &'d mut Data,
    f_ext: Option<&[Force]>,
) -> &'d [Force] {
    for (i, body) in model.bodies.iter().enumerate() {
        data.force[i] = body.inertia.wrench(data.velocity[i], data.acceleration[i]);
        if let Some(f) = f_ext.and_then(|f| f.get(i)) {
            data.force[i] -= *f;
        }
    }
    for (i, body) in model.bodies.iter().enumerate().skip(1).rev() {
        let on_parent = data.in_parent[i].act_force(data.force[i]);
        data.force[body.parent] += on_parent;
    }
    &data.force
}

/// What an inertial measurement unit tells about its own frame, in its axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuMotion {
    /// `omega`, rad/s (3).
    pub angular_velocity: Vector3<f64>,
    /// Rate of `omega`, rad/s² (3); zero if neglected.
    pub angular_acceleration: Vector3<f64>,
    /// Acceleration of the frame's origin minus gravity, m/s² (3).
    pub proper_acceleration: Vector3<f64>,
}

/// The root's twist and proper acceleration that make `frame` move as an IMU measured it.
///
/// The linear velocity cannot be known and does not matter to any wrench: the root's is zero.
/// Uses `data` as scratch memory; call `propagate` with the result afterwards.
pub fn base_motion_from_imu(
    model: &Model,
    data: &mut Data,
    frame: usize,
    imu: &ImuMotion,
    q: &[f64],
    dq: &[f64],
    ddq: &[f64],
) -> BaseMotion {
    let Some(f) = model.frames.get(frame) else {
        debug_assert!(false, "no such frame");
        return BaseMotion::rest();
    };
    // Relative to the root first, then with the root turning, then with its acceleration.
    let mut base = BaseMotion::rest();
    propagate(model, data, &base, q, dq, ddq);
    let placement = data.in_world[f.body].compose(&f.placement);
    let relative = f.placement.inverse_act_motion(data.velocity[f.body]);
    base.velocity.angular = placement.rotation * (imu.angular_velocity - relative.angular);
    propagate(model, data, &base, q, dq, ddq);
    let velocity = f.placement.inverse_act_motion(data.velocity[f.body]);
    let acceleration = f.placement.inverse_act_motion(data.acceleration[f.body]);
    let wanted = Motion::new(
        imu.proper_acceleration - velocity.angular.cross(&velocity.linear),
        imu.angular_acceleration,
    );
    base.acceleration = placement.act_motion(wanted - acceleration);
    base
}
