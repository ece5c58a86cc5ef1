//! Recursive Newton-Euler: the joint torques of a motion.
//!
//! Runs on the model's plan, four bodies at a time. The acceleration of a point `r` of a body is
//! `a + U r` with `U = [alpha] + [omega][omega]`; with the second moments `S = ∫ r r^T dm` the net
//! moment about the origin is `h × a + 2 axial(U S)`, with `h` the first moment (Khalil and Dombre,
//! Modeling, Identification and Control of Robots, 9.5).

use crate::data::Data;
use crate::kinematics::{at, base_placement, six};
use crate::lanes::{Kernel, Lanes, Pack, V3, WIDTH, run, sin_cos};
use crate::model::{Base, Model};
use crate::plan::{Plan, Step};
use crate::spatial::Force;
use nalgebra::Vector3;

/// `tau = M(q) a + nle(q, v) - sum J^T f` (nv).
///
/// `f_ext`: wrenches that the environment applies to each body, in the body's frame, one per body
/// (body 0 included). Does not touch what the forward kinematics computed.
pub fn rnea<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    v: &[f64],
    a: &[f64],
    f_ext: Option<&[Force]>,
) -> &'d [f64] {
    let (bv, bq) = model.base_size();
    debug_assert!(q.len() >= model.nq() && v.len() >= model.nv() && a.len() >= model.nv());
    set_root(model, &mut data.rnea[0], q, v, a);
    let tail = |x: &'_ [f64], n: usize| n.min(x.len())..x.len();
    let kernel = Rnea {
        plan: &model.plan,
        rows: &mut data.rnea,
        q: &q[tail(q, bq)],
        v: &v[tail(v, bv)],
        a: &a[tail(a, bv)],
        f_ext,
        tau: &mut data.tau[bv..],
    };
    run(data.instructions, kernel);
    for (i, joint) in model.joints.iter().enumerate() {
        data.tau[bv + i] += joint.armature * at(a, bv + i);
    }
    let nv = model.nv();
    if model.base == Base::Floating {
        finish_root(model, data, f_ext);
    }
    &data.tau[..nv]
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

/// Motion and wrench of four bodies, in their plan frames.
#[derive(Clone, Debug)]
pub(crate) struct RneaRow {
    omega: [Pack; 3],
    alpha: [Pack; 3],
    /// Of the origin, minus gravity.
    a: [Pack; 3],
    /// `U`, by rows.
    u: [Pack; 9],
    /// Wrench of the joint, moment about the origin.
    f: [Pack; 3],
    n: [Pack; 3],
    cos: Pack,
    sin: Pack,
    /// Origin in the parent's plan frame, where a joint may slide.
    arm: [Pack; 3],
}

impl RneaRow {
    pub(crate) const ZERO: RneaRow = RneaRow {
        omega: [Pack::ZERO; 3],
        alpha: [Pack::ZERO; 3],
        a: [Pack::ZERO; 3],
        u: [Pack::ZERO; 9],
        f: [Pack::ZERO; 3],
        n: [Pack::ZERO; 3],
        cos: Pack::ZERO,
        sin: Pack::ZERO,
        arm: [Pack::ZERO; 3],
    };
}

/// The root's motion, in all lanes; gravity enters as if the base accelerated upwards.
fn set_root(model: &Model, root: &mut RneaRow, q: &[f64], v: &[f64], a: &[f64]) {
    let all = |x: Vector3<f64>| [x.x, x.y, x.z].map(|x| Pack([x; WIDTH]));
    root.f = [Pack::ZERO; 3];
    root.n = [Pack::ZERO; 3];
    let mut linear = -model.gravity;
    let (mut omega, mut alpha) = (Vector3::zeros(), Vector3::zeros());
    if model.base == Base::Floating {
        let (v, a) = (six(v), six(a));
        (omega, alpha) = (v.angular, a.angular);
        let up = base_placement(model, q).rotation.tr_mul(&linear);
        linear = up + a.linear + omega.cross(&v.linear);
    }
    root.omega = all(omega);
    root.alpha = all(alpha);
    root.a = all(linear);
    let w = omega.cross_matrix();
    let u = alpha.cross_matrix() + w * w;
    root.u = std::array::from_fn(|k| Pack([u[(k / 3, k % 3)]; WIDTH]));
}

/// Adds the root's own wrench and what its children left in the lanes.
fn finish_root(model: &Model, data: &mut Data, f_ext: Option<&[Force]>) {
    let root = &data.rnea[0];
    let one = |p: &[Pack; 3]| Vector3::from(p.each_ref().map(|p| p.0[0]));
    let sum = |p: &[Pack; 3]| Vector3::from(p.each_ref().map(|p| p.0.iter().sum()));
    let (omega, alpha, a) = (one(&root.omega), one(&root.alpha), one(&root.a));
    let inertia = &model.bodies[0].inertia;
    let h = &inertia.first_moment;
    let f = a * inertia.mass + alpha.cross(h) + omega.cross(&omega.cross(h));
    let n = inertia.rotational * alpha + omega.cross(&(inertia.rotational * omega)) + h.cross(&a);
    let mut total = Force::new(f + sum(&root.f), n + sum(&root.n));
    if let Some(f) = f_ext.and_then(|f| f.first()) {
        total -= *f;
    }
    data.tau[..6].copy_from_slice(&total.to_array());
}

