//! Composite rigid bodies: the joint-space mass matrix (F: R. Featherstone, Rigid Body Dynamics
//! Algorithms, 2008, Table 6.2).
//!
//! Inertias and joint axes are expressed at the root's origin, in its axes: there composites are
//! sums, and an entry of `M` is the product of an axis with the momentum of another.

mod in_order;

use crate::data::Data;
use crate::in_order::sized;
use crate::lane_schedule::{LaneSchedule, NOWHERE, Step};
use crate::model::{Base, Model};
use crate::rows::CrbaRow;
use crate::spatial::{Inertia, Motion};
use nalgebra::{DMatrix, Matrix3, Vector3};
use simd::{Kernel, Lanes, M3, Pack, V3, gather, run, scatter_add, sin_cos, store_all};

/// `M(q)` (nv × nv), symmetric, armature included.
pub fn crba<'d>(model: &Model, data: &'d mut Data, q: &[f64]) -> &'d DMatrix<f64> {
    mass_matrix(model, data, q, false)
}

/// `placed`: bodies in their order stand where `rnea` has placed them at `q`.
pub(crate) fn mass_matrix<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    placed: bool,
) -> &'d DMatrix<f64> {
    let (bv, bq) = model.base_size();
    debug_assert!(q.len() >= model.nq());
    let q = &q[bq.min(q.len())..];
    if model.schedule.in_order {
        sized!(data.in_order, run_in_order(model, data, q, placed));
    } else {
        let kernel = Crba {
            schedule: &model.schedule,
            rows: &mut data.crba,
            q,
            floating: model.base == Base::Floating,
            m: entries(model, &mut data.mass_matrix),
            nv: model.nv(),
        };
        run(data.instructions, kernel);
    }
    let m = &mut data.mass_matrix;
    if !model.schedule.lists_ancestors {
        fill_by_hand(model, &data.crba, m);
    }
    for (i, joint) in model.joints.iter().enumerate() {
        m[(bv + i, bv + i)] += joint.armature;
    }
    if model.base == Base::Floating {
        let root = root_inertia(&data.crba[0], &model.bodies[0].inertia);
        for k in 0..6 {
            let mut unit = [0.0; 6];
            unit[k] = 1.0;
            let f = root.mul_motion(Motion::from_array(unit)).to_array();
            m.view_mut((0, k), (6, 1)).copy_from_slice(&f);
        }
    }
    &data.mass_matrix
}

/// Entries that the kernels fill, by columns. Joints that others mimic add up, and ancestors may be too
/// many to list: those are filled by hand.
fn entries<'m>(model: &Model, m: &'m mut DMatrix<f64>) -> Option<&'m mut [f64]> {
    (model.schedule.lists_ancestors).then(|| m.as_mut_slice())
}

/// `CrbaInOrder` with `GROUPS` groups.
fn run_in_order<const GROUPS: usize, const ARM: bool>(
    model: &Model,
    data: &mut Data,
    q: &[f64],
    placed: bool,
) {
    let kernel = in_order::CrbaInOrder::<GROUPS, ARM> {
        schedule: &model.schedule,
        memory: &mut data.in_order,
        rows: &mut data.crba,
        q,
        placed,
        base_size: model.base_size().0,
        m: entries(model, &mut data.mass_matrix),
        nv: model.nv(),
    };
    run(data.instructions, kernel);
}

/// Composite inertia of the whole robot, at the root.
fn root_inertia(root: &CrbaRow, own: &Inertia) -> Inertia {
    let sum = |p: &Pack| p.0.iter().sum::<f64>();
    let [xx, xy, xz, yy, yz, zz] = root.s.each_ref().map(sum);
    let s = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let children = Inertia {
        mass: sum(&root.mass),
        first_moment: Vector3::from(root.h.each_ref().map(sum)),
        rotational: Matrix3::from_diagonal_element(s.trace()) - s,
    };
    children + *own
}

struct Crba<'a> {
    schedule: &'a LaneSchedule,
    rows: &'a mut [CrbaRow],
    q: &'a [f64],
    floating: bool,
    /// `M` by columns.
    m: Option<&'a mut [f64]>,
    nv: usize,
}

