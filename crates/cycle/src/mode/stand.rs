//! Stand: the robot stands on the feet that bear it, its centre of mass over them.
//!
//! Legs follow the torques of [`control::Balance`] and no spring of their own; all other joints follow `q_d dq_d ddq_d`
//! as in mode inverse dynamics, and legs that bear nothing as well. What is fast in the torques follows from the joints'
//! angles, and by a quarter of a degree from the gyroscope, which shows how feet roll. F/T sensors and IMU show slowly which
//! feet bear the robot and where up is. Nothing else of them enters: the torque that is fed back is that by torsion, on the
//! level that F/T sensors had shown when the mode began, and what they show since then as far as a gear explains it. A leg has no spring: an F/T sensor that steps by 10 N·m, and is
//! believed, moves it by 6 degrees.

mod footing;

use control::{Balance, BalanceInput, MAX_FEET};
use footing::Footing;
use nalgebra::Vector3;
use robot_config::Robot;
use robot_state::{CommandedRecord, ImuMeasured, Mode, Reference, measured_flags};
use supervisor::time_in_a_row;

use super::{
    Asked, Bounds, ClientMode, Feedback, Follow, Made, ModeCycle, RigidBody, RigidBodyTorque,
    Spring, Task, Unfit,
};
use crate::inputs::Seen;
use crate::measure::NOT_USED;

/// How far outside the soles the capture point may be, m, and for how long, s: where it stays longer the robot falls.
/// Chosen on the simulated humanoid: what soles and angles are known by.
const OUTSIDE_M: f64 = 0.03;
const OUTSIDE_S: f64 = 0.1;
/// Change of a level that a gear explains. Its hysteresis: from one side to the other a share of the torque limit, and no
/// more than a share of what the torque has changed by since the mode began. Its stiffness: a share of the present change of
/// the torque. What is beyond is an F/T sensor's, and not followed. Chosen on gears of two worlds, whose hysteresis is 0.7
/// and 1.5 % to each side, a tenth of the spring beside it, and whose stiffness is 7 % other than configured
/// (docs/results/standing.md). Of a leg that bears the robot alone only the hysteresis counts: with the stiffness the
/// simulated humanoid falls where the moment under that foot is wrong by 10 N·m.
const HYSTERESIS: f64 = 0.03;
const HYSTERESIS_GROWS: f64 = 0.2;
const STIFFNESS: f64 = 0.1;
/// Time constant with which a level is followed and left, s: a torque does not step. Chosen; no experiment recorded.
const LEVEL_S: f64 = 0.05;

/// Offset that is added to a joint's torque by torsion, N·m.
#[derive(Debug, Clone, Copy)]
struct Level {
    /// When the mode began, and the torque by torsion then.
    begun: f64,
    torsion: f64,
    /// Least and greatest torque by torsion since then.
    span: [f64; 2],
    now: f64,
}

/// The newest sample of the gyroscope, rad/s, if it is one.
fn sound_gyro(imu: &ImuMeasured) -> Option<Vector3<f64>> {
    let without = imu.flags & (NOT_USED | measured_flags::STALE | measured_flags::STANDS_IN) != 0;
    (!without).then_some(imu.gyro.into())
}

#[derive(Debug)]
struct Stand {
    balance: Balance,
    footing: Footing,
    /// Place of each joint, in config order, in the model.
    model_index: Vec<usize>,
    /// Of the joints in the order of the model.
    q: Vec<f64>,
    dq: Vec<f64>,
    desired: [Vec<f64>; 3],
    /// Torque limit of each joint, N·m, in config order, and its level; none until it is known.
    levels: Vec<(f64, Option<Level>)>,
    /// How far a joint of a leg that was lifted is beside its reference, rad, in config order: by as much as it was then,
    /// and what keeps the sole parallel to the ground.
    beside: Vec<Option<f64>>,
    outside_s: f64,
    /// How far inside the soles that stay on the ground the capture point was in the last cycle, m.
    reserve: f64,
}

pub(super) fn make(robot: &Robot) -> Made {
    let p = &robot.parameters;
    if robot.cannot_stand().is_some() {
        return Ok(None);
    }
    let feet = p.ft_sensors.iter().enumerate().filter_map(|(s, ft)| {
        let frame = robot.model.frame_index(&ft.sensor.frame)?;
        Some((s, (frame, ft.sole?)))
    });
    let (sensors, feet): (Vec<_>, Vec<_>) = feet.take(MAX_FEET).unzip();
    let limits = p.joints.iter().map(|joint| joint.limits.torque);
    let zeros = || vec![0.0; robot.model.joint_count()];
    let imu = p.imus.first();
    let gyro = imu.and_then(|imu| robot.model.frame_index(&imu.frame));
    let stand = Balance::new(&robot.model, &feet, gyro).map(|balance| Stand {
        balance,
        footing: Footing::new(&sensors),
        model_index: p.joints.iter().map(|joint| joint.model_index).collect(),
        q: zeros(),
        dq: zeros(),
        desired: [zeros(), zeros(), zeros()],
        levels: limits.map(|limit| (limit, None)).collect(),
        beside: vec![None; p.joints.len()],
        outside_s: 0.0,
        reserve: 0.0,
    });
    Ok(stand.map(|stand| Box::new(stand) as Box<dyn ClientMode>))
}

impl ClientMode for Stand {
    fn accepts(&self, bounds: &Bounds, reference: &Reference) -> bool {
        bounds.softened(reference)
            && bounds.motions(reference)
            && self.footing.may_lift(reference.lifted_feet)
    }

