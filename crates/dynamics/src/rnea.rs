//! Recursive Newton-Euler: the joint torques of a motion (F: R. Featherstone, Rigid Body Dynamics
//! Algorithms, 2008, Table 5.1).
//!
//! Runs on the model's lane schedule, four bodies at a time; tests/support/textbook.rs has the
//! algorithm as printed. The acceleration of a point `r` of a body is
//! `a + U r` with `U = [alpha] + [omega][omega]`; with the second moments `S = ∫ r r^T dm` the net
//! moment about the origin is `h × a + 2 axial(U S)`, with `h` the first moment (Khalil and Dombre,
//! Modeling, Identification and Control of Robots, 9.5).

mod in_order;

use crate::data::Data;
use crate::in_order::{BodyRow, sized};
use crate::kinematics::{base_placement, six};
use crate::lane_schedule::{LaneSchedule, Step};
use crate::model::{Base, Model};
use crate::rows::RneaRow;
use crate::spatial::{Force, Inertia};
use in_order::run as run_in_order;
use nalgebra::Vector3;
use simd::{Kernel, Lanes, M3, Pack, V3, WIDTH, gather, run, scatter_add, sin_cos};

/// `tau = M(q) a + nle(q, v) - sum J^T f` (nv).
///
/// `f_ext`: wrenches that the environment applies to each body, in the body's frame, one per body
/// (body 0 included). Leaves the results of forward kinematics as they are.
pub fn rnea<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    v: &[f64],
    a: &[f64],
    f_ext: Option<&[Force]>,
) -> &'d [f64] {
    debug_assert!(q.len() >= model.nq() && v.len() >= model.nv() && a.len() >= model.nv());
    match (model.base, model.schedule.in_order) {
        (Base::Fixed, true) => sized!(data.in_order, run_in_order(model, data, [q, v, a], f_ext)),
        (Base::Fixed, false) => {
            side_by_side(model, data, &RootMotion::fixed(model), [q, v, a], f_ext);
        }
        (Base::Floating, _) => floating(model, data, [q, v, a], f_ext),
    }
    &data.tau[..model.nv()]
}

/// `rnea` of a floating base, too.
fn floating(model: &Model, data: &mut Data, [q, v, a]: [&[f64]; 3], f_ext: Option<&[Force]>) {
    let (bv, bq) = model.base_size();
    let joints = [(q, bq), (v, bv), (a, bv)].map(|(x, base)| &x[base.min(x.len())..]);
    let root = RootMotion::floating(model, q, v, a);
    let children = if model.schedule.in_order {
        root.store_in_order(&mut data.in_order.root);
        sized!(data.in_order, run_in_order(model, data, joints, f_ext));
        data.in_order.wrench_of_root()
    } else {
        side_by_side(model, data, &root, joints, f_ext);
        let sum = |p: &[Pack; 3]| Vector3::from(p.each_ref().map(|p| p.0.iter().sum()));
        Force::new(sum(&data.rnea[0].f), sum(&data.rnea[0].n))
    };
    let mut total = root.own_wrench(&model.bodies[0].inertia) + children;
    if let Some(f) = f_ext.and_then(|f| f.first()) {
        total -= *f;
    }
    data.tau[..6].copy_from_slice(&total.to_array());
}

/// `rnea` of the joints, limbs side by side.
fn side_by_side(
    model: &Model,
    data: &mut Data,
    root: &RootMotion,
    [q, v, a]: [&[f64]; 3],
    f_ext: Option<&[Force]>,
) {
    root.store(&mut data.rnea[0]);
    let tau = &mut data.tau[model.base_size().0..];
    tau.fill(0.0);
    for ((t, joint), a) in tau.iter_mut().zip(&model.joints).zip(a) {
        *t = joint.armature * a;
    }
    let kernel = Rnea {
        schedule: &model.schedule,
        rows: &mut data.rnea,
        q,
        v,
        a,
        f_ext,
        tau,
    };
    run(data.instructions, kernel);
}

/// `nle(q, v)`: Coriolis, centrifugal and gravity torques (nv).
pub fn nle<'d>(model: &Model, data: &'d mut Data, q: &[f64], v: &[f64]) -> &'d [f64] {
    let zeros = std::mem::take(&mut data.zeros);
    rnea(model, data, q, v, &zeros, None);
    data.zeros = zeros;
    &data.tau[..model.nv()]
}

/// `g(q)`: gravity torques (nv).
pub fn gravity<'d>(model: &Model, data: &'d mut Data, q: &[f64]) -> &'d [f64] {
    let zeros = std::mem::take(&mut data.zeros);
    rnea(model, data, q, &zeros, &zeros, None);
    data.zeros = zeros;
    &data.tau[..model.nv()]
}

