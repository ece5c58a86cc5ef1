//! Composite rigid bodies for bodies in their order (see `in_order`).

use super::{axis_and_momentum, couple_with_base, own_moments};
use crate::in_order::{BodyRow, Group, InOrder, Placement, placements, rotate_in_parents, row_of};
use crate::lane_schedule::{LaneSchedule, Step};
use crate::rows::CrbaRow;
use simd::{Kernel, Lanes, Pack, V3, WIDTH};

/// `crba` on bodies in their order; leaves twists, momenta and the root's moments in `rows`, as the
/// limbs side by side do.
pub(super) struct CrbaInOrder<'a, const GROUPS: usize, const ARM: bool> {
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

impl<const GROUPS: usize, const ARM: bool> Kernel for CrbaInOrder<'_, GROUPS, ARM> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (Some(steps), Some(groups), Some(rows)) = (
            self.schedule.steps.first_chunk::<GROUPS>(),
            self.memory.groups.first_chunk_mut::<GROUPS>(),
            self.rows[1..].first_chunk_mut::<GROUPS>(),
        ) else {
            return;
        };
        if !self.placed {
            let (root, parents) = (&self.memory.root, &self.memory.parents);
            place::<L, GROUPS, ARM>(steps, groups, root, parents, self.q);
        }
        for g in (0..GROUPS).rev() {
            let (before, later) = groups.split_at_mut(g + 1);
            let (group, row) = (&mut before[g], &mut rows[g]);
            let (rotation, position) = placements::<L>(&group.rows);
            // The axes alone are used again.
            let [_, _, zx, _, _, zy, _, _, zz] = &mut row.rotation;
            let z = rotation.third_column();
            z.x.store(zx);
            z.y.store(zy);
            z.z.store(zz);
            position.store(&mut row.translation);
            let (m, h, [xx, xy, xz, yy, yz, zz]) = own_moments(&steps[g], rotation, position);
            let own = [m, h.x, h.y, h.z, xx, xy, xz, yy, yz, zz];
            //= F Table 6.2: I_lambda^c = I_lambda^c + lambdaX*_i I_i^c iX_lambda (X = 1 in the root's axes)
            let [m, hx, hy, hz, s @ ..] = group.add_carried::<L, 10, ARM>(own, later);
            m.store(&mut row.mass);
            simd::store_all([hx, hy, hz], &mut row.h);
            simd::store_all(s, &mut row.s);
            axis_and_momentum::<L>(&steps[g], row);
        }
        if self.base_size > 0 {
            keep_root(&self.memory.of_root(), &mut self.rows[0]);
        }
        let Some(m) = self.m else { return };
        if self.base_size > 0 {
            for (step, row) in steps.iter().zip(&self.rows[1..]) {
                couple_with_base(step, row, m, self.nv);
            }
        }
        let (base, nv) = (self.base_size, self.nv);
        couple::<L>(
            &self.memory.carriers,
            &self.rows[1..],
            &mut m[base * nv..],
            base,
            nv,
        );
        for column in base + 1..nv {
            for row in base..column {
                m[row * nv + column] = m[column * nv + row];
            }
        }
    }
}

/// Places all bodies in the root's frame.
#[inline(always)]
fn place<L: Lanes, const GROUPS: usize, const ARM: bool>(
    steps: &[Step; GROUPS],
    groups: &mut [Group; GROUPS],
    root: &BodyRow,
    parents: &[usize],
    q: &[f64],
) {
    for (step, group) in steps.iter().zip(groups.iter_mut()) {
        rotate_in_parents::<L, ARM>(step, group, q);
    }
    let mut last = Placement::<L>::load(root);
    for g in 0..GROUPS {
        for lane in 0..WIDTH {
            let b = g * WIDTH + lane + 1;
            let Some(&parent) = parents.get(b) else {
                return;
            };
            if !ARM && parent + 1 != b {
                last = Placement::load(row_of(root, groups, parent));
            }
            last = last.child::<ARM>(&groups[g], lane).0;
            last.store(&mut groups[g].rows[lane]);
        }
    }
}

/// The whole robot's moments, where the limbs side by side leave them.
fn keep_root(sums: &[f64; 10], root: &mut CrbaRow) {
    let [m, hx, hy, hz, s @ ..] = sums.map(|x| Pack([x, 0.0, 0.0, 0.0]));
    (root.mass, root.h, root.s) = (m, [hx, hy, hz], s);
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
