//! Recursive Newton-Euler as R. Featherstone prints it (Rigid Body Dynamics Algorithms, 2008; tag
//! F): one body after another, six-vectors and six-by-six matrices, angular part first. The first
//! oracle of the fast `rnea`, with which it shares nothing but the model.

use dynamics::{Base, Body, Force, Model};
use nalgebra::{Matrix3, Matrix6, Quaternion, Rotation3, Unit, UnitQuaternion, Vector3, Vector6};

/// `tau` (nv) of `q`, `v`, `a` and the external wrenches on each body, in its frame.
pub(crate) fn inverse_dynamics(model: &Model, [q, v, a]: [&[f64]; 3], f_ext: &[Force]) -> Vec<f64> {
    let (base_v, base_q) = match model.base() {
        Base::Fixed => (0, 0),
        Base::Floating => (6, 7),
    };
    let bodies = model.bodies();
    let mut x_parent = vec![Matrix6::identity()];
    let (mut vel, mut acc, mut f) = (Vec::new(), Vec::new(), Vec::new());
    let (v_0, a_0) = root(model, [q, v, a]);
    vel.push(v_0);
    acc.push(a_0);
    f.push(body_wrench(&bodies[0], &v_0, &a_0, &f_ext[0]));
    for (i, body) in bodies.iter().enumerate().skip(1) {
        let (lambda, j) = (body.parent, body.joint);
        let rate = body.ratio * v[base_v + j];
        let rate_change = body.ratio * a[base_v + j];
        let (x_j, s) = joint(body, body.ratio * q[base_q + j] + body.offset);
        //= F Table 5.1: iX_lambda = X_J X_T
        x_parent
            .push(x_j * motion_transform(&body.placement.rotation, &body.placement.translation));
        //= F Table 5.1: v_J = S_i dq_i
        let v_j = s * rate;
        //= F Table 5.1: v_i = iX_lambda v_lambda + v_J
        vel.push(x_parent[i] * vel[lambda] + v_j);
        //= F Table 5.1: a_i = iX_lambda a_lambda + S_i ddq_i + c_J + v_i x v_J (c_J = 0)
        acc.push(x_parent[i] * acc[lambda] + s * rate_change + cross_motion(&vel[i]) * v_j);
        f.push(body_wrench(body, &vel[i], &acc[i], &f_ext[i]));
    }
    let mut tau = vec![0.0; model.nv()];
    for (i, body) in bodies.iter().enumerate().skip(1).rev() {
        let (_, s) = joint(body, 0.0);
        //= F Table 5.1: tau_i = S_i^T f_i
        tau[base_v + body.joint] += body.ratio * s.dot(&f[i]);
        //= F Table 5.1: f_lambda = f_lambda + lambdaX*_i f_i
        let to_parent = x_parent[i].transpose() * f[i];
        f[body.parent] += to_parent;
    }
    for (j, joint) in model.joints().iter().enumerate() {
        tau[base_v + j] += joint.armature * a[base_v + j];
    }
    if model.base() == Base::Floating {
        tau[..6].copy_from_slice(swapped(&f[0]).as_slice());
    }
    tau
}

/// The root's velocity and acceleration: a joint of six degrees of freedom (`S = 1`), or none.
fn root(model: &Model, [q, v, a]: [&[f64]; 3]) -> (Vector6<f64>, Vector6<f64>) {
    let gravity = model.gravity();
    let a_g = Vector6::new(0.0, 0.0, 0.0, gravity.x, gravity.y, gravity.z);
    if model.base() == Base::Fixed {
        //= F Table 5.1: v_0 = 0, a_0 = -a_g
        return (Vector6::zeros(), -a_g);
    }
    let quaternion = Quaternion::new(q[6], q[3], q[4], q[5]);
    let rotation = UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix();
    let x = motion_transform(rotation.matrix(), &Vector3::new(q[0], q[1], q[2]));
    let six = |x: &[f64]| swapped(&Vector6::from_column_slice(&x[..6]));
    (six(v), six(a) - x * a_g)
}

/// Net wrench on a body, less the external one.
fn body_wrench(body: &Body, v: &Vector6<f64>, a: &Vector6<f64>, f_ext: &Force) -> Vector6<f64> {
    let inertia = spatial_inertia(body);
    //= F Table 5.1: f_i = I_i a_i + v_i x* I_i v_i - f_i^x
    inertia * a + cross_force(v) * inertia * v - swapped(&f_ext.to_vector())
}

/// `X_J` and `S` of a joint with one degree of freedom.
fn joint(body: &Body, q: f64) -> (Matrix6<f64>, Vector6<f64>) {
    let (axis, zero) = (body.axis, Vector3::zeros());
    let rotation = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), q);
    if body.kind.is_revolute() {
        //= F Table 4.1: revolute, X_J = rot(q), S = [axis; 0]
        (
            motion_transform(rotation.matrix(), &zero),
            stacked(&axis, &zero),
        )
    } else {
        //= F Table 4.1: prismatic, X_J = xlt(q), S = [0; axis]
        (
            motion_transform(&Matrix3::identity(), &(axis * q)),
            stacked(&zero, &axis),
        )
    }
}

/// `X`: coordinates of a motion in A to those in B, whose axes and origin in A are given.
fn motion_transform(axes: &Matrix3<f64>, origin: &Vector3<f64>) -> Matrix6<f64> {
    let e = axes.transpose();
    //= F Section 2.8: BX_A = [E 0; -E rx E]
    blocks(e, Matrix3::zeros(), -e * origin.cross_matrix(), e)
}

fn cross_motion(v: &Vector6<f64>) -> Matrix6<f64> {
    let angular = v.fixed_rows::<3>(0).into_owned().cross_matrix();
    let linear = v.fixed_rows::<3>(3).into_owned().cross_matrix();
    //= F Section 2.9: vx = [omegax 0; v_Ox omegax]
    blocks(angular, Matrix3::zeros(), linear, angular)
}

fn cross_force(v: &Vector6<f64>) -> Matrix6<f64> {
    //= F Section 2.9: vx* = -(vx)^T
    -cross_motion(v).transpose()
}

fn spatial_inertia(body: &Body) -> Matrix6<f64> {
    let inertia = &body.inertia;
    let h = inertia.first_moment.cross_matrix();
    let mass = Matrix3::from_diagonal_element(inertia.mass);
    //= F Section 2.13: I = [I_O hx; hx^T m1], h = m c
    blocks(inertia.rotational, h, h.transpose(), mass)
}

fn blocks(a: Matrix3<f64>, b: Matrix3<f64>, c: Matrix3<f64>, d: Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&a);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(&b);
    m.fixed_view_mut::<3, 3>(3, 0).copy_from(&c);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(&d);
    m
}

fn stacked(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
}

/// Angular part first from linear part first, or the reverse.
fn swapped(x: &Vector6<f64>) -> Vector6<f64> {
    Vector6::new(x[3], x[4], x[5], x[0], x[1], x[2])
}
