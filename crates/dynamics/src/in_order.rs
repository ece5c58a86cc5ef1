//! Bodies in their order, four at a time: for robots with too few limbs to fill the lanes.
//!
//! Placements and motions alone go from body to body, the three components of a vector in the lanes of
//! one register. All else is computed for four bodies side by side, and wrenches or moments of mass add
//! up inward across the lanes. Between the two, registers are transposed. (Closures and
//! iterators over registers would leave the instruction set.) All vectors are in the root's axes, wrenches
//! and moments about its origin: a limb's add up without being moved.

use crate::body::Body;
use crate::lane_schedule::{LaneSchedule, Step, split_rotations};
use crate::spatial::Force;
use nalgebra::Vector3;
use simd::{Lanes, M3, Pack, V3, WIDTH, gather, load_all, sin_cos};

/// Four bodies: their constants, their place in the tree, and what is computed of them.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// Centre of mass in the lane frame.
    pub(crate) center: [Pack; 3],
    /// Rotational inertia about the centre, in the lane frame's axes: xx xy xz yy yz zz.
    pub(crate) rotational: [Pack; 6],
    /// One where a body carries the one that is one, two, three lanes further on.
    down: [Pack; 3],
    /// Bodies of later groups whose parents are in this one: groups further on, lane; and one where a
    /// body carries them.
    after: Vec<(usize, usize, Pack)>,
    /// Of each body, in all lanes: third column of the rotation from its lane frame to the parent's, and
    /// its origin there.
    links: [[[Pack; 3]; 2]; WIDTH],
    /// First and second columns of these rotations; or, of an arm, cosine and sine of the angle about
    /// `z`, which comes after the one about `x`.
    columns: [[Pack; 3]; 2],
    /// Of the angle about `z` after that about `x`.
    angle_offset: Pack,
    /// Of prismatic joints, along `z`.
    shift: Pack,
    /// Joints' angular velocity and acceleration, and linear ones.
    pub(crate) rates: [Pack; 4],
    pub(crate) rows: [BodyRow; WIDTH],
    /// Of each body and all that it carries: wrench (force first), or moments of mass.
    pub(crate) sums: [Pack; 10],
    /// External wrench, force first, in the lane frame.
    pub(crate) external: [Pack; 6],
}

fn ones(there: [bool; WIDTH]) -> Pack {
    Pack(there.map(|t| if t { 1.0 } else { 0.0 }))
}

/// One body in the root's axes: vectors by component, the fourth lane zero.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BodyRow {
    /// First and third columns of the rotation from the lane frame.
    x: Pack,
    z: Pack,
    position: Pack,
    pub(crate) omega: Pack,
    pub(crate) alpha: Pack,
    /// Of the origin, minus gravity.
    pub(crate) a: Pack,
}

/// Memory of the algorithms, and the tree.
#[derive(Clone, Debug, Default)]
pub(crate) struct InOrder {
    /// Parent of each body.
    pub(crate) parents: Vec<usize>,
    /// True if each body carries the next by a revolute joint of its own, and their frames are those of
    /// Denavit and Hartenberg: then the algorithms' `ARM`.
    pub(crate) arm: bool,
    /// For each body but the root, by groups: one where a body is the body itself or carries it.
    pub(crate) carriers: Vec<Pack>,
    pub(crate) root: BodyRow,
    pub(crate) groups: Vec<Group>,
}

/// Calls a function that is generic over the number of groups and `ARM`, with those of a memory.
macro_rules! sized {
    ($memory:expr, $function:ident($($argument:expr),*)) => {
        match ($memory.groups.len(), $memory.arm) {
            (1, true) => $function::<1, true>($($argument),*),
            (2, true) => $function::<2, true>($($argument),*),
            (3, true) => $function::<3, true>($($argument),*),
            (1, false) => $function::<1, false>($($argument),*),
            (2, false) => $function::<2, false>($($argument),*),
            _ => $function::<3, false>($($argument),*),
        }
    };
}
pub(crate) use sized;

