//! Recursive Newton-Euler for bodies in their order (see `in_order`).

use crate::data::Data;
use crate::in_order::{
    BodyRow, Group, InOrder, Placement, add_to_joints, of_bodies, of_joints, placements,
    rotate_in_parents, row_of,
};
use crate::lane_schedule::{LaneSchedule, Step};
use crate::model::{Base, Model};
use crate::spatial::Force;
use simd::{Kernel, Lanes, M3, Pack, V3, WIDTH, load_all, store_all};

/// `rnea` of the joints, in `data.tau`, on bodies in their order; the motion of a floating root is in
/// its row.
struct RneaInOrder<'a, const GROUPS: usize, const ARM: bool> {
    model: &'a Model,
    data: &'a mut Data,
    /// q, v and a of the joints.
    joints: [&'a [f64]; 3],
    f_ext: Option<&'a [Force]>,
}

/// Runs it.
#[inline]
pub(super) fn run<const GROUPS: usize, const ARM: bool>(
    model: &Model,
    data: &mut Data,
    joints: [&[f64]; 3],
    f_ext: Option<&[Force]>,
) {
    let kernel = RneaInOrder::<GROUPS, ARM> {
        model,
        joints,
        f_ext,
        data: &mut *data,
    };
    simd::run(kernel.data.instructions, kernel);
}

impl<const GROUPS: usize, const ARM: bool> Kernel for RneaInOrder<'_, GROUPS, ARM> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (model, [q, mut v, mut a]) = (self.model, self.joints);
        let tau = &mut self.data.tau[model.base_size().0..];
        let InOrder {
            parents,
            root,
            groups,
            ..
        } = &mut self.data.in_order;
        let (Some(steps), Some(groups)) = (
            model.schedule.steps.first_chunk::<GROUPS>(),
            groups.first_chunk_mut::<GROUPS>(),
        ) else {
            return;
        };
        for (step, group) in steps.iter().zip(groups.iter_mut()) {
            rotate_in_parents::<L, ARM>(step, group, q);
            if !ARM {
                set_rates::<L>(step, group, v, a);
            }
        }
        if let Some(f_ext) = self.f_ext {
            set_external(&model.schedule, groups, f_ext);
        }
        if model.base == Base::Fixed {
            (-L::load_part(model.gravity.as_slice())).store(&mut root.a);
        }
        let moving = parents.len() - 1;
        if ARM {
            (v, a) = (&v[..moving], &a[..moving]);
        }
        let mut last = Moving::<L>::load(root);
        'all: for g in 0..GROUPS {
            for lane in 0..WIDTH {
                let b = g * WIDTH + lane;
                if b >= moving {
                    break 'all;
                }
                let rates = if ARM {
                    [L::splat(v[b]), L::splat(a[b]), L::splat(0.0), L::splat(0.0)]
                } else {
                    let parent = parents[b + 1];
                    if parent != b {
                        last = Moving::load(row_of(root, groups, parent));
                    }
                    groups[g].rates.each_ref().map(|r| L::splat(r.0[lane]))
                };
                last = if ARM && b == 0 && model.base == Base::Fixed {
                    last.first_of_arm(&groups[g], rates)
                } else {
                    last.child::<ARM>(&groups[g], lane, rates)
                };
                last.store(&mut groups[g].rows[lane]);
            }
        }
        if !ARM {
            tau.fill(0.0);
        }
        for g in (0..GROUPS).rev() {
            let (before, later) = groups.split_at_mut(g + 1);
            let (step, group) = (&steps[g], &mut before[g]);
            let placed = placements::<L>(&group.rows);
            let (mut f, mut n) = own_wrench(step, group, placed);
            if self.f_ext.is_some() {
                (f, n) = take_external((f, n), group, placed);
            }
            //= F Table 5.1: f_lambda = f_lambda + lambdaX*_i f_i (X = 1 in the root's axes)
            let own = [f.x, f.y, f.z, n.x, n.y, n.z];
            let [fx, fy, fz, nx, ny, nz] = group.add_carried::<L, 6, ARM>(own, later);
            let (v, w) = twist::<L, ARM>(step, placed);
            //= F Table 5.1: tau_i = S_i^T f_i
            let torque = w.dot_add(V3::new(nx, ny, nz), v.dot(V3::new(fx, fy, fz)));
            let torque = of_joints::<L>(a, step).mul_add(L::load(&step.armature), torque);
            if ARM {
                torque.store_part(&mut tau[g * WIDTH..]);
            } else {
                add_to_joints(torque, tau, step);
            }
        }
    }
}

/// Velocities and accelerations of four bodies' joints, angular and linear.
#[inline(always)]
fn set_rates<L: Lanes>(step: &Step, group: &mut Group, v: &[f64], a: &[f64]) {
    let (v, a): (L, L) = (of_joints(v, step), of_joints(a, step));
    let (r, p) = (
        L::load(&step.revolute_ratio),
        L::load(&step.prismatic_ratio),
    );
    store_all([v * r, a * r, v * p, a * p], &mut group.rates);
}