impl Kernel for Crba<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let steps = &self.schedule.steps;
        let rows = self.rows;
        for (i, step) in steps.iter().enumerate() {
            let (before, rest) = rows.split_at_mut(i + 1);
            let Some(row) = rest.first_mut() else { return };
            outward::<L>(step, before, row, gather(self.q, &step.joints));
        }
        let root = &mut rows[0];
        (root.mass, root.h, root.s) = (Pack::ZERO, [Pack::ZERO; 3], [Pack::ZERO; 6]);
        for (i, step) in steps.iter().enumerate().rev() {
            let (before, rest) = rows.split_at_mut(i + 1);
            let Some(row) = rest.first_mut() else { return };
            axis_and_momentum::<L>(step, row);
            inward::<L>(step, before, row);
        }
        if let Some(m) = self.m {
            for (i, step) in steps.iter().enumerate() {
                if self.floating {
                    couple_with_base(step, &rows[i + 1], m, self.nv);
                }
                couple_with_ancestors::<L>(step, rows, i + 1, m);
            }
        }
    }
}

/// Placement in the root's frame, and the body's own inertia there.
#[inline(always)]
fn outward<L: Lanes>(step: &Step, before: &[CrbaRow], row: &mut CrbaRow, q: L) {
    let angle = q.mul_add(L::load(&step.revolute_ratio), L::load(&step.angle_offset));
    let (sin, cos) = sin_cos(angle);
    let (parent, origin) = if step.same_lane {
        let parent = &before[step.parent_row];
        (M3::load(&parent.rotation), V3::load(&parent.translation))
    } else {
        let [a, b, c, d] = step.parents;
        let (a, b, c, d) = (&before[a.0], &before[b.0], &before[c.0], &before[d.0]);
        let rotations = [&a.rotation, &b.rotation, &c.rotation, &d.rotation];
        let origins = [
            &a.translation,
            &b.translation,
            &c.translation,
            &d.translation,
        ];
        (
            M3::pick(rotations, &step.parents),
            V3::pick(origins, &step.parents),
        )
    };
    let arm = V3::load(&step.origin);
    let (r, p) = if step.straight {
        let (cx, sx) = (L::load(&step.rotation_x[0]), L::load(&step.rotation_x[1]));
        (
            parent.times_rotation_x(cx, sx).times_rotation_z(cos, sin),
            parent.mul_add(arm, origin),
        )
    } else {
        let rotation = M3::load(&step.rotation);
        let shift = q.mul_add(L::load(&step.prismatic_ratio), L::load(&step.shift_offset));
        let arm = arm.add_scaled(shift, rotation.third_column());
        (
            parent.times(rotation).times_rotation_z(cos, sin),
            parent.mul_add(arm, origin),
        )
    };
    r.store(&mut row.rotation);
    p.store(&mut row.translation);
    let (m, h, s) = own_moments(step, r, p);
    m.store(&mut row.mass);
    h.store(&mut row.h);
    store_all(s, &mut row.s);
}

/// Mass, first and second moments of four bodies at the root, from placements in its frame.
#[inline(always)]
fn own_moments<L: Lanes>(step: &Step, r: M3<L>, p: V3<L>) -> (L, V3<L>, [L; 6]) {
    let [m, hx, hy, hz, s @ ..] = &step.inertia;
    let m = L::load(m);
    let h = r.times_vector(V3::new(L::load(hx), L::load(hy), L::load(hz)));
    let at_root = h.add_scaled(m, p);
    let s = M3::load_symmetric(s);
    // S + h p^T + p (h + m p)^T
    let s = s.rotated(r);
    let s = s.add_outer(h, p).add_outer(p, at_root).upper();
    (m, at_root, s)
}

/// Twist of the joint for unit speed, and the momentum that it gives the sub-tree.
#[inline(always)]
fn axis_and_momentum<L: Lanes>(step: &Step, row: &mut CrbaRow) {
    let z = M3::<L>::load(&row.rotation).third_column();
    let p = V3::load(&row.translation);
    let w = z.scale(L::load(&step.revolute_ratio));
    let v = p.cross_add(w, z.scale(L::load(&step.prismatic_ratio)));
    let h = V3::load(&row.h);
    let s = M3::load_symmetric(&row.s);
    //= F Table 6.2: F_i = I_i^c S_i
    let f = w.cross_add(h, v.scale(L::load(&row.mass)));
    let n = h.cross_add(v, s.trace_minus().times_vector(w));
    store_all([v.x, v.y, v.z, w.x, w.y, w.z], &mut row.twist);
    store_all([f.x, f.y, f.z, n.x, n.y, n.z], &mut row.momentum);
}

