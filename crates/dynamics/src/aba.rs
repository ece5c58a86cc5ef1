//! Articulated bodies: the acceleration that joint torques cause (F: R. Featherstone, Rigid Body
//! Dynamics Algorithms, 2008, Table 7.1).
//!
//! Runs on the model's lane schedule, four bodies at a time. Accelerations are those of the
//! origins of lane frames minus gravity; an articulated inertia maps them to a wrench:
//! `f = M a + H^T alpha + p_f`, `n = H a + I alpha + p_n`.

mod by_mass_matrix;

use crate::data::Data;
use crate::kinematics::{base_placement, six};
use crate::lane_schedule::{LaneSchedule, Step};
use crate::model::{Base, Model};
use crate::rows::AbaRow;
use crate::spatial::{Force, Motion};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use simd::{Kernel, Lanes, M3, Pack, V3, WIDTH, gather, run, scatter_add, sin_cos, store_all};

/// `ddq = M^-1 (tau - nle + sum J^T f)` (nv); `f_ext` as in `rnea`.
///
/// Not finite where a joint moves no mass and has no armature.
pub fn aba<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    v: &[f64],
    tau: &[f64],
    f_ext: Option<&[Force]>,
) -> &'d [f64] {
    debug_assert!(q.len() >= model.nq() && v.len() >= model.nv() && tau.len() >= model.nv());
    let nv = model.nv();
    if model.has_mimic() || model.schedule.in_order {
        by_mass_matrix::by_mass_matrix(model, data, q, v, tau, f_ext);
        return &data.ddq[..nv];
    }
    let (bv, bq) = model.base_size();
    for (x, joint) in data.armature.iter_mut().zip(&model.joints) {
        *x = joint.armature;
    }
    let omega = match model.base {
        Base::Fixed => Vector3::zeros(),
        Base::Floating => six(v).angular,
    };
    set_root(&mut data.aba[0], omega);
    let mut kernel = Aba {
        schedule: &model.schedule,
        rows: &mut data.aba,
        q: &q[bq.min(q.len())..],
        v: &v[bv.min(v.len())..],
        tau: &tau[bv.min(tau.len())..],
        armature: &data.armature,
        f_ext,
        ddq: &mut data.ddq[bv..],
        phase: Phase::Inward,
    };
    run(data.instructions, &mut kernel);
    let up = base_placement(model, q).rotation.tr_mul(&-model.gravity);
    let mut root = Motion::new(up, Vector3::zeros());
    if model.base == Base::Floating {
        root = root_acceleration(model, &kernel.rows[0], v, tau, f_ext);
    }
    let all = |x: Vector3<f64>| [x.x, x.y, x.z].map(|x| Pack([x; WIDTH]));
    kernel.rows[0].a = all(root.linear);
    kernel.rows[0].alpha = all(root.angular);
    kernel.phase = Phase::Outward;
    run(data.instructions, &mut kernel);
    if model.base == Base::Floating {
        let v = six(v);
        let a = root.linear - up - v.angular.cross(&v.linear);
        data.ddq[..6].copy_from_slice(&Motion::new(a, root.angular).to_array());
    }
    &data.ddq[..nv]
}

fn set_root(root: &mut AbaRow, omega: Vector3<f64>) {
    *root = AbaRow::default();
    root.omega = [omega.x, omega.y, omega.z].map(|x| Pack([x; WIDTH]));
}

/// Acceleration of a floating base, gravity included, that balances its articulated bias and the
/// six components of `tau`.
fn root_acceleration(
    model: &Model,
    row: &AbaRow,
    v: &[f64],
    tau: &[f64],
    f_ext: Option<&[Force]>,
) -> Motion {
    let sum = |p: &Pack| p.0.iter().sum::<f64>();
    let vector = |p: &[Pack; 3]| Vector3::from(p.each_ref().map(sum));
    let symmetric = |p: &[Pack; 6]| {
        let [xx, xy, xz, yy, yz, zz] = p.each_ref().map(sum);
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    };
    let own = &model.bodies[0].inertia;
    let (c, omega) = (&own.first_moment, six(v).angular);
    let m = symmetric(&row.m) + Matrix3::from_diagonal_element(own.mass);
    let h = Matrix3::from_row_slice(&row.h.each_ref().map(sum)) + c.cross_matrix();
    let i = symmetric(&row.i) + own.rotational;
    let mut inertia = Matrix6::zeros();
    inertia.fixed_view_mut::<3, 3>(0, 0).copy_from(&m);
    inertia.fixed_view_mut::<3, 3>(3, 0).copy_from(&h);
    inertia
        .fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&h.transpose());
    inertia.fixed_view_mut::<3, 3>(3, 3).copy_from(&i);
    let f = vector(&row.f) + omega.cross(&omega.cross(c));
    let n = vector(&row.n) + omega.cross(&(own.rotational * omega));
    let mut wrench = six(tau).to_vector() - Force::new(f, n).to_vector();
    if let Some(f) = f_ext.and_then(|f| f.first()) {
        wrench += f.to_vector();
    }
    //= F Section 9.4: a_0 = (I_0^A)^-1 (f_0 - p_0^A)
    let x = match inertia.cholesky() {
        Some(c) => c.solve(&wrench),
        None => Vector6::repeat(f64::NAN),
    };
    Motion::from_array(x.into())
}

