//! Velocity: the joints follow `dq_d` of the client, by inverse dynamics.
//!
//! Velocities may come at any pace, as from a joystick or a servo node: the loop leads to them within the limits of
//! acceleration and jerk, and brakes before position limits (K).

use control::{PlannedMotion, VelocityPlanner, VelocityStream};
use robot_config::Robot;
use robot_state::{CommandedRecord, Mode, Reference};

use super::inverse_dynamics::tracking;
use super::{Asked, Bounds, ClientMode, Follow, JointBits, JointGoal, Made, RigidBody, Task};
use crate::inputs::Seen;

/// For rounding of velocities that are meant to be the limit.
const ROUNDING: f64 = 1.001;

/// See the module.
#[derive(Debug)]
struct Velocity {
    joints: Vec<VelocityStream>,
    /// Greatest velocity of each joint, rad/s.
    most: Vec<f64>,
    planner: VelocityPlanner,
}

pub(super) fn make(robot: &Robot) -> Made {
    let p = &robot.parameters;
    let joints = p.joints.iter().zip(p.motion_limits());
    let joints = joints.map(|(joint, limits)| VelocityStream::new(limits, joint.desired_range()));
    Ok(Some(Box::new(Velocity {
        joints: joints.collect(),
        most: p.joints.iter().map(|joint| joint.limits.velocity).collect(),
        planner: VelocityPlanner::new(),
    })))
}

impl ClientMode for Velocity {
    fn accepts(&self, bounds: &Bounds, reference: &Reference) -> bool {
        let mut joints = self.most.iter().zip(&reference.joints);
        bounds.softened(reference)
            && joints.all(|(most, asked)| asked.dq_d.abs() <= most * ROUNDING)
    }

    /// Nothing but the velocity is followed, and that is led to.
    fn paces(&self, _: &Reference, _: usize) -> bool {
        false
    }

    fn set_tasks(
        &mut self,
        asked: &Asked<'_>,
        seen: &Seen<'_>,
        body: &mut RigidBody,
        _: &mut CommandedRecord,
        tasks: &mut [Task],
    ) -> Result<(), JointBits> {
        if asked.begins {
            for (joint, measured) in self.joints.iter_mut().zip(&seen.measured.joints) {
                joint.start(PlannedMotion {
                    q: measured.q,
                    dq: measured.dq,
                    ddq: 0.0,
                });
            }
        }
        let mut reference = *asked.reference;
        for (joint, desired) in self.joints.iter_mut().zip(&mut reference.joints) {
            let next = joint.advance(&mut self.planner, desired.dq_d, seen.dt);
            (desired.q_d, desired.dq_d, desired.ddq_d) = (next.q, next.dq, next.ddq);
        }
        reference.contact_wrench_given = 0;
        body.follow(&reference, seen, &seen.contact_wrenches());
        let planned = Asked {
            reference: &reference,
            age_s: 0.0,
            ..*asked
        };
        for (j, task) in tasks.iter_mut().enumerate() {
            *task = Task::of(JointGoal::Follow(Follow {
                mode: Mode::Velocity,
                ..tracking(&planned, body, j)
            }));
        }
        Ok(())
    }
}
