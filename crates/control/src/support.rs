//! Support: the wrenches by which the ground carries a robot on its feet, from the desired motion.
//!
//! In: angles, desired accelerations; which end-effectors bear the robot and where up is, from slow measurements.
//! Out: a wrench for each F/T sensor's frame. The feet stand still, so the desired joint accelerations give the
//! base's acceleration, and both give the total wrench that the ground must apply (the six rows of inverse dynamics
//! that no joint drives). It is shared among the feet by least squares; no foot pulls at the ground.
//!
//! Nothing of the wrench is measured. A measured one is late by the filters' delay, and fed forward as `-J^T f` it
//! asks of the ankles what they bore then: a loop round a body that sways, which falls. Here the only fast signal is
//! the joints' angles. Up is kept in the axes of each foot, which stands still, so a body that sways does not turn it.

use dynamics::{Base, Data, Model, Motion, Se3, forward_kinematics_acceleration, rnea};
use nalgebra::{Matrix6, Vector3, Vector6};
use robot_state::{MAX_FT_SENSORS, Wrench};

use crate::six::{copy, wrench_map};

/// Share of the robot's weight on an end-effector from which on it bears. Chosen; no experiment recorded.
const BEARS: f64 = 0.1;
/// Share of the robot's weight on an end-effector below which it bears no more: less, so that noise does not switch.
/// Chosen; no experiment recorded.
const BEARS_NO_MORE: f64 = 0.05;
/// Time in which an end-effector that comes to bear takes its whole share, s: that of a change of mode (`DURATION_S` of
/// crates/cycle/src/joint/transition.rs).
const TAKES_OVER_S: f64 = 0.3;
/// Where up is, in the axes of a foot, is the mean since it stands, of at most so long, s: ten times the period of
/// sway.
const UP_S: f64 = 10.0;
/// Shortest time of the mean by which up is known, s. Chosen; no experiment recorded.
const UP_LEAST_S: f64 = 0.2;
/// Reasonable distance of the centre of pressure from the sensor's axis, m: a moment costs as much as a force divided
/// by it. Chosen on the simulated humanoid, whose feet are 0.14 m wide.
const SOLE_REACH: f64 = 0.05;
/// Greatest distance of the centre of pressure from the sensor's axis, m. Chosen on the simulated humanoid, whose feet
/// are 0.24 m long.
const FURTHEST_PRESSURE: f64 = 0.15;
/// Greatest tangential force as a share of the normal one. Chosen on the simulated humanoid, whose floor bears 0.7
/// (config/humanoid/sim.toml).
const FRICTION: f64 = 0.5;

/// An end-effector beyond an F/T sensor.
#[derive(Debug, Clone, Copy)]
struct Foot {
    body: usize,
    placement: Se3,
    /// Whether the end-effector stands on the ground, and for how long, s.
    bears: bool,
    /// Share of the robot's weight on it, along up.
    load: f64,
    stands_s: f64,
    /// Share that it takes, 0 to 1.
    share: f64,
    /// Up in the sensor's axes, unit vector.
    up: Vector3<f64>,
    /// Sensor's frame in the base's axes, of the motion that was set last.
    at: Se3,
    /// Wrench in its own axes is multiplied by this to be one on the base.
    map: Matrix6<f64>,
}

/// Wrenches of the ground on the end-effectors that bear a robot with a floating base.
#[derive(Debug, Clone)]
pub struct Support {
    model: Model,
    data: Data,
    feet: Vec<Foot>,
    /// N.
    weight: f64,
    q: Vec<f64>,
    still: Vec<f64>,
    a: Vec<f64>,
    wrenches: [Wrench; MAX_FT_SENSORS],
    /// Measured in the last cycle, at the sensors' frames.
    contact: [Wrench; MAX_FT_SENSORS],
}

/// Distance of the wrenches that F/T sensors measure from the one that carries a robot at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imbalance {
    /// Force, share of the weight.
    pub force: f64,
    /// Moment about the middle of the end-effectors that bear the robot, over the weight, m.
    pub moment_m: f64,
}

impl Support {
    /// Support at these frames of the model, those of the F/T sensors in config order. A robot with a fixed base needs
    /// none: its wrenches are zero.
    #[must_use]
    pub fn new(model: &Model, frames: &[usize]) -> Self {
        let weight = model.gravity().norm() * model.total_mass();
        let mut model = model.clone();
        model.set_gravity(Vector3::zeros());
        let mut q = vec![0.0; model.nq()];
        let frames = if model.base() == Base::Floating {
            q[6] = 1.0;
            frames
        } else {
            &[]
        };
        let frames = frames.iter().filter_map(|&frame| model.frames().get(frame));
        let foot = |frame: &dynamics::Frame| Foot {
            body: frame.body,
            placement: frame.placement,
            bears: false,
            load: 0.0,
            stands_s: 0.0,
            share: 0.0,
            up: Vector3::z(),
            at: Se3::identity(),
            map: Matrix6::zeros(),
        };
        Self {
            feet: frames.take(MAX_FT_SENSORS).map(foot).collect(),
            data: Data::new(&model),
            weight,
            q,
            still: vec![0.0; model.nv()],
            a: vec![0.0; model.nv()],
            wrenches: [Wrench::default(); MAX_FT_SENSORS],
            contact: [Wrench::default(); MAX_FT_SENSORS],
            model,
        }
    }

