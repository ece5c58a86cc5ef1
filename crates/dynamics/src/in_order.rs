//! Bodies in their order, four at a time: for robots with too few limbs to fill the lanes.
//!
//! Only placements, motions and sums of wrenches depend on neighbours. They go from body to body,
//! the three components of a vector in the lanes of one register; everything else (sines, bodies' own
//! wrenches and inertias, joint torques) is computed for four bodies side by side. Between the two,
//! registers are transposed. (Closures and iterators over registers would leave the instruction set.) All vectors are in the root's axes: a limb's wrenches then add up.

use crate::body::Body;
use crate::lane_schedule::Step;
use simd::{Lanes, M3, Pack, V3, WIDTH, gather, sin_cos, store_all};

/// Four bodies, in their lane frames or in the root's axes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Group {
    /// Rotation from the lane frame to the parent's, by rows.
    pub(crate) rotation: [Pack; 9],
    /// Origin in the parent's lane frame.
    pub(crate) origin: [Pack; 3],
    /// Joint motion: angular velocity and acceleration, linear velocity and acceleration.
    pub(crate) rates: [Pack; 4],
    /// Twist of the joint for unit speed, linear first, at the root's origin in its axes.
    pub(crate) twist: [Pack; 6],
}

/// One body in the root's axes: vectors by component, the fourth lane zero.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BodyRow {
    /// Columns of the rotation from the lane frame.
    pub(crate) columns: [Pack; 3],
    pub(crate) position: Pack,
    pub(crate) omega: Pack,
    pub(crate) alpha: Pack,
    /// Of the origin, minus gravity.
    pub(crate) a: Pack,
    /// Sums over the body's sub-tree: wrench about the root's origin, or moments of its mass.
    pub(crate) sums: [Pack; 3],
}

/// Memory of the algorithms, and the tree.
#[derive(Clone, Debug)]
pub(crate) struct InOrder {
    /// Parent of each body.
    pub(crate) parents: Vec<usize>,
    /// For each body but the root, by groups: one where a body is the body itself or carries it.
    pub(crate) carriers: Vec<Pack>,
    pub(crate) groups: Vec<Group>,
    /// The root first; a multiple of four after it.
    pub(crate) bodies: Vec<BodyRow>,
}

impl InOrder {
    /// For `bodies`, the root among them.
    pub(crate) fn new(bodies: &[Body]) -> Self {
        let parents: Vec<usize> = bodies.iter().map(|b| b.parent).collect();
        let moving = bodies.len().saturating_sub(1);
        let groups = moving.div_ceil(WIDTH);
        let mut carriers = vec![Pack::ZERO; moving * groups];
        for (b, row) in carriers.chunks_mut(groups.max(1)).enumerate() {
            let mut k = b + 1;
            while k > 0 {
                row[(k - 1) / WIDTH].0[(k - 1) % WIDTH] = 1.0;
                k = parents[k];
            }
        }
        let mut bodies = vec![BodyRow::default(); 1 + groups * WIDTH];
        for (k, column) in bodies[0].columns.iter_mut().enumerate() {
            column.0[k] = 1.0;
        }
        Self {
            parents,
            carriers,
            groups: vec![Group::default(); groups],
            bodies,
        }
    }
}

/// A body's placement in registers.
#[derive(Clone, Copy)]
pub(crate) struct Placement<L> {
    pub(crate) columns: [L; 3],
    pub(crate) position: L,
}

impl<L: Lanes> Placement<L> {
    #[inline(always)]
    pub(crate) fn load(body: &BodyRow) -> Self {
        let [x, y, z] = &body.columns;
        Self {
            columns: [L::load(x), L::load(y), L::load(z)],
            position: L::load(&body.position),
        }
    }
    #[inline(always)]
    pub(crate) fn store(&self, body: &mut BodyRow) {
        store_all(self.columns, &mut body.columns);
        self.position.store(&mut body.position);
    }
    /// A vector of this frame, lane `lane` of `v`, in the root's axes.
    #[inline(always)]
    fn rotate(&self, v: [&Pack; 3], lane: usize) -> L {
        let ([x, y, z], lane) = (self.columns, lane % WIDTH);
        let sum = y.mul_add(L::splat(v[1].0[lane]), x * L::splat(v[0].0[lane]));
        z.mul_add(L::splat(v[2].0[lane]), sum)
    }
    /// The child in a lane of a group, and its origin from this one's.
    #[inline(always)]
    pub(crate) fn child(&self, group: &Group, lane: usize) -> (Self, L) {
        let [a, b, c, d, e, f, g, h, i] = &group.rotation;
        let [x, y, z] = &group.origin;
        let arm = self.rotate([x, y, z], lane);
        let child = Self {
            columns: [
                self.rotate([a, d, g], lane),
                self.rotate([b, e, h], lane),
                self.rotate([c, f, i], lane),
            ],
            position: self.position + arm,
        };
        (child, arm)
    }
}