impl InOrder {
    /// For `bodies`: the root, then each followed by all that it carries.
    pub(crate) fn new(bodies: &[Body], schedule: &LaneSchedule) -> Self {
        let parents: Vec<usize> = bodies.iter().map(|b| b.parent).collect();
        let steps = &schedule.steps;
        let tree = Tree { parents: &parents };
        let group = |(index, step)| Group::new(&tree, index, step);
        let of = |b: usize| {
            (0..steps.len()).map(move |g| {
                ones(
                    tree.bodies(g)
                        .map(|c| c.is_some_and(|c| tree.carries(c, b))),
                )
            })
        };
        let mut root = BodyRow::default();
        (root.x.0[0], root.z.0[2]) = (1.0, 1.0);
        let moving = || bodies.iter().enumerate().skip(1);
        let serial = moving().all(|(b, body)| {
            let own = body.joint == b - 1 && body.ratio == 1.0;
            body.parent == b - 1 && own && body.kind.is_revolute()
        });
        let mut new = Self {
            arm: serial
                && (1..parents.len() - 1).all(|b| steps[b / WIDTH].turns_about_x(b % WIDTH)),
            carriers: (1..parents.len()).flat_map(of).collect(),
            root,
            groups: steps.iter().enumerate().map(group).collect(),
            parents,
        };
        if new.arm {
            new.turn_root(&steps[0]);
        }
        new
    }

    /// Turns the root's columns so that the first joint, too, turns about their `z` from there.
    fn turn_root(&mut self, first: &Step) {
        let rotation = first.rotation_of(0);
        for (k, x) in rotation.column(0).iter().enumerate() {
            (self.root.x.0[k], self.root.z.0[k]) = (*x, rotation[(k, 2)]);
        }
        let group = &mut self.groups[0];
        let origin = rotation.tr_mul(&Vector3::from(first.origin.each_ref().map(|p| p.0[0])));
        group.angle_offset.0[0] = first.angle_offset.0[0];
        group.links[0] = [[0.0, 0.0, 1.0], origin.into()].map(|v| v.map(|x| Pack([x; WIDTH])));
    }

    /// Wrench of the root's children, where `sums` are wrenches.
    pub(crate) fn wrench_of_root(&self) -> Force {
        let [fx, fy, fz, nx, ny, nz, ..] = self.of_root();
        Force::new(Vector3::new(fx, fy, fz), Vector3::new(nx, ny, nz))
    }

    /// Sums of the root's children.
    pub(crate) fn of_root(&self) -> [f64; 10] {
        let children = (1..self.parents.len()).filter(|b| self.parents[*b] == 0);
        let mut sums = [0.0; 10];
        for b in children.map(|b| b - 1) {
            for (sum, own) in sums.iter_mut().zip(&self.groups[b / WIDTH].sums) {
                *sum += own.0[b % WIDTH];
            }
        }
        sums
    }
}

/// Who carries whom. The root is body 0; group `g` begins with body `4 g + 1`.
#[derive(Clone, Copy)]
struct Tree<'a> {
    parents: &'a [usize],
}

impl Tree<'_> {
    fn bodies(&self, group: usize) -> [Option<usize>; WIDTH] {
        let body = |lane| group * WIDTH + lane + 1;
        std::array::from_fn(|lane| Some(body(lane)).filter(|b| *b < self.parents.len()))
    }
    /// Row (group + 1, the root's is 0) and lane.
    fn place(&self, body: usize) -> (usize, usize) {
        match body.checked_sub(1) {
            Some(b) => (1 + b / WIDTH, b % WIDTH),
            None => (0, 0),
        }
    }
    /// True if `carrier` is `body` or carries it.
    fn carries(&self, carrier: usize, mut body: usize) -> bool {
        while body > carrier {
            body = self.parents[body];
        }
        body == carrier
    }
}