struct Rnea<'a> {
    plan: &'a Plan,
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
        for (step, row) in self.plan.steps.iter().zip(&mut self.rows[1..]) {
            let q: L = gather(self.q, &step.joints);
            let angle = q.mul_add(L::load(&step.turning), L::load(&step.angle_offset));
            let (sin, cos) = sin_cos(angle);
            sin.store(&mut row.sin);
            cos.store(&mut row.cos);
        }
        for (i, step) in self.plan.steps.iter().enumerate() {
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
            subtract_external(self.plan, self.rows, f_ext);
        }
        self.tau.fill(0.0);
        for (i, step) in self.plan.steps.iter().enumerate().rev() {
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

/// Components of four joints; zero for idle lanes.
#[inline(always)]
fn gather<L: Lanes>(x: &[f64], joints: &[usize; WIDTH]) -> L {
    L::set(joints.map(|j| x.get(j).copied().unwrap_or(0.0)))
}

/// `U`, from angular velocity and acceleration, by rows.
#[inline(always)]
fn u_matrix<L: Lanes>(w: V3<L>, al: V3<L>) -> [V3<L>; 3] {
    let (xx, yy, zz) = (w.x * w.x, w.y * w.y, w.z * w.z);
    let (xy, xz, yz) = (w.x * w.y, w.x * w.z, w.y * w.z);
    [
        V3::new(-(yy + zz), xy - al.z, xz + al.y),
        V3::new(xy + al.z, -(xx + zz), yz - al.x),
        V3::new(xz - al.y, yz + al.x, -(xx + yy)),
    ]
}

/// Stores a row's motion and its own wrench.
#[inline(always)]
fn finish_row<L: Lanes>(step: &Step, row: &mut RneaRow, w: V3<L>, al: V3<L>, a: V3<L>) {
    let u = u_matrix(w, al);
    w.store(&mut row.omega);
    al.store(&mut row.alpha);
    a.store(&mut row.a);
    for (r, u) in u.iter().enumerate() {
        u.x.store(&mut row.u[3 * r]);
        u.y.store(&mut row.u[3 * r + 1]);
        u.z.store(&mut row.u[3 * r + 2]);
    }
    let [m, hx, hy, hz, xx, xy, xz, yy, yz, zz] = step.inertia.each_ref().map(|p| L::load(p));
    let h = V3::new(hx, hy, hz);
    let f = V3::new(
        m.mul_add(a.x, u[0].dot(h)),
        m.mul_add(a.y, u[1].dot(h)),
        m.mul_add(a.z, u[2].dot(h)),
    );
    f.store(&mut row.f);
    let (sx, sy, sz) = (
        V3::new(xx, xy, xz),
        V3::new(xy, yy, yz),
        V3::new(xz, yz, zz),
    );
    let n = V3::new(
        u[2].dot(sy) - u[1].dot(sz),
        u[0].dot(sz) - u[2].dot(sx),
        u[1].dot(sx) - u[0].dot(sy),
    );
    h.cross_add(a, n).store(&mut row.n);
}

#[inline(always)]
fn outward_straight<L: Lanes>(
    step: &Step,
    parent: &RneaRow,
    row: &mut RneaRow,
    rate: L,
    rate_change: L,
) {
    let turning = L::load(&step.turning);
    let (rate, rate_change) = (rate * turning, rate_change * turning);
    let (cx, sx) = (L::load(&step.turn_x[0]), L::load(&step.turn_x[1]));
    let (c, s) = (L::load(&row.cos), L::load(&row.sin));
    let r = V3::load(&step.origin);
    let u = |k: usize| {
        V3::new(
            L::load(&parent.u[3 * k]),
            L::load(&parent.u[3 * k + 1]),
            L::load(&parent.u[3 * k + 2]),
        )
    };
    let pa: V3<L> = V3::load(&parent.a);
    let b = V3::new(pa.x + u(0).dot(r), pa.y + u(1).dot(r), pa.z + u(2).dot(r));
    let back = |x: V3<L>| x.turn_back_x(cx, sx).turn_back_z(c, s);
    let mut w = back(V3::load(&parent.omega));
    let mut al = back(V3::load(&parent.alpha));
    let a = back(b);
    al = V3::new(
        w.y.mul_add(rate, al.x),
        w.x.neg_mul_add(rate, al.y),
        al.z + rate_change,
    );
    w.z = w.z + rate;
    finish_row(step, row, w, al, a);
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
    let (w, al, pa) = if step.same_lane {
        let parent = &before[step.parent_row];
        (
            V3::load(&parent.omega),
            V3::load(&parent.alpha),
            V3::load(&parent.a),
        )
    } else {
        let get = |part: fn(&RneaRow) -> &[Pack; 3]| {
            let lanes = step
                .parents
                .map(|(r, l)| part(&before[r]).each_ref().map(|p| p.0[l]));
            let [x, y, z] = [0, 1, 2].map(|k| L::set(lanes.map(|v| v[k])));
            V3::new(x, y, z)
        };
        (get(|r| &r.omega), get(|r| &r.alpha), get(|r| &r.a))
    };
    let u = u_matrix(w, al);
    let (turning, sliding) = (L::load(&step.turning), L::load(&step.sliding));
    let columns = columns::<L>(step);
    let shift = q.mul_add(sliding, L::load(&step.shift_offset));
    let r = V3::load(&step.origin).add_scaled(shift, columns[2]);
    r.store(&mut row.arm);
    let b = V3::new(pa.x + u[0].dot(r), pa.y + u[1].dot(r), pa.z + u[2].dot(r));
    let (c, s) = (L::load(&row.cos), L::load(&row.sin));
    let back = |x: V3<L>| {
        V3::new(x.dot(columns[0]), x.dot(columns[1]), x.dot(columns[2])).turn_back_z(c, s)
    };
    let (mut w, mut al, mut a) = (back(w), back(al), back(b));
    let (turn_rate, slide_rate) = (rate * turning, rate * sliding);
    al = V3::new(
        w.y.mul_add(turn_rate, al.x),
        w.x.neg_mul_add(turn_rate, al.y),
        rate_change.mul_add(turning, al.z),
    );
    w.z = w.z + turn_rate;
    let twice = slide_rate + slide_rate;
    a = V3::new(
        w.y.mul_add(twice, a.x),
        w.x.neg_mul_add(twice, a.y),
        rate_change.mul_add(sliding, a.z),
    );
    finish_row(step, row, w, al, a);
}

/// Columns of the constant rotation.
#[inline(always)]
fn columns<L: Lanes>(step: &Step) -> [V3<L>; 3] {
    let m = step.rotation.each_ref().map(|p| L::load(p));
    [0, 1, 2].map(|k| V3::new(m[k], m[3 + k], m[6 + k]))
}

/// Torque of the joints of a row, whose wrenches move to their parents.
#[inline(always)]
fn inward_straight<L: Lanes>(step: &Step, parent: &mut RneaRow, row: &RneaRow) -> L {
    let (cx, sx) = (L::load(&step.turn_x[0]), L::load(&step.turn_x[1]));
    let (c, s) = (L::load(&row.cos), L::load(&row.sin));
    let n: V3<L> = V3::load(&row.n);
    let torque = n.z * L::load(&step.turning);
    let turn = |x: V3<L>| x.turn_z(c, s).turn_x(cx, sx);
    let f = turn(V3::load(&row.f));
    let n = turn(n).add(V3::load(&parent.n));
    V3::load(&step.origin).cross_add(f, n).store(&mut parent.n);
    f.add(V3::load(&parent.f)).store(&mut parent.f);
    torque
}

#[inline(always)]
fn inward<L: Lanes>(step: &Step, before: &mut [RneaRow], row: &RneaRow) -> L {
    let (c, s) = (L::load(&row.cos), L::load(&row.sin));
    let columns = columns::<L>(step);
    let (f, n): (V3<L>, V3<L>) = (V3::load(&row.f), V3::load(&row.n));
    let torque =
        f.z.mul_add(L::load(&step.sliding), n.z * L::load(&step.turning));
    let turn = |x: V3<L>| {
        let x = x.turn_z(c, s);
        columns[0]
            .scale(x.x)
            .add_scaled(x.y, columns[1])
            .add_scaled(x.z, columns[2])
    };
    let (f, n) = (turn(f), turn(n));
    let n = V3::load(&row.arm).cross_add(f, n);
    if step.same_lane {
        let parent = &mut before[step.parent_row];
        f.add(V3::load(&parent.f)).store(&mut parent.f);
        n.add(V3::load(&parent.n)).store(&mut parent.n);
        return torque;
    }
    let f = [f.x.to_array(), f.y.to_array(), f.z.to_array()];
    let n = [n.x.to_array(), n.y.to_array(), n.z.to_array()];
    for (lane, (parent_row, l)) in step.parents.iter().enumerate() {
        let parent = &mut before[*parent_row];
        for k in 0..3 {
            parent.f[k].0[*l] += f[k][lane];
            parent.n[k].0[*l] += n[k][lane];
        }
    }
    torque
}

/// Moves external wrenches into plan frames and subtracts them.
#[inline(always)]
fn subtract_external(plan: &Plan, rows: &mut [RneaRow], f_ext: &[Force]) {
    let places = plan.place.iter().zip(&plan.to_body).zip(f_ext);
    for (((row, lane), to_body), f) in places.skip(1) {
        let (linear, angular) = (to_body.tr_mul(&f.linear), to_body.tr_mul(&f.angular));
        for k in 0..3 {
            rows[*row].f[k].0[*lane] -= linear[k];
            rows[*row].n[k].0[*lane] -= angular[k];
        }
    }
}
