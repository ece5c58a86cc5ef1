//! Torque: the joints follow `tau_d` of the client.

use robot_config::Robot;
use robot_state::{CommandedRecord, Mode, Reference};

use super::{
    Asked, Bounds, Bristle, ClientMode, Entry, Follow, JointGoal, Made, RigidBody, RigidBodyTorque,
    Speed, Task, Unfit,
};
use crate::inputs::Seen;

/// See the module.
#[derive(Debug)]
struct Torque;

pub(super) fn make(_: &Robot) -> Made {
    Ok(Some(Box::new(Torque)))
}

impl ClientMode for Torque {
    fn needs(&self) -> u32 {
        0
    }

    fn accepts(&self, bounds: &Bounds, reference: &Reference) -> bool {
        bounds.torques(reference)
    }

    fn paces(&self, _: &Reference, _: usize) -> bool {
        false
    }

    fn set_tasks(
        &mut self,
        asked: &Asked<'_>,
        _: &Seen<'_>,
        _: &mut RigidBody,
        _: &mut CommandedRecord,
        tasks: &mut [Task],
    ) -> Result<(), Unfit> {
        for (task, joint) in tasks.iter_mut().zip(&asked.reference.joints) {
            *task = Task::of(JointGoal::Follow(Follow {
                mode: Mode::Torque,
                entry: Entry::Usual,
                torque: RigidBodyTorque::feedforward(joint.tau_d),
                spring: None,
                bristle: Bristle::Torque,
                speed: Speed::Torque,
            }));
        }
        Ok(())
    }
}
