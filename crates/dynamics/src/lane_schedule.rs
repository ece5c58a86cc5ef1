//! The model compiled for four lanes: the order in which bodies are computed side by side, and
//! their constants.
//!
//! Each body gets a lane frame: its own origin, `z` along its joint axis, rotated about `z` so
//! that the frame of its first child differs by one rotation about the common normal (Denavit and
//! Hartenberg). Bodies are scheduled in steps of four, parents before children, the longest limbs
//! first. A limb stays in its lane, so that most steps take each lane's parent from the same lane
//! of an earlier step ([`Step::straight`]); the others gather.

use crate::body::Body;
use crate::spatial::{Force, Se3};
use nalgebra::{Matrix3, Rotation3, Vector3};
use simd::{Pack, Places, WIDTH};

/// Four bodies side by side; a lane may be idle.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Step {
    /// True if every lane's parent is in the same lane of `parent_row`, the frames differ by a rotation
    /// about x only, and every joint is revolute.
    pub(crate) straight: bool,
    /// True if every lane's parent is in the same lane of `parent_row`.
    pub(crate) same_lane: bool,
    /// Row of the parents, where `same_lane`; row 0 is the root, in all lanes.
    pub(crate) parent_row: usize,
    /// Row and lane of each lane's parent.
    pub(crate) parents: Places,
    /// One where a lane is idle.
    pub(crate) idle: Pack,
    /// Index of each lane's joint, or `joint_count` where idle.
    pub(crate) joints: [usize; WIDTH],
    /// The first lane's joint, where those of the other lanes follow it and idle lanes come after the
    /// last joint.
    pub(crate) first_joint: Option<usize>,
    /// Cosine and sine of the rotation about x, where `straight`.
    pub(crate) rotation_x: [Pack; 2],
    /// Rotation from the lane frame, at angle zero, to the parent's, by rows; where not `straight`.
    pub(crate) rotation: [Pack; 9],
    /// Origin in the parent's lane frame.
    pub(crate) origin: [Pack; 3],
    /// `angle = revolute_ratio q + angle_offset`.
    pub(crate) revolute_ratio: Pack,
    /// See `revolute_ratio`.
    pub(crate) angle_offset: Pack,
    /// `shift = prismatic_ratio q + shift_offset`.
    pub(crate) prismatic_ratio: Pack,
    /// See `prismatic_ratio`.
    pub(crate) shift_offset: Pack,
    /// Mass, first moment, and second moments about the origin (xx xy xz yy yz zz), in the
    /// lane frame.
    pub(crate) inertia: [Pack; 10],
    /// Inertia that the motors of the lanes' own joints add (`Joint::armature`).
    pub(crate) armature: Pack,
    /// Columns of the lanes' joints in `M`, or `NOWHERE`.
    pub(crate) columns: [usize; WIDTH],
    /// The bodies themselves, their parents and so on up to the root's children, where listed.
    pub(crate) ancestors: Vec<Ancestors>,
}

impl Step {
    /// From the lane frame, at angle zero, to the parent's.
    pub(crate) fn rotation_of(&self, lane: usize) -> Matrix3<f64> {
        Matrix3::from_fn(|row, column| self.rotation[3 * row + column].0[lane])
    }
    /// True if that is one rotation about x, then one about z.
    pub(crate) fn turns_about_x(&self, lane: usize) -> bool {
        turns_about_x(&self.rotation_of(lane))
    }
}

/// Index of an absent entry: beyond the end of any matrix.
pub(crate) const NOWHERE: usize = usize::MAX;

/// An ancestor of each lane's body, and the entries of `M` that couple the two.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ancestors {
    /// The row in which each ancestor is in its descendant's lane, where there is one.
    pub(crate) same_lane: Option<usize>,
    pub(crate) places: Places,
    /// Indices in `M`, by columns, of both entries; `NOWHERE` for lanes without such an ancestor.
    pub(crate) entries: [[usize; WIDTH]; 2],
}

/// See the module.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct LaneSchedule {
    pub(crate) steps: Vec<Step>,
    /// Row (step + 1; the root's is 0) and lane of each body.
    pub(crate) place: Vec<(usize, usize)>,
    /// Rotation from each body's lane frame to its own.
    pub(crate) to_body: Vec<Matrix3<f64>>,
    /// True if rows are bodies in their order (see `in_order`); else limbs stand side by side.
    pub(crate) in_order: bool,
    /// False where joints are mimicked or a limb is so long that lists of ancestors fill the memory.
    pub(crate) lists_ancestors: bool,
}