/// Adds sub-trees to those of their parents.
#[inline(always)]
fn inward<L: Lanes>(step: &Step, before: &mut [CrbaRow], row: &CrbaRow) {
    //= F Table 6.2: I_lambda^c = I_lambda^c + lambdaX*_i I_i^c iX_lambda (X = 1 in the root's axes)
    if step.same_lane {
        let parent = &mut before[step.parent_row];
        add::<L>(&row.mass, &mut parent.mass);
        for (x, to) in row.h.iter().zip(&mut parent.h) {
            add::<L>(x, to);
        }
        for (x, to) in row.s.iter().zip(&mut parent.s) {
            add::<L>(x, to);
        }
        return;
    }
    let ([hx, hy, hz], [xx, xy, xz, yy, yz, zz]) = (&row.h, &row.s);
    let all = [
        L::load(&row.mass),
        L::load(hx),
        L::load(hy),
        L::load(hz),
        L::load(xx),
        L::load(xy),
        L::load(xz),
        L::load(yy),
        L::load(yz),
        L::load(zz),
    ];
    scatter_add(all, before, &step.parents, moments_of);
}

#[inline(always)]
fn moments_of(row: &mut CrbaRow) -> [&mut Pack; 10] {
    let ([hx, hy, hz], [xx, xy, xz, yy, yz, zz]) = (&mut row.h, &mut row.s);
    [&mut row.mass, hx, hy, hz, xx, xy, xz, yy, yz, zz]
}

#[inline(always)]
fn add<L: Lanes>(x: &Pack, to: &mut Pack) {
    (L::load(x) + L::load(to)).store(to);
}

/// Entries of the base's six components with the joints of a row: the momenta.
#[inline(always)]
fn couple_with_base(step: &Step, row: &CrbaRow, m: &mut [f64], nv: usize) {
    for (lane, column) in step.columns.iter().enumerate() {
        if *column == NOWHERE {
            continue;
        }
        let momentum = row.momentum.each_ref().map(|p| p.0[lane]);
        if let Some(six) = m.get_mut(column * nv..column * nv + 6) {
            six.copy_from_slice(&momentum);
        }
        for (k, x) in momentum.iter().enumerate() {
            if let Some(entry) = m.get_mut(k * nv + column) {
                *entry = *x;
            }
        }
    }
}

/// Entries of the joints of a row with themselves and their ancestors.
#[inline(always)]
fn couple_with_ancestors<L: Lanes>(step: &Step, rows: &[CrbaRow], own: usize, m: &mut [f64]) {
    let [fx, fy, fz, nx, ny, nz] = &rows[own].momentum;
    let f = V3::new(L::load(fx), L::load(fy), L::load(fz));
    let n = V3::new(L::load(nx), L::load(ny), L::load(nz));
    for level in &step.ancestors {
        let (v, w): (V3<L>, V3<L>) = match level.same_lane {
            Some(row) => {
                let [vx, vy, vz, wx, wy, wz] = &rows[row].twist;
                (
                    V3::new(L::load(vx), L::load(vy), L::load(vz)),
                    V3::new(L::load(wx), L::load(wy), L::load(wz)),
                )
            }
            None => {
                let [a, b, c, d] = level.places;
                let (a, b) = (&rows[a.0].twist, &rows[b.0].twist);
                let (c, d) = (&rows[c.0].twist, &rows[d.0].twist);
                V3::pick_pair([a, b, c, d], &level.places)
            }
        };
        //= F Table 6.2: H_ij = H_ji = F_i^T S_j, j = i and all that carry i
        let products = f.dot_add(v, n.dot(w)).to_array();
        for entries in &level.entries {
            for (entry, x) in entries.iter().zip(&products) {
                if let Some(entry) = m.get_mut(*entry) {
                    *entry = *x;
                }
            }
        }
    }
}

/// Entry by entry; bodies that share a joint add up.
fn fill_by_hand(model: &Model, rows: &[CrbaRow], m: &mut DMatrix<f64>) {
    let base = model.base_size().0;
    m.fill(0.0);
    let of = |b: usize, part: fn(&CrbaRow) -> &[Pack; 6]| {
        let (row, lane) = model.schedule.place[b];
        part(&rows[row]).each_ref().map(|p| p.0[lane])
    };
    for (i, body) in model.bodies.iter().enumerate().skip(1) {
        let (column, f) = (base + body.joint, of(i, |r| &r.momentum));
        if base > 0 {
            for (k, x) in f.iter().enumerate() {
                m[(k, column)] += *x;
                m[(column, k)] += *x;
            }
        }
        let mut k = i;
        while k > 0 {
            let twist = of(k, |r| &r.twist);
            let x: f64 = f.iter().zip(twist).map(|(f, t)| f * t).sum();
            let row = base + model.bodies[k].joint;
            m[(row, column)] += x;
            if k != i {
                m[(column, row)] += x;
            }
            k = model.bodies[k].parent;
        }
    }
}
