//! Recursive Newton-Euler for bodies in their order (see `in_order`).

use super::{RootMotion, own_wrench};
use crate::data::Data;
use crate::in_order::{
    BodyRow, Group, InOrder, Placement, add_to_joints, add_to_parents, of_bodies, of_joints,
    place_in_parents, rotations_back, to_bodies,
};
use crate::lane_schedule::{LaneSchedule, Step};
use crate::model::Model;
use crate::spatial::Force;
use nalgebra::Vector3;
use simd::{Kernel, Lanes, Pack, V3, WIDTH, store_all};

/// `rnea` on bodies in their order, the root's motion among them; adds to `tau`.
pub(super) struct RneaInOrder<'a> {
    pub(super) schedule: &'a LaneSchedule,
    pub(super) memory: &'a mut InOrder,
    pub(super) q: &'a [f64],
    pub(super) v: &'a [f64],
    pub(super) a: &'a [f64],
    pub(super) f_ext: Option<&'a [Force]>,
    pub(super) tau: &'a mut [f64],
}

impl Kernel for RneaInOrder<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let InOrder {
            parents,
            groups,
            bodies,
            ..
        } = self.memory;
        let steps = &self.schedule.steps;
        for (step, group) in steps.iter().zip(groups.iter_mut()) {
            place_in_parents::<L>(step, group, self.q);
            let (v, a): (L, L) = (of_joints(self.v, step), of_joints(self.a, step));
            let (r, p) = (
                L::load(&step.revolute_ratio),
                L::load(&step.prismatic_ratio),
            );
            store_all([v * r, a * r, v * p, a * p], &mut group.rates);
        }
        let slides = self.schedule.slides;
        let mut last = Moving::<L>::load(&bodies[0]);
        for (b, &parent) in parents.iter().enumerate().skip(1) {
            if parent + 1 != b {
                last = Moving::load(&bodies[parent]);
            }
            let (group, lane) = ((b - 1) / WIDTH, (b - 1) % WIDTH);
            last = last.child(&groups[group], lane, slides);
            last.store(&mut bodies[b]);
        }
        let (root, moving) = bodies.split_at_mut(1);
        root[0].sums = [Pack::ZERO; 3];
        let (fours, _) = moving.as_chunks_mut::<WIDTH>();
        for ((step, group), four) in steps.iter().zip(groups.iter_mut()).zip(&mut *fours) {
            own_wrenches::<L>(step, group, four);
        }
        if let Some(f_ext) = self.f_ext {
            self.schedule.for_each_wrench(f_ext, |row, lane, f, n| {
                push(&mut fours[row - 1][lane], &f.into(), &n.into());
            });
        }
        add_to_parents::<L, 2>(parents, bodies);
        let (fours, _) = bodies[1..].as_chunks::<WIDTH>();
        for ((step, group), four) in steps.iter().zip(&*groups).zip(fours) {
            let (f, _) = of_bodies::<L>(four, |b| &b.sums[0]);
            let (n, _) = of_bodies::<L>(four, |b| &b.sums[1]);
            let [vx, vy, vz, wx, wy, wz] = &group.twist;
            let v = V3::<L>::new(L::load(vx), L::load(vy), L::load(vz));
            let w = V3::new(L::load(wx), L::load(wy), L::load(wz));
            //= F Table 5.1: tau_i = S_i^T f_i
            add_to_joints(v.dot(f) + w.dot(n), self.tau, step);
        }
    }
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
    /// The child in a lane of a group; `slides` if any joint of the robot is prismatic.
    #[inline(always)]
    fn child(&self, group: &Group, lane: usize, slides: bool) -> Self {
        let (placement, arm) = self.placement.child(group, lane);
        let (w, al) = (self.omega, self.alpha);
        let [rate, change, slide, slide_change] = &group.rates;
        let lane = lane % WIDTH;
        let rate = L::splat(rate.0[lane]);
        let z = placement.columns[2];
        let turned = w.cross_in_lanes(z);
        //= F Table 5.1: v_i = iX_lambda v_lambda + S_i dq_i
        //= F Table 5.1: a_i = iX_lambda a_lambda + S_i ddq_i + v_i x S_i dq_i
        let mut a = self.a + (al.cross_in_lanes(arm) + w.cross_in_lanes(w.cross_in_lanes(arm)));
        if slides {
            let twice = L::splat(2.0 * slide.0[lane]);
            a = turned.mul_add(twice, z.mul_add(L::splat(slide_change.0[lane]), a));
        }
        Self {
            placement,
            omega: z.mul_add(rate, w),
            alpha: turned.mul_add(rate, z.mul_add(L::splat(change.0[lane]), al)),
            a,
        }
    }
}