/// Bodies in their order where limbs side by side would fill less than this share of the lanes. Not
/// for more than `MOST_IN_ORDER` bodies: forward dynamics is cubic in their number, and loses more to
/// rounding than the recursion where light bodies hang on heavy ones.
const FILLED: f64 = 0.6;
const MOST_IN_ORDER: usize = 10;
/// Most groups of four bodies in order (see `sized` in in_order.rs).
const MOST_GROUPS: usize = 3;
const _: () = assert!(MOST_IN_ORDER <= MOST_GROUPS * WIDTH);
/// Lists of ancestors of all rows together.
const MOST_ANCESTORS: usize = 20_000;

/// Parts of a model from which its schedule is made.
#[derive(Clone, Copy)]
pub(crate) struct Skeleton<'a> {
    /// The root first, each after its parent.
    pub(crate) bodies: &'a [Body],
    /// Independent joints; fewer than bodies that move where some joint follows another.
    pub(crate) joint_count: usize,
    /// Components of `v` before the joints'.
    pub(crate) base_size: usize,
}

impl LaneSchedule {
    pub(crate) fn new(model: Skeleton) -> LaneSchedule {
        let first_child = first_children(model.bodies);
        let bodies = model.bodies;
        let mut rows = schedule(bodies, &first_child);
        let moving: Vec<usize> = (1..bodies.len()).collect();
        let lanes = (rows.len() * WIDTH) as f64;
        let in_order = moving.len() <= MOST_IN_ORDER && (moving.len() as f64) < FILLED * lanes;
        if in_order {
            let row = |four: &[usize]| std::array::from_fn(|lane| four.get(lane).copied());
            rows = moving.chunks(WIDTH).map(row).collect();
        }
        let depth = depths(bodies);
        let deepest = |row: &Lanes| row.iter().flatten().map(|b| depth[*b]).max();
        let ancestors: usize = rows.iter().filter_map(deepest).sum();
        let mut schedule = LaneSchedule {
            in_order,
            lists_ancestors: bodies.len() == model.joint_count + 1
                && (in_order || ancestors <= MOST_ANCESTORS),
            steps: Vec::new(),
            place: vec![(0, 0); model.bodies.len()],
            to_body: lane_frames(model.bodies, &first_child),
        };
        for (step, lanes) in rows.iter().enumerate() {
            for (lane, body) in lanes.iter().enumerate() {
                if let Some(body) = body {
                    schedule.place[*body] = (step + 1, lane);
                }
            }
        }
        for lanes in &rows {
            let step = schedule.step(model, lanes, &first_child);
            schedule.steps.push(step);
        }
        schedule
    }

    /// `body`: the one that the joint moves itself.
    pub(crate) fn set_armature(&mut self, body: usize, armature: f64) {
        let (row, lane) = self.place[body];
        self.steps[row - 1].armature.0[lane] = armature;
    }

    /// Passes on the external wrenches of all bodies but the root: row, lane, force and moment in
    /// the lane frame.
    #[inline]
    pub(crate) fn for_each_wrench(
        &self,
        f_ext: &[Force],
        mut take: impl FnMut(usize, usize, Vector3<f64>, Vector3<f64>),
    ) {
        let places = self.place.iter().zip(&self.to_body).zip(f_ext);
        for (((row, lane), to_body), f) in places.skip(1) {
            take(
                *row,
                *lane,
                to_body.tr_mul(&f.linear),
                to_body.tr_mul(&f.angular),
            );
        }
    }