/// Numbers of four bodies' joints.
#[inline(always)]
pub(crate) fn of_joints<L: Lanes>(x: &[f64], step: &Step) -> L {
    match step.first_joint.and_then(|first| x.get(first..)) {
        Some(x) => L::load_part(x),
        None => gather(x, &step.joints),
    }
}

/// Adds to numbers of four bodies' joints.
#[inline(always)]
pub(crate) fn add_to_joints<L: Lanes>(numbers: L, x: &mut [f64], step: &Step) {
    match step.first_joint.and_then(|first| x.get_mut(first..)) {
        Some(x) => (L::load_part(x) + numbers).store_part(x),
        None => {
            for (joint, number) in step.joints.iter().zip(numbers.to_array()) {
                x[*joint] += number;
            }
        }
    }
}

/// Rotations and origins of four bodies in their parents' frames.
#[inline(always)]
pub(crate) fn place_in_parents<L: Lanes>(step: &Step, group: &mut Group, q: &[f64]) {
    let q: L = gather(q, &step.joints);
    let angle = q.mul_add(L::load(&step.revolute_ratio), L::load(&step.angle_offset));
    let (sin, cos) = sin_cos(angle);
    let rotation = M3::<L>::load(&step.rotation);
    rotation
        .times_rotation_z(cos, sin)
        .store(&mut group.rotation);
    let shift = q.mul_add(L::load(&step.prismatic_ratio), L::load(&step.shift_offset));
    let origin = V3::load(&step.origin).add_scaled(shift, rotation.third_column());
    origin.store(&mut group.origin);
}

/// One vector of four bodies, by component, and the fourth component.
#[inline(always)]
pub(crate) fn of_bodies<L: Lanes>(
    bodies: &[BodyRow; WIDTH],
    part: fn(&BodyRow) -> &Pack,
) -> (V3<L>, L) {
    let [a, b, c, d] = bodies;
    let [x, y, z, w] = L::load_transposed([part(a), part(b), part(c), part(d)]);
    (V3::new(x, y, z), w)
}

/// Rotations of four bodies, by rows, from the lane frames to the root's axes, transposed.
#[inline(always)]
pub(crate) fn rotations_back<L: Lanes>(bodies: &[BodyRow; WIDTH]) -> M3<L> {
    let (x, _) = of_bodies::<L>(bodies, |b| &b.columns[0]);
    let (z, _) = of_bodies::<L>(bodies, |b| &b.columns[2]);
    M3(x, z.cross(x), z)
}

/// Stores four numbers of four bodies as one register of each.
#[inline(always)]
pub(crate) fn to_bodies<L: Lanes>(
    numbers: [L; WIDTH],
    bodies: &mut [BodyRow; WIDTH],
    part: fn(&mut BodyRow) -> &mut Pack,
) {
    let [a, b, c, d] = L::transpose(numbers);
    let [to_a, to_b, to_c, to_d] = bodies;
    a.store(part(to_a));
    b.store(part(to_b));
    c.store(part(to_c));
    d.store(part(to_d));
}

/// Adds the first `N` sums of every body to those of the bodies that carry it.
#[inline(always)]
pub(crate) fn add_to_parents<L: Lanes, const N: usize>(parents: &[usize], bodies: &mut [BodyRow]) {
    let mut sum = [L::splat(0.0); N];
    for b in (1..parents.len()).rev() {
        let mut k = 0;
        while k < N {
            sum[k] = sum[k] + L::load(&bodies[b].sums[k]);
            sum[k].store(&mut bodies[b].sums[k]);
            k += 1;
        }
        // A chain's sum stays in registers.
        let parent = parents[b];
        if parent + 1 != b {
            add(&sum, &mut bodies[parent]);
            sum = [L::splat(0.0); N];
        }
    }
    add(&sum, &mut bodies[0]);
}

#[inline(always)]
fn add<L: Lanes, const N: usize>(sum: &[L; N], to: &mut BodyRow) {
    let mut k = 0;
    while k < N {
        (sum[k] + L::load(&to.sums[k])).store(&mut to.sums[k]);
        k += 1;
    }
}
