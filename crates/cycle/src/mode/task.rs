//! Task: what a mode sets one joint to do in a cycle.

use robot_state::Mode;

use super::{Asked, Impedance, RigidBody, RigidBodyTorque};

/// The task of a joint.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Task {
    pub(crate) goal: JointGoal,
    pub(crate) feedback: Feedback,
}

impl Task {
    /// Task of a goal, with the estimated torque as feedback.
    pub(crate) fn of(goal: JointGoal) -> Self {
        Self {
            goal,
            feedback: Feedback::default(),
        }
    }
}

/// What a joint is to do.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) enum JointGoal {
    /// The joint stays where its last command holds it.
    #[default]
    Hold,
    /// The joint is stopped at once, as something has failed.
    Stop,
    /// The joint's limb has met something: it is stopped where its set-point would be at rest, as a joint that came to
    /// rest slowly would press on.
    StopPressing,
    /// The joint follows a desired torque.
    Follow(Follow),
}

/// Torque that the law feeds back, where it feeds back one without delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Feedback {
    /// The estimated one. `pressing`: share, 0 to 1, with which the joint follows the level that F/T sensors show,
    /// as the force of a frame is fed back.
    Estimated { pressing: f64 },
    /// The one by torsion, with this offset, N·m: levels that are newer than a contact are wrong by it.
    Torsion { offset: f64 },
}

impl Default for Feedback {
    fn default() -> Self {
        Self::Estimated { pressing: 0.0 }
    }
}

/// How a joint follows a desired torque.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Follow {
    /// The mode whose torque it is: a joint begins anew when it changes.
    pub(crate) mode: Mode,
    pub(crate) entry: Entry,
    pub(crate) torque: RigidBodyTorque,
    /// Spring and damper towards a desired motion; none: the torque alone.
    pub(crate) spring: Option<Spring>,
    /// Friction that the loop adds.
    pub(crate) bristle: Bristle,
    /// What bounds the velocity.
    pub(crate) speed: Speed,
}

impl Follow {
    /// What a joint follows that tracks its reference by the torque of the rigid bodies and its own spring.
    pub(crate) fn tracking(mode: Mode, asked: &Asked<'_>, body: &RigidBody, joint: usize) -> Self {
        let reference = asked.of_joint(joint);
        Self {
            mode,
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
}

impl From<Follow> for Task {
    fn from(follow: Follow) -> Self {
        Self::of(JointGoal::Follow(follow))
    }
}

/// How a joint begins to follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Entry {
    /// Entry within the time of a change of mode.
    Usual,
    /// Entry within the short time that a contact demands.
    Contact,
    /// Entry as in a contact, and anew in this cycle whatever the joint has followed before.
    ContactAnew,
}

/// Spring and damper.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spring {
    /// Desired position, rad, and velocity, rad/s, at the instant of this cycle.
    pub(crate) q_d: f64,
    pub(crate) dq_d: f64,
    /// Stiffness and damping of the spring; none: the configured ones.
    pub(crate) impedance: Option<Impedance>,
    pub(crate) foresight: Foresight,
}

/// Part of the desired motion that the joint is going to make.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Foresight {
    /// No friction is foreseen, as something else moves the joint.
    None,
    /// Less the softer the joint is asked to be.
    ByDamping,
    /// All of it, as low gains are helped by a torque that was learned.
    All,
}

/// Friction that the loop adds to a joint which nothing brings back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bristle {
    None,
    /// Friction of a joint whose torque a client gives.
    Torque,
    /// Friction of a joint that is let go.
    LetGo,
}

/// What bounds a joint's velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Speed {
    /// The joint's limit, as a desired motion leads it.
    Motion,
    /// The limit that is meant for torques: nothing else bounds the velocity that a torque leads to.
    Torque,
    /// The latter beside the desired velocity, rad/s: against a soft spring an error of the torque leads to it.
    TorqueBeside(f64),
}