    fn step(&self, model: Skeleton, lanes: &Lanes, first_child: &[Option<usize>]) -> Step {
        let bodies = model.bodies;
        let real = || {
            lanes
                .iter()
                .enumerate()
                .filter_map(|(l, b)| b.map(|b| (l, b)))
        };
        let (_, first) = real().next().expect("a step has a body");
        let row_of = |b: usize| self.place[bodies[b].parent];
        let parent_row = row_of(first).0;
        // The root stands in every lane.
        let same_lane = real().all(|(lane, b)| {
            let (row, l) = row_of(b);
            row == parent_row && (l == lane || row == 0)
        });
        let straight = same_lane
            && parent_row > 0
            && real().all(|(_, b)| {
                bodies[b].kind.is_revolute()
                    && first_child[bodies[b].parent] == Some(b)
                    && turns_about_x(&self.rotation(bodies, b))
            });
        let mut step = Step {
            straight,
            same_lane,
            parent_row,
            parents: [row_of(first); WIDTH],
            idle: Pack([1.0; WIDTH]),
            joints: [model.joint_count; WIDTH],
            first_joint: None,
            rotation_x: [Pack([1.0; WIDTH]), Pack::ZERO],
            rotation: [Pack::ZERO; 9],
            origin: [Pack::ZERO; 3],
            revolute_ratio: Pack::ZERO,
            angle_offset: Pack::ZERO,
            prismatic_ratio: Pack::ZERO,
            shift_offset: Pack::ZERO,
            inertia: [Pack::ZERO; 10],
            armature: Pack::ZERO,
            columns: [NOWHERE; WIDTH],
            ancestors: Vec::new(),
        };
        for (lane, b) in real() {
            self.fill(model, &mut step, lane, b);
        }
        let from = step.joints[0];
        let follows =
            |(lane, joint): (usize, &usize)| *joint == (from + lane).min(model.joint_count);
        step.first_joint = step.joints.iter().enumerate().all(follows).then_some(from);
        if self.lists_ancestors && !self.in_order {
            step.ancestors = self.ancestors(model, lanes);
        }
        step
    }

    fn ancestors(&self, model: Skeleton, lanes: &Lanes) -> Vec<Ancestors> {
        let nv = model.base_size + model.joint_count;
        let column = |b: usize| model.base_size + model.bodies[b].joint;
        let mut levels = Vec::new();
        let mut at: Lanes = *lanes;
        while at.iter().any(Option::is_some) {
            let mut level = Ancestors {
                same_lane: None,
                places: [(0, 0); WIDTH],
                entries: [[NOWHERE; WIDTH]; 2],
            };
            let mut row = None;
            let mut same = true;
            for lane in 0..WIDTH {
                let (Some(body), Some(ancestor)) = (lanes[lane], at[lane]) else {
                    continue;
                };
                let place = self.place[ancestor];
                same &= place.1 == lane && *row.get_or_insert(place.0) == place.0;
                level.places[lane] = place;
                level.entries[0][lane] = column(body) * nv + column(ancestor);
                level.entries[1][lane] = column(ancestor) * nv + column(body);
                at[lane] = Some(model.bodies[ancestor].parent).filter(|p| *p > 0);
            }
            level.same_lane = row.filter(|_| same);
            levels.push(level);
        }
        levels
    }

    /// From a body's lane frame, at angle zero, to its parent's.
    fn rotation(&self, bodies: &[Body], b: usize) -> Matrix3<f64> {
        let body = &bodies[b];
        self.to_body[body.parent].tr_mul(&(body.placement.rotation * self.to_body[b]))
    }

    /// Constants of one lane.
    fn fill(&self, model: Skeleton, step: &mut Step, lane: usize, b: usize) {
        let body = &model.bodies[b];
        let mut rotation = self.rotation(model.bodies, b);
        let origin = self.to_body[body.parent].tr_mul(&body.placement.translation);
        let mut angle_offset = 0.0;
        if step.straight {
            let (turn, about_z) = split_rotations(&rotation);
            angle_offset = about_z[(1, 0)].atan2(about_z[(0, 0)]);
            step.rotation_x[0].0[lane] = turn[(1, 1)];
            step.rotation_x[1].0[lane] = turn[(2, 1)];
            rotation = turn;
        }
        step.idle.0[lane] = 0.0;
        step.columns[lane] = model.base_size + body.joint;
        step.parents[lane] = self.place[body.parent];
        step.joints[lane] = body.joint;
        for (k, pack) in step.rotation.iter_mut().enumerate() {
            pack.0[lane] = rotation[(k / 3, k % 3)];
        }
        for (k, pack) in step.origin.iter_mut().enumerate() {
            pack.0[lane] = origin[k];
        }
        if body.kind.is_revolute() {
            step.revolute_ratio.0[lane] = body.ratio;
            step.angle_offset.0[lane] = body.offset + angle_offset;
        } else {
            step.prismatic_ratio.0[lane] = body.ratio;
            step.shift_offset.0[lane] = body.offset;
        }
        let back = Se3::new(self.to_body[b].transpose(), Vector3::zeros());
        let inertia = body.inertia.transformed(&back);
        let (i, h) = (&inertia.rotational, &inertia.first_moment);
        let half_trace = 0.5 * i.trace();
        let numbers = [
            inertia.mass,
            h.x,
            h.y,
            h.z,
            half_trace - i[(0, 0)],
            -i[(0, 1)],
            -i[(0, 2)],
            half_trace - i[(1, 1)],
            -i[(1, 2)],
            half_trace - i[(2, 2)],
        ];
        for (pack, x) in step.inertia.iter_mut().zip(numbers) {
            pack.0[lane] = x;
        }
    }
}