/// Motion of the root in its axes; gravity enters as if the base accelerated upwards.
struct RootMotion {
    omega: Vector3<f64>,
    alpha: Vector3<f64>,
    /// Of the origin, minus gravity.
    a: Vector3<f64>,
}

impl RootMotion {
    fn fixed(model: &Model) -> Self {
        Self {
            omega: Vector3::zeros(),
            alpha: Vector3::zeros(),
            a: -model.gravity,
        }
    }
    fn floating(model: &Model, q: &[f64], v: &[f64], a: &[f64]) -> Self {
        let (v, a) = (six(v), six(a));
        let up = base_placement(model, q).rotation.tr_mul(&-model.gravity);
        Self {
            omega: v.angular,
            alpha: a.angular,
            //= F Table 5.1: a_0 = -a_g, of a floating base a_0 = a - a_g
            a: up + a.linear + v.angular.cross(&v.linear),
        }
    }
    /// To the root's row of bodies in their order.
    fn store_in_order(&self, row: &mut BodyRow) {
        let pack = |x: &Vector3<f64>| Pack([x.x, x.y, x.z, 0.0]);
        (row.omega, row.alpha, row.a) = (pack(&self.omega), pack(&self.alpha), pack(&self.a));
    }
    /// To all lanes of the root's row.
    fn store(&self, row: &mut RneaRow) {
        let all = |x: Vector3<f64>| [x.x, x.y, x.z].map(|x| Pack([x; WIDTH]));
        row.f = [Pack::ZERO; 3];
        row.n = [Pack::ZERO; 3];
        row.omega = all(self.omega);
        row.alpha = all(self.alpha);
        row.a = all(self.a);
        let w = self.omega.cross_matrix();
        let u = self.alpha.cross_matrix() + w * w;
        row.u = std::array::from_fn(|k| Pack([u[(k / 3, k % 3)]; WIDTH]));
    }
    /// The wrench that gives a floating base its motion.
    fn own_wrench(&self, inertia: &Inertia) -> Force {
        let Self { omega, alpha, a } = self;
        let h = &inertia.first_moment;
        //= F Table 5.1: f_0 = I_0 a_0 + v_0 x* I_0 v_0 - f_0^x + sum f_i, of a floating base
        let f = a * inertia.mass + alpha.cross(h) + omega.cross(&omega.cross(h));
        let n =
            inertia.rotational * alpha + omega.cross(&(inertia.rotational * omega)) + h.cross(a);
        Force::new(f, n)
    }
}

struct Rnea<'a> {
    schedule: &'a LaneSchedule,
    rows: &'a mut [RneaRow],
    q: &'a [f64],
    v: &'a [f64],
    a: &'a [f64],
    f_ext: Option<&'a [Force]>,
    tau: &'a mut [f64],
}

impl Kernel for Rnea<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (step, row) in self.schedule.steps.iter().zip(&mut self.rows[1..]) {
            let q: L = gather(self.q, &step.joints);
            let angle = q.mul_add(L::load(&step.revolute_ratio), L::load(&step.angle_offset));
            let (sin, cos) = sin_cos(angle);
            sin.store(&mut row.sin);
            cos.store(&mut row.cos);
        }
        for (i, step) in self.schedule.steps.iter().enumerate() {
            let (before, rest) = self.rows.split_at_mut(i + 1);
            let Some(row) = rest.first_mut() else { return };
            let rate: L = gather(self.v, &step.joints);
            let rate_change: L = gather(self.a, &step.joints);
            if step.straight {
                outward_straight(step, &before[step.parent_row], row, rate, rate_change);
            } else {
                let q: L = gather(self.q, &step.joints);
                outward(step, before, row, q, rate, rate_change);
            }
        }
        if let Some(f_ext) = self.f_ext {
            self.schedule.for_each_wrench(f_ext, |row, lane, f, n| {
                for k in 0..3 {
                    self.rows[row].f[k].0[lane] -= f[k];
                    self.rows[row].n[k].0[lane] -= n[k];
                }
            });
        }
        for (i, step) in self.schedule.steps.iter().enumerate().rev() {
            let (before, rest) = self.rows.split_at_mut(i + 1);
            let Some(row) = rest.first() else { return };
            let torque = if step.straight {
                inward_straight::<L>(step, &mut before[step.parent_row], row)
            } else {
                inward::<L>(step, before, row)
            };
            for (joint, t) in step.joints.iter().zip(torque.to_array()) {
                self.tau[*joint] += t;
            }
        }
    }
}

