//! Stand: the robot stands on the feet that bear it, its centre of mass over them.
//!
//! Legs follow the torques of [`control::Balance`] and no spring of their own; all other joints follow `q_d dq_d ddq_d`
//! as in mode inverse dynamics, and legs that bear nothing as well. What is fast in the torques follows from the joints'
//! angles alone. F/T sensors and IMU show slowly which feet bear the robot and where up is. Nothing else of them enters:
//! the torque that is fed back is that by torsion, on the level that F/T sensors had shown when the mode began, and what
//! they show since then as far as a gear explains it. A leg has no spring: an F/T sensor that steps by 10 N·m, and is
//! believed, moves it by 6 degrees.

use control::{Balance, BalanceInput, MAX_FEET};
use nalgebra::Vector3;
use robot_config::Robot;
use robot_state::{CommandedRecord, Mode, Reference};

use super::inverse_dynamics::tracking;
use super::{
    Asked, Bounds, ClientMode, Feedback, Follow, JointGoal, Made, RigidBody, RigidBodyTorque, Task,
    Unfit,
};
use crate::inputs::Seen;

/// How far outside the soles the capture point may be, m, and for how long, s: where it stays longer the robot falls.
/// Chosen on the simulated humanoid: what soles and angles are known by.
const OUTSIDE_M: f64 = 0.03;
const OUTSIDE_S: f64 = 0.1;
/// Time for which a foot may bear nothing, s: in a push it may be lighter than [`control::Balance`] wants it. Chosen on
/// the simulated humanoid, pushed by 60 N.
const LIFTED_S: f64 = 0.2;

/// Change of a level that a gear explains: its hysteresis, share of the torque limit, and its stiffness, share of the
/// change of the torque. What is beyond is an F/T sensor's, and not followed. Chosen on gears of two worlds, whose
/// hysteresis is 0.7 and 1.5 % and whose stiffness 7 % other than configured (docs/results/standing.md).
const HYSTERESIS: f64 = 0.015;
const STIFFNESS: f64 = 0.1;
/// Time constant with which a level is followed and left, s: a torque does not step. Chosen; no experiment recorded.
const LEVEL_S: f64 = 0.05;

/// Time for which a foot must have stood until where up is in its axes is not taken anew, s: up is a mean since then.
/// Chosen; no experiment recorded.
const KNOWN_S: f64 = 1.0;
/// Turn of up in the axes of every foot since it was taken at which the mode ends, rad: the IMU errs, or the ground tilts.
/// Chosen: 1 degree, the bound of what a fault may move. Pushes of 60 N turn it by less than 0.6 degrees in two worlds
/// (docs/results/standing.md).
const TILTED: f64 = core::f64::consts::PI / 180.0;

/// Offset that is added to a joint's torque by torsion, N·m.
#[derive(Debug, Clone, Copy)]
struct Level {
    /// When the mode began, and the torque by torsion then.
    begun: f64,
    torsion: f64,
    now: f64,
}

/// See the module.
#[derive(Debug)]
struct Stand {
    balance: Balance,
    /// F/T sensor of each foot.
    sensors: Vec<usize>,
    /// Feet on which the robot stands since the mode began.
    stands_on: [bool; MAX_FEET],
    /// Up in the axes of their sensors as it was taken, and for how long they bear nothing, s.
    up: [Vector3<f64>; MAX_FEET],
    lifted_s: [f64; MAX_FEET],
    /// Place of each joint, in config order, in the model.
    model_index: Vec<usize>,
    /// Of the joints in the order of the model.
    q: Vec<f64>,
    dq: Vec<f64>,
    desired: [Vec<f64>; 3],
    /// Torque limit of each joint, N·m, in config order, and its level; none until it is known.
    levels: Vec<(f64, Option<Level>)>,
    outside_s: f64,
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
    let stand = Balance::new(&robot.model, &feet).map(|balance| Stand {
        balance,
        sensors,
        stands_on: [false; MAX_FEET],
        up: [Vector3::z(); MAX_FEET],
        lifted_s: [0.0; MAX_FEET],
        model_index: p.joints.iter().map(|joint| joint.model_index).collect(),
        q: zeros(),
        dq: zeros(),
        desired: [zeros(), zeros(), zeros()],
        levels: limits.map(|limit| (limit, None)).collect(),
        outside_s: 0.0,
    });
    Ok(stand.map(|stand| Box::new(stand) as Box<dyn ClientMode>))
}

impl ClientMode for Stand {
    fn accepts(&self, bounds: &Bounds, reference: &Reference) -> bool {
        bounds.softened(reference) && bounds.motions(reference)
    }

