//! Passive: joints that are not held give way to any hand (Z IV-C).
//!
//! Of a joint that is let go the torque is that of weight and inertial forces, and of no contact; its stiffness is
//! zero and its damping the share `passive_damping_per_cent`. Joints that are held follow `q_d dq_d`.

use robot_config::Robot;
use robot_state::{CommandedRecord, Mode, Reference};

use super::{
    Bounds, Bristle, ClientMode, Follow, Foresight, Impedance, Made, ModeCycle, RigidBodyTorque,
    Speed, Spring, Unfit,
};
use crate::inputs::Seen;

/// Torque of contacts on a joint, of its limit, from which on it bears: let go, its limb would give way.
/// Chosen; no experiment recorded.
const BEARS: f64 = 0.1;

#[derive(Debug)]
struct Joint {
    torque_limit: f64,
    /// The joint was let go in the last cycle.
    is_free: bool,
    /// q_d at which it was held last in this mode, rad.
    held_at: f64,
    impedance: Impedance,
}

#[derive(Debug)]
struct Passive {
    joints: Vec<Joint>,
}

pub(super) fn make(robot: &Robot) -> Made {
    let p = &robot.parameters;
    let joints = p.joints.iter().map(|joint| Joint {
        torque_limit: joint.limits.torque,
        is_free: false,
        held_at: 0.0,
        impedance: Impedance {
            stiffness: 0.0,
            damping: p.modes.passive_damping * joint.gains.k_d,
        },
    });
    Ok(Some(Box::new(Passive {
        joints: joints.collect(),
    })))
}

/// A joint is let go: it is not among those that are held.
fn is_let_go(reference: &Reference, joint: usize) -> bool {
    reference.held_joints >> (joint & 63) & 1 == 0
}

impl ClientMode for Passive {
    fn accepts(&self, bounds: &Bounds, reference: &Reference) -> bool {
        bounds.softened(reference) && bounds.motions_of(reference, |j| !is_let_go(reference, j))
    }

    fn paces(&self, reference: &Reference, joint: usize) -> bool {
        !is_let_go(reference, joint)
    }

    fn set_tasks(&mut self, cycle: ModeCycle<'_>) -> Result<(), Unfit> {
        let (asked, body) = (cycle.asked, cycle.body);
        body.rest(cycle.seen);
        body.update_contacts(cycle.seen);
        let mut bears = 0;
        for (j, (own, task)) in self.joints.iter_mut().zip(cycle.tasks).enumerate() {
            let was_free = core::mem::replace(&mut own.is_free, is_let_go(asked.reference, j));
            let mut follow = Follow::tracking(Mode::Passive, asked, body, j);
            if own.is_free {
                let free = body.free(j);
                let contact = body.by_contacts(j).abs();
                if contact > BEARS * own.torque_limit && !was_free {
                    bears |= 1 << j;
                }
                // A joint that was just let go goes soft at the place at which it was held: nobody has checked what its
                // reference asks for now.
                follow = Follow {
                    torque: RigidBodyTorque {
                        feedforward: free,
                        ..follow.torque
                    },
                    spring: Some(Spring {
                        q_d: own.held_at,
                        dq_d: 0.0,
                        impedance: Some(own.impedance),
                        foresight: Foresight::None,
                    }),
                    bristle: Bristle::LetGo,
                    speed: Speed::Torque,
                    ..follow
                };
            } else {
                let asked = asked.reference.joints.get(j);
                own.held_at = asked.map_or(own.held_at, |asked| asked.q_d);
            }
            *task = follow.into();
        }
        if bears == 0 {
            Ok(())
        } else {
            Err(Unfit::Joints(bears))
        }
    }

    fn idle(&mut self, _: &Seen<'_>, _: &mut CommandedRecord) {
        for joint in &mut self.joints {
            joint.is_free = false;
        }
    }
}
