//! Torque: the joints follow `tau_d` of the client.

use robot_config::Robot;
use robot_state::{Mode, Reference};

use super::{
    Bounds, Bristle, ClientMode, Entry, Follow, Made, ModeCycle, RigidBodyTorque, Speed, Unfit,
};

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

    fn set_tasks(&mut self, cycle: ModeCycle<'_>) -> Result<(), Unfit> {
        for (task, joint) in cycle.tasks.iter_mut().zip(&cycle.asked.reference.joints) {
            *task = Follow {
                mode: Mode::Torque,
                entry: Entry::Usual,
                torque: RigidBodyTorque::feedforward(joint.tau_d),
                spring: None,
                bristle: Bristle::Torque,
                speed: Speed::Torque,
            }
            .into();
        }
        Ok(())
    }
}