/// The rotations in `Rx(alpha) Rz(delta)`; the second is of another kind where a rotation is not of this
/// form.
pub(crate) fn split_rotations(rotation: &Matrix3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    let alpha = (-rotation[(1, 2)]).atan2(rotation[(2, 2)]);
    let about_x = *Rotation3::from_axis_angle(&Vector3::x_axis(), alpha).matrix();
    (about_x, about_x.tr_mul(rotation))
}

/// True if it is of the form `Rx(alpha) Rz(delta)`.
fn turns_about_x(rotation: &Matrix3<f64>) -> bool {
    rotation[(0, 2)].abs() < 1e-12
}

/// The child of each body that starts the longest limb.
fn first_children(bodies: &[Body]) -> Vec<Option<usize>> {
    let height = heights(bodies);
    let mut first: Vec<Option<usize>> = vec![None; bodies.len()];
    for (i, body) in bodies.iter().enumerate().skip(1) {
        let best = &mut first[body.parent];
        if best.is_none_or(|b| height[i] > height[b]) {
            *best = Some(i);
        }
    }
    first
}

/// Bodies on the longest path from each body to a leaf, itself included.
fn heights(bodies: &[Body]) -> Vec<usize> {
    let mut height = vec![1; bodies.len()];
    for i in (1..bodies.len()).rev() {
        let parent = bodies[i].parent;
        height[parent] = height[parent].max(height[i] + 1);
    }
    height
}

/// Bodies between each body and the root, itself included.
fn depths(bodies: &[Body]) -> Vec<usize> {
    let mut depth = vec![0; bodies.len()];
    for (i, body) in bodies.iter().enumerate().skip(1) {
        depth[i] = depth[body.parent] + 1;
    }
    depth
}

type Lanes = [Option<usize>; WIDTH];

/// Bodies side by side: highest first, limbs kept in their lane.
fn schedule(bodies: &[Body], first_child: &[Option<usize>]) -> Vec<Lanes> {
    let height = heights(bodies);
    let mut children = vec![Vec::new(); bodies.len()];
    for (b, body) in bodies.iter().enumerate().skip(1) {
        children[body.parent].push(b);
    }
    let mut ready = children[0].clone();
    let mut rows: Vec<Lanes> = Vec::new();
    let mut previous: Lanes = [None; WIDTH];
    while !ready.is_empty() {
        ready.sort_by_key(|b| (std::cmp::Reverse(height[*b]), *b));
        let chosen: Vec<usize> = ready.drain(..ready.len().min(WIDTH)).collect();
        let mut row: Lanes = [None; WIDTH];
        let mut rest = Vec::new();
        for body in chosen {
            let parent = bodies[body].parent;
            let lane = previous.iter().position(|p| *p == Some(parent));
            match lane {
                Some(lane) if first_child[parent] == Some(body) => row[lane] = Some(body),
                _ => rest.push(body),
            }
        }
        for body in rest {
            if let Some(free) = row.iter_mut().find(|r| r.is_none()) {
                *free = Some(body);
            }
        }
        for body in row.iter().flatten() {
            ready.extend(&children[*body]);
        }
        previous = row;
        rows.push(row);
    }
    rows
}

/// Rotations from lane frames to body frames.
fn lane_frames(bodies: &[Body], first_child: &[Option<usize>]) -> Vec<Matrix3<f64>> {
    let frame = |(i, body): (usize, &Body)| {
        if i == 0 {
            return Matrix3::identity();
        }
        let z = body.axis;
        let child_axis = first_child[i].map(|c| bodies[c].placement.rotation * bodies[c].axis);
        let normal = child_axis.map(|a| z.cross(&a)).filter(|n| n.norm() > 1e-13);
        // Any perpendicular will do where the axes are parallel, or at the end of a limb.
        let x = normal.unwrap_or_else(|| {
            let least = z.iamin();
            z.cross(&Vector3::ith(least, 1.0))
        });
        // The product of nearly parallel axes is mostly rounding: make it perpendicular again.
        let x = (x.normalize() - z * z.dot(&x.normalize())).normalize();
        Matrix3::from_columns(&[x, z.cross(&x), z])
    };
    bodies.iter().enumerate().map(frame).collect()
}