enum Phase {
    /// Velocities, then articulated inertias.
    Inward,
    /// Accelerations.
    Outward,
}

struct Aba<'a> {
    schedule: &'a LaneSchedule,
    rows: &'a mut [AbaRow],
    q: &'a [f64],
    v: &'a [f64],
    tau: &'a [f64],
    armature: &'a [f64],
    f_ext: Option<&'a [Force]>,
    ddq: &'a mut [f64],
    phase: Phase,
}

impl Kernel for &mut Aba<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        match self.phase {
            Phase::Inward => self.inward::<L>(),
            Phase::Outward => self.outward::<L>(),
        }
    }
}

impl Aba<'_> {
    #[inline(always)]
    fn inward<L: Lanes>(&mut self) {
        for (i, step) in self.schedule.steps.iter().enumerate() {
            let (before, rest) = self.rows.split_at_mut(i + 1);
            let Some(row) = rest.first_mut() else { return };
            let (q, rate) = (gather(self.q, &step.joints), gather(self.v, &step.joints));
            velocities::<L>(step, before, row, q, rate);
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
            let Some(row) = rest.first_mut() else { return };
            let tau = gather(self.tau, &step.joints);
            let armature = gather::<L>(self.armature, &step.joints) + L::load(&step.idle);
            articulate::<L>(step, before, row, tau, armature);
        }
    }

    #[inline(always)]
    fn outward<L: Lanes>(&mut self) {
        for (i, step) in self.schedule.steps.iter().enumerate() {
            let (before, rest) = self.rows.split_at_mut(i + 1);
            let Some(row) = rest.first_mut() else { return };
            let ddq = accelerations::<L>(step, before, row).to_array();
            for (joint, x) in step.joints.iter().zip(ddq) {
                self.ddq[*joint] = x;
            }
        }
    }
}

/// Rotation from a row's lane frames to their parents'.
#[derive(Clone, Copy)]
enum Rotation<L> {
    /// About z, then about x.
    Straight { cx: L, sx: L, c: L, s: L },
    /// About z, then the constant rotation.
    General { rotation: M3<L>, c: L, s: L },
}

impl<L: Lanes> Rotation<L> {
    #[inline(always)]
    fn load(step: &Step, row: &AbaRow) -> Self {
        let (c, s) = (L::load(&row.cos), L::load(&row.sin));
        if step.straight {
            let (cx, sx) = (L::load(&step.rotation_x[0]), L::load(&step.rotation_x[1]));
            Rotation::Straight { cx, sx, c, s }
        } else {
            let rotation = M3::load(&step.rotation);
            Rotation::General { rotation, c, s }
        }
    }
    #[inline(always)]
    fn rotate_back(&self, x: V3<L>) -> V3<L> {
        match *self {
            Rotation::Straight { cx, sx, c, s } => x.rotate_back_x(cx, sx).rotate_back_z(c, s),
            Rotation::General { rotation, c, s } => rotation.tr_mul(x).rotate_back_z(c, s),
        }
    }
    #[inline(always)]
    fn rotate(&self, x: V3<L>) -> V3<L> {
        match *self {
            Rotation::Straight { cx, sx, c, s } => x.rotate_z(c, s).rotate_x(cx, sx),
            Rotation::General { rotation, c, s } => rotation.times_vector(x.rotate_z(c, s)),
        }
    }
    #[inline(always)]
    fn rotate_matrix(&self, m: M3<L>) -> M3<L> {
        match *self {
            Rotation::Straight { cx, sx, c, s } => m.rotated_z(c, s).rotated_x(cx, sx),
            Rotation::General { rotation, c, s } => m.rotated_z(c, s).rotated(rotation),
        }
    }
}