    /// Takes what is measured in a cycle, all of one instant, which may be late: proper acceleration of the base in its
    /// axes, joint angles (model order, rad), contact wrenches at the sensors' frames; `dt`: s.
    pub fn observe(
        &mut self,
        proper: &Vector3<f64>,
        q: &[f64],
        contact: &[Wrench; MAX_FT_SENSORS],
        dt: f64,
    ) {
        let Some(up) = proper
            .try_normalize(1e-3)
            .filter(|up| up.norm().is_finite())
        else {
            return;
        };
        if self.feet.is_empty() {
            return;
        }
        self.contact = *contact;
        self.a.fill(0.0);
        self.set_angles(q);
        for (foot, contact) in self.feet.iter_mut().zip(contact) {
            let up = foot.at.rotation.tr_mul(&up);
            foot.load = Vector3::from(contact.force).dot(&up) / self.weight;
            if foot.load > BEARS {
                foot.bears = true;
            } else if foot.load < BEARS_NO_MORE {
                foot.bears = false;
            }
            let (towards, age) = if foot.bears {
                (1.0, foot.stands_s + dt)
            } else {
                (0.0, 0.0)
            };
            foot.stands_s = age.min(UP_S);
            let step = dt / TAKES_OVER_S;
            foot.share += (towards - foot.share).max(-step).min(step);
            let share = dt / foot.stands_s.max(UP_LEAST_S);
            let mean = foot.up + (up - foot.up) * if foot.bears { share } else { 1.0 };
            foot.up = mean.try_normalize(1e-3).unwrap_or(up);
        }
    }

    /// An end-effector bears the robot.
    #[must_use]
    pub fn bears(&self, sensor: usize) -> bool {
        self.feet.get(sensor).is_some_and(|foot| foot.share > 0.0)
    }

    /// Share of the robot's weight on an end-effector in this very cycle, along up.
    #[must_use]
    pub fn load(&self, sensor: usize) -> f64 {
        self.feet.get(sensor).map_or(0.0, |foot| foot.load)
    }

    /// Up in the axes of an F/T sensor, unit vector, where its end-effector bears the robot and has for long enough to
    /// know it; none elsewhere.
    #[must_use]
    pub fn ground_under(&self, sensor: usize) -> Option<Vector3<f64>> {
        let foot = self.feet.get(sensor)?;
        (foot.bears && foot.stands_s >= UP_LEAST_S).then_some(foot.up)
    }

    /// For how long an end-effector has stood on the ground, of at most 10 s, s.
    #[must_use]
    pub fn stands_for(&self, sensor: usize) -> f64 {
        self.feet.get(sensor).map_or(0.0, |foot| foot.stands_s)
    }

    /// The wrenches of the ground, at the sensors' frames, with which the joints at `q` (newest angles, model order,
    /// rad) have the accelerations `ddq_d` while the feet stand still. Zero for end-effectors that bear nothing.
    pub fn wrenches(&mut self, q: &[f64], ddq_d: &[f64]) -> &[Wrench; MAX_FT_SENSORS] {
        self.wrenches = [Wrench::default(); MAX_FT_SENSORS];
        let most = self.feet.iter().map(|foot| foot.share).fold(0.0, f64::max);
        if most > 0.0 {
            let base = self.model.base_size().0;
            self.a.fill(0.0);
            copy(self.a.iter_mut().skip(base), ddq_d);
            self.set_angles(q);
            if let Some(total) = self.total() {
                self.distribute(&(total * most));
            }
        }
        &self.wrenches
    }

    /// The sum of all wrenches that F/T sensors have measured in the last cycle, less the one that carries the robot at rest
    /// at these angles (model order, rad, of the instant of the measurement); none where nothing bears it.
    pub fn imbalance(&mut self, q: &[f64]) -> Option<Imbalance> {
        self.a.fill(0.0);
        self.set_angles(q);
        let bear = self.feet.iter().filter(|foot| foot.share > 0.0);
        let (sum, shares) = bear.fold((Vector3::zeros(), 0.0), |(sum, shares), foot| {
            (sum + foot.share * foot.at.translation, shares + foot.share)
        });
        let needed = self.total()?;
        let measured = self.feet.iter().zip(&self.contact);
        let excess = measured.fold(-needed, |sum, (foot, contact)| {
            let parts = contact.force.iter().chain(&contact.torque).copied();
            let map = wrench_map(&foot.at.rotation, &foot.at.translation);
            sum + map * Vector6::from_iterator(parts)
        });
        let force: Vector3<f64> = excess.fixed_rows::<3>(0).into();
        let about_base: Vector3<f64> = excess.fixed_rows::<3>(3).into();
        let moment = about_base - (sum / shares).cross(&force);
        Some(Imbalance {
            force: force.norm() / self.weight,
            moment_m: moment.norm() / self.weight,
        })
    }

