//! Composite rigid bodies for bodies in their order (see `in_order`).

use super::{axis_and_momentum, couple_with_base, own_moments};
use crate::in_order::{
    BodyRow, Group, InOrder, Placement, add_to_parents, of_bodies, place_in_parents,
    rotations_back, to_bodies,
};
use crate::lane_schedule::{LaneSchedule, Step};
use crate::rows::CrbaRow;
use simd::{Kernel, Lanes, Pack, V3, WIDTH};

/// `crba` on bodies in their order; leaves twists, momenta and the root's moments in `rows`, as the
/// limbs side by side do.
pub(super) struct CrbaInOrder<'a> {
    pub(super) schedule: &'a LaneSchedule,
    pub(super) memory: &'a mut InOrder,
    pub(super) rows: &'a mut [CrbaRow],
    pub(super) q: &'a [f64],
    /// True if `memory` holds the bodies' placements at `q` already.
    pub(super) placed: bool,
    pub(super) base_size: usize,
    /// `M` by columns.
    pub(super) m: Option<&'a mut [f64]>,
    pub(super) nv: usize,
}

impl Kernel for CrbaInOrder<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let InOrder {
            parents,
            carriers,
            groups,
            bodies,
        } = self.memory;
        let steps = &self.schedule.steps;
        if !self.placed {
            place::<L>(parents, steps, groups, bodies, self.q);
        }
        let (root, moving) = bodies.split_at_mut(1);
        root[0].sums = [Pack::ZERO; 3];
        let (fours, _) = moving.as_chunks_mut::<WIDTH>();
        for ((step, row), four) in steps.iter().zip(&mut self.rows[1..]).zip(fours) {
            let r = rotations_back::<L>(four).transpose();
            let (p, _) = of_bodies::<L>(four, |b| &b.position);
            // The axes alone are used again.
            let [_, _, zx, _, _, zy, _, _, zz] = &mut row.rotation;
            let z = r.third_column();
            z.x.store(zx);
            z.y.store(zy);
            z.z.store(zz);
            p.store(&mut row.translation);
            let (m, h, [xx, xy, xz, yy, yz, zz]) = own_moments(step, r, p);
            let zero = L::splat(0.0);
            to_bodies([h.x, h.y, h.z, m], four, |b| &mut b.sums[0]);
            to_bodies([xx, xy, xz, yy], four, |b| &mut b.sums[1]);
            to_bodies([yz, zz, zero, zero], four, |b| &mut b.sums[2]);
        }
        //= F Table 6.2: I_lambda^c = I_lambda^c + lambdaX*_i I_i^c iX_lambda (X = 1 in the root's axes)
        add_to_parents::<L, 3>(parents, bodies);
        let (fours, _) = bodies[1..].as_chunks::<WIDTH>();
        for ((step, row), four) in steps.iter().zip(&mut self.rows[1..]).zip(fours) {
            let (h, m) = of_bodies::<L>(four, |b| &b.sums[0]);
            let (s, yy) = of_bodies::<L>(four, |b| &b.sums[1]);
            let (rest, _) = of_bodies::<L>(four, |b| &b.sums[2]);
            m.store(&mut row.mass);
            h.store(&mut row.h);
            simd::store_all([s.x, s.y, s.z, yy, rest.x, rest.y], &mut row.s);
            axis_and_momentum::<L>(step, row);
        }
        keep_root(&bodies[0].sums, &mut self.rows[0]);
        let Some(m) = self.m else { return };
        if self.base_size > 0 {
            for (step, row) in steps.iter().zip(&self.rows[1..]) {
                couple_with_base(step, row, m, self.nv);
            }
        }
        let (base, nv) = (self.base_size, self.nv);
        couple::<L>(carriers, &self.rows[1..], &mut m[base * nv..], base, nv);
        for column in base + 1..nv {
            for row in base..column {
                m[row * nv + column] = m[column * nv + row];
            }
        }
    }
}

/// Placements of all bodies in the root's frame.
#[inline(always)]
fn place<L: Lanes>(
    parents: &[usize],
    steps: &[Step],
    groups: &mut [Group],
    bodies: &mut [BodyRow],
    q: &[f64],
) {
    for (step, group) in steps.iter().zip(groups.iter_mut()) {
        place_in_parents::<L>(step, group, q);
    }
    let mut last = Placement::<L>::load(&bodies[0]);
    for (b, &parent) in parents.iter().enumerate().skip(1) {
        if parent + 1 != b {
            last = Placement::load(&bodies[parent]);
        }
        last = last.child(&groups[(b - 1) / WIDTH], (b - 1) % WIDTH).0;
        last.store(&mut bodies[b]);
    }
}

/// The whole robot's moments, where the limbs side by side leave them.
fn keep_root(sums: &[Pack; 3], root: &mut CrbaRow) {
    let one = |x: f64| Pack([x, 0.0, 0.0, 0.0]);
    let [h, s, rest] = sums;
    root.mass = one(h.0[3]);
    root.h = std::array::from_fn(|k| one(h.0[k]));
    let [yz, zz, ..] = rest.0;
    root.s = [s.0[0], s.0[1], s.0[2], s.0[3], yz, zz].map(one);
}

/// Entries of every joint with itself and those that carry it: its momentum against the twists of
/// four bodies at a time. `m`, by columns, from the joints' first column on.
#[inline(always)]
fn couple<L: Lanes>(carriers: &[Pack], rows: &[CrbaRow], m: &mut [f64], base: usize, nv: usize) {
    let groups = rows.len();
    for (b, column) in m.chunks_exact_mut(nv).enumerate() {
        let (own, lane) = (b / WIDTH, b % WIDTH);
        let splat = |p: &Pack| L::splat(p.0[lane]);
        let [fx, fy, fz, nx, ny, nz] = &rows[own].momentum;
        let f = V3::new(splat(fx), splat(fy), splat(fz));
        let n = V3::new(splat(nx), splat(ny), splat(nz));
        let carriers = &carriers[b * groups..];
        for (group, (row, carriers)) in rows[..=own].iter().zip(carriers).enumerate() {
            let [vx, vy, vz, wx, wy, wz] = &row.twist;
            let v = V3::new(L::load(vx), L::load(vy), L::load(vz));
            let w = V3::new(L::load(wx), L::load(wy), L::load(wz));
            //= F Table 6.2: H_ij = H_ji = F_i^T S_j, j = i and all that carry i
            let products = f.dot_add(v, n.dot(w)) * L::load(carriers);
            products.store_part(&mut column[base + group * WIDTH..]);
        }
    }
}