/// One vector of each lane's parent.
#[inline(always)]
fn of_parents<L: Lanes>(step: &Step, before: &[AbaRow], part: fn(&AbaRow) -> &[Pack; 3]) -> V3<L> {
    if step.same_lane {
        return V3::load(part(&before[step.parent_row]));
    }
    let [a, b, c, d] = step.parents;
    let rows = [
        part(&before[a.0]),
        part(&before[b.0]),
        part(&before[c.0]),
        part(&before[d.0]),
    ];
    V3::pick(rows, &step.parents)
}

/// Twists, bias accelerations, and the rigid bodies' own inertias and bias wrenches.
#[inline(always)]
fn velocities<L: Lanes>(step: &Step, before: &[AbaRow], row: &mut AbaRow, q: L, rate: L) {
    let (revolute, prismatic) = (
        L::load(&step.revolute_ratio),
        L::load(&step.prismatic_ratio),
    );
    let (sin, cos) = sin_cos(q.mul_add(revolute, L::load(&step.angle_offset)));
    sin.store(&mut row.sin);
    cos.store(&mut row.cos);
    let to_parent = Rotation::<L>::load(step, row);
    let mut arm = V3::load(&step.origin);
    if let Rotation::General { rotation, .. } = to_parent {
        let shift = q.mul_add(prismatic, L::load(&step.shift_offset));
        arm = arm.add_scaled(shift, rotation.third_column());
    }
    arm.store(&mut row.arm);
    let parent = of_parents::<L>(step, before, |r| &r.omega);
    let mut w = to_parent.rotate_back(parent);
    let a = to_parent.rotate_back(parent.cross(parent.cross(arm)));
    let (angular_rate, linear_rate) = (rate * revolute, rate * prismatic);
    let twice = linear_rate + linear_rate;
    let (wx, wy) = (w.x, w.y);
    //= F Table 7.1: c_i = v_i x v_J, here with iX_lambda (omega x (omega x r)): a_i is of the origin
    V3::new(wy.mul_add(twice, a.x), wx.neg_mul_add(twice, a.y), a.z).store(&mut row.bias_a);
    V3::new(wy * angular_rate, -(wx * angular_rate), L::splat(0.0)).store(&mut row.bias_alpha);
    w.z = w.z + angular_rate;
    w.store(&mut row.omega);
    let [m, hx, hy, hz, s @ ..] = &step.inertia;
    let h = V3::new(L::load(hx), L::load(hy), L::load(hz));
    let s = M3::<L>::load_symmetric(s);
    //= F Table 7.1: I_i^A = I_i; p_i^A = v_i x* I_i v_i - f_i^x
    w.cross(w.cross(h)).store(&mut row.f);
    // omega × (I omega) with I = trace 1 - S
    s.times_vector(w).cross(w).store(&mut row.n);
    let (zero, m) = (L::splat(0.0), L::load(m));
    store_all([m, zero, zero, m, zero, m], &mut row.m);
    M3(
        V3::new(zero, -h.z, h.y),
        V3::new(h.z, zero, -h.x),
        V3::new(-h.y, h.x, zero),
    )
    .store(&mut row.h);
    store_all(s.trace_minus().upper(), &mut row.i);
}