/// Keeps the external wrenches of all bodies in their groups.
fn set_external(schedule: &LaneSchedule, groups: &mut [Group], f_ext: &[Force]) {
    for group in groups.iter_mut() {
        group.external = [Pack::ZERO; 6];
    }
    schedule.for_each_wrench(f_ext, |row, lane, f, n| {
        for (pack, x) in groups[row - 1].external.iter_mut().zip(f.iter().chain(&n)) {
            pack.0[lane] = *x;
        }
    });
}

/// A body's placement and motion in registers.
#[derive(Clone, Copy)]
struct Moving<L> {
    placement: Placement<L>,
    omega: L,
    alpha: L,
    a: L,
}

impl<L: Lanes> Moving<L> {
    #[inline(always)]
    fn load(body: &BodyRow) -> Self {
        Self {
            placement: Placement::load(body),
            omega: L::load(&body.omega),
            alpha: L::load(&body.alpha),
            a: L::load(&body.a),
        }
    }
    #[inline(always)]
    fn store(&self, body: &mut BodyRow) {
        self.placement.store(body);
        self.omega.store(&mut body.omega);
        self.alpha.store(&mut body.alpha);
        self.a.store(&mut body.a);
    }
    /// The first body of an arm, where this is a root that stands still.
    #[inline(always)]
    fn first_of_arm(&self, group: &Group, [rate, change, ..]: [L; 4]) -> Self {
        let (placement, _) = self.placement.child::<true>(group, 0);
        let z = placement.columns[2];
        Self {
            placement,
            omega: z * rate,
            alpha: z * change,
            a: self.a,
        }
    }
    /// The child in a lane of a group; `rates` as the group's.
    #[inline(always)]
    fn child<const ARM: bool>(&self, group: &Group, lane: usize, rates: [L; 4]) -> Self {
        let (placement, arm) = self.placement.child::<ARM>(group, lane);
        let (w, al) = (self.omega, self.alpha);
        let [rate, change, slide, slide_change] = rates;
        let z = placement.columns[2];
        let turned = w.cross_in_lanes(z);
        //= F Table 5.1: v_i = iX_lambda v_lambda + S_i dq_i
        //= F Table 5.1: a_i = iX_lambda a_lambda + S_i ddq_i + v_i x S_i dq_i
        let mut a = self.a + (al.cross_in_lanes(arm) + w.cross_in_lanes(w.cross_in_lanes(arm)));
        if !ARM {
            a = turned.mul_add(slide + slide, z.mul_add(slide_change, a));
        }
        Self {
            placement,
            omega: z.mul_add(rate, w),
            alpha: turned.mul_add(rate, z.mul_add(change, al)),
            a,
        }
    }
}

/// Twists of four bodies' joints for unit speed: linear, angular.
#[inline(always)]
fn twist<L: Lanes, const ARM: bool>(step: &Step, (rotation, p): (M3<L>, V3<L>)) -> (V3<L>, V3<L>) {
    let z = rotation.third_column();
    if ARM {
        return (p.cross(z), z);
    }
    let angular = z.scale(L::load(&step.revolute_ratio));
    let shift = z.scale(L::load(&step.prismatic_ratio));
    (p.cross_add(angular, shift), angular)
}

/// The wrenches that give four bodies their motion: force, moment about the root's origin.
#[inline(always)]
fn own_wrench<L: Lanes>(
    step: &Step,
    group: &Group,
    (rotation, p): (M3<L>, V3<L>),
) -> (V3<L>, V3<L>) {
    let back = rotation.transpose();
    let w = of_bodies::<L>(&group.rows, |b| &b.omega);
    let al = of_bodies::<L>(&group.rows, |b| &b.alpha);
    let a = of_bodies::<L>(&group.rows, |b| &b.a);
    //= F Table 5.1: f_i = I_i a_i + v_i x* I_i v_i: force m a_c, moment I al + w x I w about the centre
    let arm = rotation.times_vector(V3::load(&group.center));
    let a = w.cross_add(w.cross(arm), al.cross_add(arm, a));
    let f = a.scale(L::load(&step.inertia[0]));
    let inertia = M3::load_symmetric(&group.rotational);
    let (w, al) = (back.times_vector(w), back.times_vector(al));
    let n = w.cross_add(inertia.times_vector(w), inertia.times_vector(al));
    (f, p.plus(arm).cross_add(f, rotation.times_vector(n)))
}

/// Takes the external wrenches from those of four bodies.
#[inline(always)]
fn take_external<L: Lanes>(
    (f, n): (V3<L>, V3<L>),
    group: &Group,
    (rotation, p): (M3<L>, V3<L>),
) -> (V3<L>, V3<L>) {
    let [fx, fy, fz, nx, ny, nz] = load_all::<L, 6>(&group.external);
    let force = rotation.times_vector(V3::new(fx, fy, fz));
    let moment = rotation.times_vector(V3::new(nx, ny, nz));
    let minus = L::splat(-1.0);
    let moment = p.cross_add(force, moment);
    (f.add_scaled(minus, force), n.add_scaled(minus, moment))
}