impl Group {
    fn new(tree: &Tree, group: usize, step: &Step) -> Self {
        let (bodies, row, parents) = (tree.bodies(group), group + 1, tree.parents);
        let inside = |body: usize| tree.place(body).0 == row;
        let further = |lanes: usize| {
            let carried = |l: usize| Some((bodies[l]?, *bodies.get(l + lanes)?.as_ref()?));
            let carries = |l| carried(l).is_some_and(|(c, b)| tree.carries(c, b));
            ones(std::array::from_fn(carries))
        };
        let later = (row * WIDTH + 1..parents.len()).filter(|b| inside(parents[*b]));
        let after = later.map(|b| {
            let carry = bodies.map(|c| c.is_some_and(|c| tree.carries(c, b)));
            let (row, lane) = tree.place(b);
            (row - group - 2, lane, ones(carry))
        });
        let mut new = Self {
            center: [Pack::ZERO; 3],
            rotational: [Pack::ZERO; 6],
            down: [1, 2, 3].map(further),
            after: after.collect(),
            links: [[[Pack::ZERO; 3]; 2]; WIDTH],
            columns: [[Pack::ZERO; 3]; 2],
            angle_offset: step.angle_offset,
            shift: Pack::ZERO,
            rates: [Pack::ZERO; 4],
            rows: [BodyRow::default(); WIDTH],
            sums: [Pack::ZERO; 10],
            external: [Pack::ZERO; 6],
        };
        for lane in 0..WIDTH {
            new.set_inertia(step, lane);
            let (_, about_z) = split_rotations(&step.rotation_of(lane));
            new.angle_offset.0[lane] += about_z[(1, 0)].atan2(about_z[(0, 0)]);
            let all = |p: &Pack| Pack([p.0[lane]; WIDTH]);
            let [_, _, xz, _, _, yz, _, _, zz] = &step.rotation;
            new.links[lane] = [[xz, yz, zz].map(all), step.origin.each_ref().map(all)];
        }
        new
    }

    /// From moments about the origin; without mass, the centre is the origin.
    fn set_inertia(&mut self, step: &Step, lane: usize) {
        let [m, hx, hy, hz, second @ ..] = step.inertia.each_ref().map(|p| p.0[lane]);
        let h = [hx, hy, hz];
        let c = h.map(|h| if m == 0.0 { 0.0 } else { h / m });
        let places = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        let s: [f64; 6] = std::array::from_fn(|k| second[k] - h[places[k].0] * c[places[k].1]);
        for (k, (i, j)) in places.into_iter().enumerate() {
            let trace = if i == j { s[0] + s[3] + s[5] } else { 0.0 };
            self.rotational[k].0[lane] = trace - s[k];
        }
        for (pack, c) in self.center.iter_mut().zip(c) {
            pack.0[lane] = c;
        }
    }

    /// Adds to `x` of each body that of all that it carries, and keeps it as the first `N` sums; `later`:
    /// the groups after this one, which have done so.
    #[inline(always)]
    pub(crate) fn add_carried<L: Lanes, const N: usize, const ARM: bool>(
        &mut self,
        x: [L; N],
        later: &[Group],
    ) -> [L; N] {
        let mut sum = [L::splat(0.0); N];
        let mut k = 0;
        if ARM {
            while k < N {
                let two = x[k] + x[k].down_one();
                sum[k] = two + two.down_two();
                if let Some(next) = later.first() {
                    sum[k] = sum[k] + L::splat(next.sums[k].0[0]);
                }
                k += 1;
            }
        } else {
            let [one, two, three] = load_all::<L, 3>(&self.down);
            while k < N {
                let (by_one, by_two) = (x[k].down_one(), x[k].down_two());
                let by_three = by_two.down_one();
                sum[k] = by_three.mul_add(three, by_two.mul_add(two, by_one.mul_add(one, x[k])));
                k += 1;
            }
            for (group, lane, carry) in &self.after {
                let (carried, carry) = (&later[*group].sums, L::load(carry));
                let mut k = 0;
                while k < N {
                    sum[k] = L::splat(carried[k].0[*lane % WIDTH]).mul_add(carry, sum[k]);
                    k += 1;
                }
            }
        }
        let mut k = 0;
        while k < N {
            sum[k].store(&mut self.sums[k]);
            k += 1;
        }
        sum
    }
}

/// A body's placement in registers.
#[derive(Clone, Copy)]
pub(crate) struct Placement<L> {
    pub(crate) columns: [L; 3],
    position: L,
}