    fn set_tasks(&mut self, mut cycle: ModeCycle<'_>) -> Result<(), Unfit> {
        let (asked, seen) = (cycle.asked, cycle.seen);
        if asked.begins {
            self.begin(cycle.body)?;
        }
        let client = (asked.reference.lifted_feet, self.reserve);
        let near = |foot| self.balance.above_ground(foot);
        (self.footing).update(client, cycle.body, near, seen.dt)?;
        cycle.commanded.stands_on = self.footing.stands_on();
        self.take(asked, seen);
        self.level(asked.begins, seen);
        self.balance(asked, seen, cycle.body)?;
        cycle.track(Mode::Stand, asked, |j, follow| self.task(j, follow));
        Ok(())
    }

    fn idle(&mut self, _: &Seen<'_>, commanded: &mut CommandedRecord) {
        commanded.stands_on = 0;
    }
}

impl Stand {
    /// Sets the torques that balance the robot.
    ///
    /// # Errors
    /// There are none, or the robot falls all the same.
    fn balance(
        &mut self,
        asked: &Asked<'_>,
        seen: &Seen<'_>,
        body: &mut RigidBody,
    ) -> Result<(), Unfit> {
        let [q_d, dq_d, ddq_d] = &self.desired;
        let input = BalanceInput {
            q: &self.q,
            dq: &self.dq,
            desired: [q_d, dq_d, ddq_d],
            up: self.footing.up(),
            bears: self.footing.bears(),
            lifts: self.footing.lifts(),
            offset: asked.reference.center_of_mass_offset,
            gyro: sound_gyro(&seen.measured.imu),
            dt: seen.dt,
        };
        let (torques, balanced) = self.balance.update(&input).ok_or(Unfit::Balance)?;
        self.reserve = balanced.reserve;
        let outside = balanced.depth < -OUTSIDE_M;
        let outside_s = time_in_a_row(&mut self.outside_s, outside, seen.dt);
        if !balanced.solved || outside_s > OUTSIDE_S {
            return Err(Unfit::Balance);
        }
        for (own, &place) in body.torques_mut().iter_mut().zip(&self.model_index) {
            let torque = torques.get(place).copied().unwrap_or(0.0);
            *own = RigidBodyTorque::feedforward(torque);
        }
        Ok(())
    }

    /// The task of a joint that tracks its reference: one that carries the robot has no spring.
    fn task(&self, j: usize, mut follow: Follow) -> Task {
        let carries = self.balance.carries(self.model_index[j]);
        let beside = self.beside[j];
        follow.spring = follow.spring.filter(|_| !carries).map(|spring| Spring {
            q_d: spring.q_d + beside.unwrap_or(0.0),
            ..spring
        });
        let (_, level) = self.levels[j];
        let level = level.filter(|_| carries || beside.is_some());
        let feedback = level.map(|level| Feedback::Torsion { offset: level.now });
        Task {
            feedback: feedback.unwrap_or_default(),
            ..follow.into()
        }
    }

    /// Begins on the feet that bear the robot.
    ///
    /// # Errors
    /// No foot bears it.
    fn begin(&mut self, body: &mut RigidBody) -> Result<(), Unfit> {
        self.balance.restart();
        self.beside.fill(None);
        (self.outside_s, self.reserve) = (0.0, 0.0);
        self.footing.begin(body)
    }

    /// Follows the levels of the torques by torsion from those on which they were when the mode began.
    fn level(&mut self, begins: bool, seen: &Seen<'_>) {
        let share = seen.dt / (seen.dt + LEVEL_S);
        let alone = self.footing.stands_on().count_ones() == 1;
        for (j, (limit, level)) in self.levels.iter_mut().enumerate() {
            let torsion = seen.fast.get(j).and_then(|fast| fast.torsion);
            if begins {
                *level = None;
            }
            let Some((levelled, torsion)) = seen.fast_torque(j).zip(torsion) else {
                continue;
            };
            let shown = levelled - torsion;
            let level = level.get_or_insert(Level {
                begun: shown,
                torsion,
                span: [torsion; 2],
                now: shown,
            });
            let [least, most] = level.span;
            level.span = [least.min(torsion), most.max(torsion)];
            let hysteresis = (HYSTERESIS_GROWS * (most - least)).min(HYSTERESIS * *limit);
            let place = self.model_index.get(j).copied().unwrap_or(usize::MAX);
            let bears_alone = alone && self.balance.carries(place);
            let stiffness = if bears_alone { 0.0 } else { STIFFNESS };
            let explained = hysteresis + stiffness * (torsion - level.torsion).abs();
            let goal = shown.clamp(level.begun - explained, level.begun + explained);
            level.now += share * (goal - level.now);
        }
    }

    /// Takes angles, velocities and references in the order of the model.
    fn take(&mut self, asked: &Asked<'_>, seen: &Seen<'_>) {
        let joints = self.model_index.iter().zip(&seen.measured.joints);
        for (j, (&place, measured)) in joints.enumerate() {
            let reference = asked.of_joint(j);
            self.q[place] = measured.q;
            self.dq[place] = seen.velocity(j);
            if let Some(beside) = self.beside.get_mut(j) {
                let lifted =
                    (self.footing.lifted()).any(|(foot, _)| self.balance.is_of(place, foot));
                *beside = lifted.then(|| beside.unwrap_or(measured.q - reference.q_d));
            }
            let [q_d, dq_d, ddq_d] = &mut self.desired;
            q_d[place] = reference.q_d;
            dq_d[place] = reference.dq_d;
            ddq_d[place] = reference.ddq_d;
        }
        for (foot, below) in self.footing.lifted() {
            self.balance.lead_sole(foot, below, |place, rate| {
                let joint = self.model_index.iter().position(|own| *own == place);
                let beside = joint.and_then(|j| self.beside.get_mut(j)?.as_mut());
                if let Some(beside) = beside {
                    *beside += rate * seen.dt;
                }
            });
        }
    }
}
