//! Inverse dynamics: the joints follow `q_d dq_d ddq_d` and contact wrenches of the client (D12).

use robot_config::Robot;
use robot_state::{CommandedRecord, Mode, Reference};

use super::{
    Asked, Bounds, Bristle, ClientMode, Entry, Follow, Foresight, JointGoal, Made, RigidBody,
    Speed, Spring, Task, Unfit,
};
use crate::inputs::Seen;

/// See the module.
#[derive(Debug)]
struct InverseDynamics;

pub(super) fn make(_: &Robot) -> Made {
    Ok(Some(Box::new(InverseDynamics)))
}

impl ClientMode for InverseDynamics {
    fn accepts(&self, bounds: &Bounds, reference: &Reference) -> bool {
        bounds.softened(reference) && bounds.motions(reference) && bounds.wrenches(reference)
    }

    fn set_tasks(
        &mut self,
        asked: &Asked<'_>,
        seen: &Seen<'_>,
        body: &mut RigidBody,
        _: &mut CommandedRecord,
        tasks: &mut [Task],
    ) -> Result<(), Unfit> {
        body.follow(asked.reference, seen);
        for (j, task) in tasks.iter_mut().enumerate() {
            *task = Task::of(JointGoal::Follow(tracking(asked, body, j)));
        }
        Ok(())
    }
}

/// What a joint follows that tracks its reference by the torque of the rigid bodies and its own spring.
pub(super) fn tracking(asked: &Asked<'_>, body: &RigidBody, joint: usize) -> Follow {
    let reference = asked.of_joint(joint);
    Follow {
        mode: Mode::InverseDynamics,
        entry: Entry::Usual,
        torque: body.torque(joint),
        spring: Some(Spring {
            q_d: reference.q_d,
            dq_d: reference.dq_d,
            impedance: asked.impedance(joint),
            foresight: Foresight::ByDamping,
        }),
        bristle: Bristle::None,
        speed: Speed::Motion,
    }
}