impl<L: Lanes> Placement<L> {
    #[inline(always)]
    pub(crate) fn load(body: &BodyRow) -> Self {
        let (x, z) = (L::load(&body.x), L::load(&body.z));
        Self {
            columns: [x, z.cross_in_lanes(x), z],
            position: L::load(&body.position),
        }
    }
    #[inline(always)]
    pub(crate) fn store(&self, body: &mut BodyRow) {
        let [x, _, z] = self.columns;
        x.store(&mut body.x);
        z.store(&mut body.z);
        self.position.store(&mut body.position);
    }
    /// `b` and a vector of this frame, its components in all lanes, in the root's axes.
    #[inline(always)]
    fn rotate_add(&self, v: &[Pack; 3], b: L) -> L {
        let ([x, y, z], [vx, vy, vz]) = (self.columns, v);
        let sum = y.mul_add(L::load(vy), x.mul_add(L::load(vx), b));
        z.mul_add(L::load(vz), sum)
    }
    /// A vector of this frame, lane `lane` of `v`, in the root's axes.
    #[inline(always)]
    fn rotate(&self, v: &[Pack; 3], lane: usize) -> L {
        let [x, y, z] = self.columns;
        let sum = y.mul_add(L::splat(v[1].0[lane]), x * L::splat(v[0].0[lane]));
        z.mul_add(L::splat(v[2].0[lane]), sum)
    }
    /// The child in a lane of a group, and its origin from this one's.
    #[inline(always)]
    pub(crate) fn child<const ARM: bool>(&self, group: &Group, lane: usize) -> (Self, L) {
        let ([axis, origin], [x, y]) = (&group.links[lane], &group.columns);
        let zero = L::splat(0.0);
        let mut arm = self.rotate_add(origin, zero);
        let columns = if ARM {
            let [_, minus_sin, cos] = load_all::<L, 3>(axis);
            let [_, own_y, own_z] = self.columns;
            let turned = minus_sin.neg_mul_add(own_z, cos * own_y);
            let z = minus_sin.mul_add(own_y, cos * own_z);
            let (cos, sin) = (L::splat(x[0].0[lane]), L::splat(x[1].0[lane]));
            let x = sin.mul_add(turned, cos * self.columns[0]);
            [x, cos.mul_add(turned, -(sin * self.columns[0])), z]
        } else {
            let z = self.rotate_add(axis, zero);
            arm = z.mul_add(L::splat(group.shift.0[lane]), arm);
            [self.rotate(x, lane), self.rotate(y, lane), z]
        };
        let position = self.position + arm;
        (Self { columns, position }, arm)
    }
}

/// The row of a body, the root's included.
#[inline(always)]
pub(crate) fn row_of<'a>(root: &'a BodyRow, groups: &'a [Group], body: usize) -> &'a BodyRow {
    match body.checked_sub(1) {
        Some(b) => &groups[b / WIDTH].rows[b % WIDTH],
        None => root,
    }
}

/// Rotations and shifts of four bodies in their parents' frames.
#[inline(always)]
pub(crate) fn rotate_in_parents<L: Lanes, const ARM: bool>(
    step: &Step,
    group: &mut Group,
    q: &[f64],
) {
    let q: L = of_joints(q, step);
    let [to_x, to_y] = &mut group.columns;
    if ARM {
        let (sin, cos) = sin_cos(q + L::load(&group.angle_offset));
        cos.store(&mut to_x[0]);
        sin.store(&mut to_x[1]);
        return;
    }
    let angle = q.mul_add(L::load(&step.revolute_ratio), L::load(&step.angle_offset));
    let (sin, cos) = sin_cos(angle);
    let [a, b, _, c, d, _, e, f, _] = &step.rotation;
    let x = V3::<L>::new(L::load(a), L::load(c), L::load(e));
    let y = V3::new(L::load(b), L::load(d), L::load(f));
    x.scale(cos).add_scaled(sin, y).store(to_x);
    y.scale(cos).sub_scaled(sin, x).store(to_y);
    let shift = q.mul_add(L::load(&step.prismatic_ratio), L::load(&step.shift_offset));
    shift.store(&mut group.shift);
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

/// One vector of each of four bodies.
#[inline(always)]
pub(crate) fn of_bodies<L: Lanes>(bodies: &[BodyRow; WIDTH], part: fn(&BodyRow) -> &Pack) -> V3<L> {
    let [a, b, c, d] = bodies;
    let [x, y, z, _] = L::load_transposed([part(a), part(b), part(c), part(d)]);
    V3::new(x, y, z)
}

/// Rotations from the lane frames and origins of four bodies, in the root's frame.
#[inline(always)]
pub(crate) fn placements<L: Lanes>(bodies: &[BodyRow; WIDTH]) -> (M3<L>, V3<L>) {
    let x = of_bodies::<L>(bodies, |b| &b.x);
    let z = of_bodies::<L>(bodies, |b| &b.z);
    let rotation = M3(x, z.cross(x), z).transpose();
    (rotation, of_bodies(bodies, |b| &b.position))
}