    fn set_tasks(
        &mut self,
        asked: &Asked<'_>,
        seen: &Seen<'_>,
        body: &mut RigidBody,
        _: &mut CommandedRecord,
        tasks: &mut [Task],
    ) -> Result<(), Unfit> {
        let up = self.ground(asked.begins, body, seen.dt)?;
        self.take(asked, seen);
        self.level(asked.begins, seen);
        let [q_d, dq_d, ddq_d] = &self.desired;
        let input = BalanceInput {
            q: &self.q,
            dq: &self.dq,
            desired: [q_d, dq_d, ddq_d],
            up,
            offset: asked.reference.center_of_mass_offset,
            dt: seen.dt,
        };
        let (torques, balanced) = self.balance.update(&input).ok_or(Unfit::Balance)?;
        let outside = balanced.depth < -OUTSIDE_M;
        self.outside_s = if outside {
            self.outside_s + seen.dt
        } else {
            0.0
        };
        if !balanced.solved || self.outside_s > OUTSIDE_S {
            return Err(Unfit::Balance);
        }
        for (own, &place) in body.torques_mut().iter_mut().zip(&self.model_index) {
            let torque = torques.get(place).copied().unwrap_or(0.0);
            *own = RigidBodyTorque::feedforward(torque);
        }
        for (j, (task, &place)) in tasks.iter_mut().zip(&self.model_index).enumerate() {
            let follow = Follow {
                mode: Mode::Stand,
                ..tracking(asked, body, j)
            };
            let carries = self.balance.carries(place);
            let spring = follow.spring.filter(|_| !carries);
            let level = self.levels.get(j).and_then(|(_, level)| *level);
            *task = Task {
                feedback: level
                    .filter(|_| carries)
                    .map_or(Feedback::default(), |level| Feedback::Torsion {
                        offset: level.now,
                    }),
                ..Task::of(JointGoal::Follow(Follow { spring, ..follow }))
            };
        }
        Ok(())
    }
}

impl Stand {
    /// Up in the axes of each foot on which the robot stands: of those that bear it when the mode begins. A foot stands
    /// still, so up in its axes does too, and is not taken anew once it is known.
    ///
    /// # Errors
    /// No foot bears the robot, or one does no more. Up turns under every foot.
    fn ground(
        &mut self,
        begins: bool,
        body: &RigidBody,
        dt: f64,
    ) -> Result<[Option<Vector3<f64>>; MAX_FEET], Unfit> {
        let mut up = [None; MAX_FEET];
        let mut lost = 0;
        let mut least_turned = f64::INFINITY;
        for (foot, &sensor) in self.sensors.iter().enumerate() {
            let under = body.ground_under(sensor);
            if begins {
                self.stands_on[foot] = under.is_some();
            }
            if let Some(under) = under.filter(|_| begins || body.stands_for(sensor) < KNOWN_S) {
                self.up[foot] = under;
            }
            let lifted = if under.is_some() {
                0.0
            } else {
                self.lifted_s[foot] + dt
            };
            self.lifted_s[foot] = lifted;
            if self.stands_on[foot] {
                up[foot] = Some(self.up[foot]);
                let turned = under.map_or(0.0, |under| (under - self.up[foot]).norm());
                least_turned = least_turned.min(turned);
            }
            if self.stands_on[foot] && lifted > LIFTED_S {
                lost |= 1 << sensor;
            }
        }
        if begins {
            self.balance.restart();
            self.outside_s = 0.0;
            if up.iter().all(Option::is_none) {
                lost = self.sensors.iter().fold(0, |bits, s| bits | 1 << s);
            }
        }
        if lost != 0 {
            Err(Unfit::FtSensors(lost))
        } else if least_turned > TILTED {
            Err(Unfit::Imu)
        } else {
            Ok(up)
        }
    }

    /// Follows the levels of the torques by torsion from those on which they were when the mode began.
    fn level(&mut self, begins: bool, seen: &Seen<'_>) {
        let share = seen.dt / (seen.dt + LEVEL_S);
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
                now: shown,
            });
            let explained = HYSTERESIS * *limit + STIFFNESS * (torsion - level.torsion).abs();
            let explains = (shown - level.begun).abs() <= explained;
            let goal = if explains { shown } else { level.begun };
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
            let [q_d, dq_d, ddq_d] = &mut self.desired;
            q_d[place] = reference.q_d;
            dq_d[place] = reference.dq_d;
            ddq_d[place] = reference.ddq_d;
        }
    }
}