/// `U`, from angular velocity and acceleration, by rows.
#[inline(always)]
fn u_matrix<L: Lanes>(w: V3<L>, al: V3<L>) -> M3<L> {
    let (xx, yy, zz) = (w.x * w.x, w.y * w.y, w.z * w.z);
    let (xy, xz, yz) = (w.x * w.y, w.x * w.z, w.y * w.z);
    M3(
        V3::new(-(yy + zz), xy - al.z, xz + al.y),
        V3::new(xy + al.z, -(xx + zz), yz - al.x),
        V3::new(xz - al.y, yz + al.x, -(xx + yy)),
    )
}

/// Stores a row's motion and its own wrench.
#[inline(always)]
fn finish_row<L: Lanes>(step: &Step, row: &mut RneaRow, w: V3<L>, al: V3<L>, a: V3<L>) {
    let (u, f, n) = own_wrench(step, w, al, a);
    w.store(&mut row.omega);
    al.store(&mut row.alpha);
    a.store(&mut row.a);
    u.store(&mut row.u);
    f.store(&mut row.f);
    n.store(&mut row.n);
}

/// `U`, and the wrench that gives four bodies their motion.
#[inline(always)]
fn own_wrench<L: Lanes>(step: &Step, w: V3<L>, al: V3<L>, a: V3<L>) -> (M3<L>, V3<L>, V3<L>) {
    let u = u_matrix(w, al);
    let [m, hx, hy, hz, xx, xy, xz, yy, yz, zz] = &step.inertia;
    let h = V3::new(L::load(hx), L::load(hy), L::load(hz));
    //= F Table 5.1: f_i = I_i a_i + v_i x* I_i v_i: force m a + U h, moment h x a + 2 axial(U S)
    let f = u.mul_add(h, a.scale(L::load(m)));
    let (xy, xz, yz) = (L::load(xy), L::load(xz), L::load(yz));
    let sx = V3::new(L::load(xx), xy, xz);
    let sy = V3::new(xy, L::load(yy), yz);
    let sz = V3::new(xz, yz, L::load(zz));
    let n = V3::new(
        u.2.dot(sy) - u.1.dot(sz),
        u.0.dot(sz) - u.2.dot(sx),
        u.1.dot(sx) - u.0.dot(sy),
    );
    (u, f, h.cross_add(a, n))
}

#[inline(always)]
fn outward_straight<L: Lanes>(
    step: &Step,
    parent: &RneaRow,
    row: &mut RneaRow,
    rate: L,
    rate_change: L,
) {
    let revolute = L::load(&step.revolute_ratio);
    let (rate, rate_change) = (rate * revolute, rate_change * revolute);
    let to_parent = Rotation::<L>::load(step, row);
    let u = M3::load(&parent.u);
    //= F Table 5.1: v_i = iX_lambda v_lambda + S_i dq_i
    //= F Table 5.1: a_i = iX_lambda a_lambda + S_i ddq_i + v_i x S_i dq_i
    let mut w = to_parent.rotate_back(V3::load(&parent.omega));
    let al = to_parent.rotate_back(V3::load(&parent.alpha));
    let a = to_parent.rotate_back(u.mul_add(V3::load(&step.origin), V3::load(&parent.a)));
    let al = V3::new(
        w.y.mul_add(rate, al.x),
        w.x.neg_mul_add(rate, al.y),
        al.z + rate_change,
    );
    w.z = w.z + rate;
    finish_row(step, row, w, al, a);
}

/// A rotation about z, then one about x.
struct Rotation<L> {
    cos_x: L,
    sin_x: L,
    cos: L,
    sin: L,
}

impl<L: Lanes> Rotation<L> {
    #[inline(always)]
    fn load(step: &Step, row: &RneaRow) -> Self {
        Rotation {
            cos_x: L::load(&step.rotation_x[0]),
            sin_x: L::load(&step.rotation_x[1]),
            cos: L::load(&row.cos),
            sin: L::load(&row.sin),
        }
    }
    #[inline(always)]
    fn rotate_back(&self, x: V3<L>) -> V3<L> {
        x.rotate_back_x(self.cos_x, self.sin_x)
            .rotate_back_z(self.cos, self.sin)
    }
    #[inline(always)]
    fn rotate(&self, x: V3<L>) -> V3<L> {
        x.rotate_z(self.cos, self.sin)
            .rotate_x(self.cos_x, self.sin_x)
    }
}