    /// Sets angles and the feet's places, at the accelerations `a` of a base that is not accelerated.
    fn set_angles(&mut self, q: &[f64]) {
        let first = self.model.base_size().1;
        copy(self.q.iter_mut().skip(first), q);
        let (model, data) = (&self.model, &mut self.data);
        forward_kinematics_acceleration(model, data, &self.q, &self.still, &self.a);
        for foot in &mut self.feet {
            if let Some(body) = self.data.placements().get(foot.body) {
                foot.at = body.compose(&foot.placement);
            }
        }
    }

    /// The wrench on the base, in its axes, that the ground must make in all.
    fn total(&mut self) -> Option<Vector6<f64>> {
        let (mut up, mut moves, mut shares) = (Vector3::zeros(), Motion::zero(), 0.0);
        let bodies = (self.data.placements(), self.data.accelerations());
        for foot in &self.feet {
            let (place, own) = bodies.0.get(foot.body).zip(bodies.1.get(foot.body))?;
            let acceleration = place.act_motion(*own);
            up += foot.share * (foot.at.rotation * foot.up);
            moves.linear += foot.share * acceleration.linear;
            moves.angular += foot.share * acceleration.angular;
            shares += foot.share;
        }
        let up = up.try_normalize(1e-3)?;
        // The base moves so that the feet do not; what is to be held against gravity is as if it rose with g.
        let gravity = self.weight / self.model.total_mass();
        let linear = up * gravity - moves.linear / shares;
        let base = Motion::new(linear, -moves.angular / shares).to_array();
        copy(&mut self.a, &base);
        let (model, data) = (&self.model, &mut self.data);
        let tau = rnea(model, data, &self.q, &self.still, &self.a, None);
        let total = Vector6::from_iterator(tau.iter().take(6).copied());
        total.iter().all(|x| x.is_finite()).then_some(total)
    }

    /// Shares a wrench on the base among the feet: the least squares of their wrenches, each weighted by its share.
    /// Feet that would pull are left out.
    fn distribute(&mut self, total: &Vector6<f64>) {
        for foot in &mut self.feet {
            foot.map = wrench_map(&foot.at.rotation, &foot.at.translation);
        }
        let r = SOLE_REACH * SOLE_REACH;
        let cost = Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, r, r, r));
        let mut used: [bool; MAX_FT_SENSORS] =
            std::array::from_fn(|s| self.feet.get(s).is_some_and(|foot| foot.share > 0.0));
        for _ in 0..self.feet.len() {
            let all = self.feet.iter().zip(used).filter(|(_, used)| *used);
            let balance = all.fold(Matrix6::zeros(), |sum, (foot, _)| {
                sum + foot.map * cost * foot.map.transpose() * foot.share
            });
            let Some(multipliers) = balance.lu().solve(total) else {
                return;
            };
            let mut pulls = None;
            for (s, foot) in self.feet.iter().enumerate() {
                let wrench = cost * foot.map.transpose() * multipliers * foot.share;
                let normal = wrench.fixed_rows::<3>(0).dot(&foot.up);
                let own = &mut self.wrenches[s];
                *own = if used[s] {
                    foot.within(&wrench, normal)
                } else {
                    Wrench::default()
                };
                if used[s] && normal < pulls.map_or(0.0, |(_, least)| least) {
                    pulls = Some((s, normal));
                }
            }
            let Some((s, _)) = pulls else {
                return;
            };
            used[s] = false;
        }
    }
}

impl Foot {
    /// The wrench with a tangential force that friction bears and a centre of pressure near the foot.
    fn within(&self, wrench: &Vector6<f64>, normal: f64) -> Wrench {
        let limited = |part: Vector3<f64>, most: f64| {
            let along = self.up * part.dot(&self.up);
            let across = part - along;
            (
                along,
                across * (most / across.norm().max(f64::MIN_POSITIVE)).min(1.0),
            )
        };
        let normal = normal.max(0.0);
        let (along, across) = limited(wrench.fixed_rows::<3>(0).into(), FRICTION * normal);
        let (twist, tilt) = limited(wrench.fixed_rows::<3>(3).into(), FURTHEST_PRESSURE * normal);
        Wrench {
            force: (along + across).into(),
            torque: (twist + tilt).into(),
        }
    }
}