/// Articulated inertia and bias of a row, passed to the parents.
#[inline(always)]
fn articulate<L: Lanes>(step: &Step, before: &mut [AbaRow], row: &mut AbaRow, tau: L, armature: L) {
    let (t, s) = (
        L::load(&step.revolute_ratio),
        L::load(&step.prismatic_ratio),
    );
    let (m, h, i) = (
        M3::load_symmetric(&row.m),
        M3::load(&row.h),
        M3::load_symmetric(&row.i),
    );
    let (f, n) = (V3::load(&row.f), V3::load(&row.n));
    //= F Table 7.1: U_i = I_i^A S_i
    let (mut u_f, mut u_n) = (h.2.scale(t), i.2.scale(t));
    if !step.straight {
        u_f = u_f.add_scaled(s, m.2);
        u_n = u_n.add_scaled(s, h.third_column());
    }
    //= F Table 7.1: D_i = S_i^T U_i (plus the armature)
    //= F Table 7.1: u_i = tau_i - S_i^T p_i^A
    let d = t.mul_add(u_n.z, s.mul_add(u_f.z, armature));
    let inverse_d = d.recip();
    let u = t.neg_mul_add(n.z, s.neg_mul_add(f.z, tau));
    u_f.store(&mut row.u_f);
    u_n.store(&mut row.u_n);
    inverse_d.store(&mut row.inverse_d);
    u.store(&mut row.u);

    //= F Table 7.1: I_i^a = I_i^A - U_i D_i^-1 U_i^T
    let (over_f, over_n) = (u_f.scale(inverse_d), u_n.scale(inverse_d));
    let m = m.sub_outer(over_f, u_f);
    let h = h.sub_outer(over_n, u_f);
    let i = i.sub_outer(over_n, u_n);
    let (a, alpha) = (V3::load(&row.bias_a), V3::load(&row.bias_alpha));
    //= F Table 7.1: p_i^a = p_i^A + I_i^a c_i + U_i D_i^-1 u_i
    let f = m.mul_add(a, f).plus(h.tr_mul(alpha)).add_scaled(u, over_f);
    let n = h
        .mul_add(a, n)
        .plus(i.times_vector(alpha))
        .add_scaled(u, over_n);

    let to_parent = Rotation::<L>::load(step, row);
    let r = V3::load(&row.arm);
    //= F Table 7.1: I_lambda^A = I_lambda^A + lambdaX*_i I_i^a iX_lambda
    //= F Table 7.1: p_lambda^A = p_lambda^A + lambdaX*_i p_i^a
    let (m, h, i) = (
        to_parent.rotate_matrix(m),
        to_parent.rotate_matrix(h),
        to_parent.rotate_matrix(i),
    );
    let f = to_parent.rotate(f);
    let n = r.cross_add(f, to_parent.rotate(n));
    let moved = h.plus(m.cross_columns(r));
    // I + [r] H^T - (H + [r] M) [r]
    let i = i
        .plus(h.transpose().cross_columns(r))
        .plus(moved.transpose().cross_columns(r).transpose());
    add_to_parents(step, before, [m, moved, i], f, n);
}

/// Adds articulated inertias and biases to those of the parents.
#[inline(always)]
fn add_to_parents<L: Lanes>(
    step: &Step,
    before: &mut [AbaRow],
    [m, h, i]: [M3<L>; 3],
    f: V3<L>,
    n: V3<L>,
) {
    if step.same_lane {
        let parent = &mut before[step.parent_row];
        let sum = m.plus(M3::load_symmetric(&parent.m));
        store_all(sum.upper(), &mut parent.m);
        h.plus(M3::load(&parent.h)).store(&mut parent.h);
        let sum = i.plus(M3::load_symmetric(&parent.i));
        store_all(sum.upper(), &mut parent.i);
        f.plus(V3::load(&parent.f)).store(&mut parent.f);
        n.plus(V3::load(&parent.n)).store(&mut parent.n);
        return;
    }
    let places = &step.parents;
    scatter_add(m.upper(), before, places, |r| r.m.each_mut());
    let h = [
        h.0.x, h.0.y, h.0.z, h.1.x, h.1.y, h.1.z, h.2.x, h.2.y, h.2.z,
    ];
    scatter_add(h, before, places, |r| r.h.each_mut());
    scatter_add(i.upper(), before, places, |r| r.i.each_mut());
    scatter_add([f.x, f.y, f.z], before, places, |r| r.f.each_mut());
    scatter_add([n.x, n.y, n.z], before, places, |r| r.n.each_mut());
}

/// Accelerations of a row's joints, and of its bodies.
#[inline(always)]
fn accelerations<L: Lanes>(step: &Step, before: &[AbaRow], row: &mut AbaRow) -> L {
    let to_parent = Rotation::<L>::load(step, row);
    let alpha = of_parents::<L>(step, before, |r| &r.alpha);
    let a = of_parents::<L>(step, before, |r| &r.a);
    //= F Table 7.1: a'_i = iX_lambda a_lambda + c_i; a_i = a'_i + S_i ddq_i
    //= F Table 7.1: ddq_i = D_i^-1 (u_i - U_i^T a'_i)
    let a = alpha.cross_add(V3::load(&row.arm), a);
    let mut a = to_parent.rotate_back(a).plus(V3::load(&row.bias_a));
    let mut alpha = to_parent.rotate_back(alpha).plus(V3::load(&row.bias_alpha));
    let u = L::load(&row.u) - V3::load(&row.u_f).dot(a) - V3::load(&row.u_n).dot(alpha);
    let ddq = u * L::load(&row.inverse_d);
    a.z = ddq.mul_add(L::load(&step.prismatic_ratio), a.z);
    alpha.z = ddq.mul_add(L::load(&step.revolute_ratio), alpha.z);
    a.store(&mut row.a);
    alpha.store(&mut row.alpha);
    ddq
}