/// Any parents, any kind of joint.
#[inline(always)]
fn outward<L: Lanes>(
    step: &Step,
    before: &[RneaRow],
    row: &mut RneaRow,
    q: L,
    rate: L,
    rate_change: L,
) {
    let (w, al, pa) = parents_motion(step, before);
    let u = u_matrix(w, al);
    let (revolute, prismatic) = (
        L::load(&step.revolute_ratio),
        L::load(&step.prismatic_ratio),
    );
    let rotation = M3::load(&step.rotation);
    let shift = q.mul_add(prismatic, L::load(&step.shift_offset));
    let r = V3::load(&step.origin).add_scaled(shift, rotation.third_column());
    r.store(&mut row.arm);
    let b = u.mul_add(r, pa);
    let (c, s) = (L::load(&row.cos), L::load(&row.sin));
    //= F Table 5.1: v_i = iX_lambda v_lambda + S_i dq_i
    //= F Table 5.1: a_i = iX_lambda a_lambda + S_i ddq_i + v_i x S_i dq_i
    let mut w = rotation.tr_mul(w).rotate_back_z(c, s);
    let al = rotation.tr_mul(al).rotate_back_z(c, s);
    let a = rotation.tr_mul(b).rotate_back_z(c, s);
    let (angular_rate, linear_rate) = (rate * revolute, rate * prismatic);
    let al = V3::new(
        w.y.mul_add(angular_rate, al.x),
        w.x.neg_mul_add(angular_rate, al.y),
        rate_change.mul_add(revolute, al.z),
    );
    w.z = w.z + angular_rate;
    let twice = linear_rate + linear_rate;
    let a = V3::new(
        w.y.mul_add(twice, a.x),
        w.x.neg_mul_add(twice, a.y),
        rate_change.mul_add(prismatic, a.z),
    );
    finish_row(step, row, w, al, a);
}

/// Angular velocity, angular acceleration and acceleration of each lane's parent.
#[inline(always)]
fn parents_motion<L: Lanes>(step: &Step, before: &[RneaRow]) -> (V3<L>, V3<L>, V3<L>) {
    if step.same_lane {
        let parent = &before[step.parent_row];
        return (
            V3::load(&parent.omega),
            V3::load(&parent.alpha),
            V3::load(&parent.a),
        );
    }
    let [a, b, c, d] = step.parents;
    let (a, b, c, d) = (&before[a.0], &before[b.0], &before[c.0], &before[d.0]);
    (
        V3::pick([&a.omega, &b.omega, &c.omega, &d.omega], &step.parents),
        V3::pick([&a.alpha, &b.alpha, &c.alpha, &d.alpha], &step.parents),
        V3::pick([&a.a, &b.a, &c.a, &d.a], &step.parents),
    )
}

/// Torque of the joints of a row, whose wrenches move to their parents.
#[inline(always)]
fn inward_straight<L: Lanes>(step: &Step, parent: &mut RneaRow, row: &RneaRow) -> L {
    let to_parent = Rotation::<L>::load(step, row);
    let n: V3<L> = V3::load(&row.n);
    //= F Table 5.1: tau_i = S_i^T f_i
    //= F Table 5.1: f_lambda = f_lambda + lambdaX*_i f_i
    let torque = n.z * L::load(&step.revolute_ratio);
    let f = to_parent.rotate(V3::load(&row.f));
    let n = to_parent.rotate(n).plus(V3::load(&parent.n));
    V3::load(&step.origin).cross_add(f, n).store(&mut parent.n);
    f.plus(V3::load(&parent.f)).store(&mut parent.f);
    torque
}

#[inline(always)]
fn inward<L: Lanes>(step: &Step, before: &mut [RneaRow], row: &RneaRow) -> L {
    let (c, s) = (L::load(&row.cos), L::load(&row.sin));
    let rotation = M3::load(&step.rotation);
    let (f, n): (V3<L>, V3<L>) = (V3::load(&row.f), V3::load(&row.n));
    //= F Table 5.1: tau_i = S_i^T f_i
    //= F Table 5.1: f_lambda = f_lambda + lambdaX*_i f_i
    let torque = f.z.mul_add(
        L::load(&step.prismatic_ratio),
        n.z * L::load(&step.revolute_ratio),
    );
    let f = rotation.times_vector(f.rotate_z(c, s));
    let n = rotation.times_vector(n.rotate_z(c, s));
    let n = V3::load(&row.arm).cross_add(f, n);
    if step.same_lane {
        let parent = &mut before[step.parent_row];
        f.plus(V3::load(&parent.f)).store(&mut parent.f);
        n.plus(V3::load(&parent.n)).store(&mut parent.n);
        return torque;
    }
    let wrench = [f.x, f.y, f.z, n.x, n.y, n.z];
    scatter_add(wrench, before, &step.parents, wrench_of);
    torque
}

#[inline(always)]
fn wrench_of(row: &mut RneaRow) -> [&mut Pack; 6] {
    let ([fx, fy, fz], [nx, ny, nz]) = (&mut row.f, &mut row.n);
    [fx, fy, fz, nx, ny, nz]
}