/// Wrenches of four bodies by themselves, about the root's origin.
#[inline(always)]
fn own_wrenches<L: Lanes>(step: &Step, group: &mut Group, four: &mut [BodyRow; WIDTH]) {
    let back = rotations_back::<L>(four);
    let (p, _) = of_bodies::<L>(four, |b| &b.position);
    let angular = back.2.scale(L::load(&step.revolute_ratio));
    let linear = p.cross_add(angular, back.2.scale(L::load(&step.prismatic_ratio)));
    let (v, w) = (linear, angular);
    store_all([v.x, v.y, v.z, w.x, w.y, w.z], &mut group.twist);
    let (w, _) = of_bodies::<L>(four, |b| &b.omega);
    let (al, _) = of_bodies::<L>(four, |b| &b.alpha);
    let (a, _) = of_bodies::<L>(four, |b| &b.a);
    let (w, al, a) = (
        back.times_vector(w),
        back.times_vector(al),
        back.times_vector(a),
    );
    let (_, f, n) = own_wrench(step, w, al, a);
    let f = back.tr_mul(f);
    let n = p.cross_add(f, back.tr_mul(n));
    let zero = L::splat(0.0);
    to_bodies([f.x, f.y, f.z, zero], four, |b| &mut b.sums[0]);
    to_bodies([n.x, n.y, n.z, zero], four, |b| &mut b.sums[1]);
}

/// Takes an external wrench, in the lane frame, from a body's.
fn push(body: &mut BodyRow, f: &[f64; 3], n: &[f64; 3]) {
    let rotate = |v: &[f64; 3], r: usize| -> f64 {
        (body.columns.iter().zip(v)).map(|(c, v)| c.0[r] * v).sum()
    };
    let force: [f64; 3] = std::array::from_fn(|r| rotate(f, r));
    let p = &body.position.0;
    let moment: [f64; 3] = std::array::from_fn(|r| {
        let (s, t) = ((r + 1) % 3, (r + 2) % 3);
        rotate(n, r) + p[s] * force[t] - p[t] * force[s]
    });
    for r in 0..3 {
        body.sums[0].0[r] -= force[r];
        body.sums[1].0[r] -= moment[r];
    }
}

/// `rnea` of the joints, in `data.tau`; the wrench of the root's children, about its origin.
pub(super) fn run_in_order(
    model: &Model,
    data: &mut Data,
    root: &RootMotion,
    [q, v, a]: [&[f64]; 3],
    f_ext: Option<&[Force]>,
) -> Force {
    let base = model.base_size().0;
    let pack = |x: &Vector3<f64>| Pack([x.x, x.y, x.z, 0.0]);
    let body = &mut data.in_order.bodies[0];
    (body.omega, body.alpha, body.a) = (pack(&root.omega), pack(&root.alpha), pack(&root.a));
    let kernel = RneaInOrder {
        schedule: &model.schedule,
        memory: &mut data.in_order,
        q,
        v,
        a,
        f_ext,
        tau: &mut data.tau[base..],
    };
    simd::run(data.instructions, kernel);
    let [f, n, _] = &data.in_order.bodies[0].sums;
    let vector = |p: &Pack| Vector3::new(p.0[0], p.0[1], p.0[2]);
    Force::new(vector(f), vector(n))
}
