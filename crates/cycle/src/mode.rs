//! Mode: what the robot is asked to do, as a task for each joint.
//!
//! In: the goal that was decided on, what is measured and estimated. Out: a [`Task`] for each joint. A mode is a
//! file here behind [`ClientMode`]: what it needs of the robot, which references it accepts, whether it may go on,
//! and the tasks that it sets. [`MODES`] lists them; nothing beside its file knows a mode by name. The reaction to a
//! contact ([`contact`]) sets tasks as well, though no client asks for it.

mod cartesian;
mod contact;
mod impedance;
mod inverse_dynamics;
mod low_gain;
mod passive;
mod position;
mod reference;
mod rigid_body;
mod stand;
mod task;
mod torque;
mod torque_feedback;
mod velocity;

use core::fmt;

use problem::Problem;
use robot_config::Robot;
use robot_state::{
    CommandedRecord, Event, JointReference, MeasuredRecord, Mode, Reference, source,
};

use crate::events::{Counts, Subject};
use crate::inputs::Seen;
use contact::Contact;
use reference::ReferenceCheck;
use rigid_body::RigidBody;

pub(crate) use impedance::Impedance;
pub(crate) use reference::Bounds;
pub(crate) use rigid_body::RigidBodyTorque;
pub(crate) use task::{
    Bristle, Entry, Feedback, Follow, Foresight, JointGoal, Speed, Spring, Task,
};

/// How a joint in contact is answered by its limb.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Answer {
    /// The limb is braked at once.
    Stop,
    /// The limb goes soft.
    Comply,
    /// The limb goes back on its way.
    Retract,
}

/// The goal of one cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Goal<'a> {
    /// Every joint in use stays where its last command holds it.
    Hold,
    /// Every joint is stopped at once, as something has failed: matters to drives without a position loop.
    Stop,
    /// The limb of a joint in contact answers it; all else stops.
    Contact { joint: usize, answer: Answer },
    /// A client's mode follows its checked reference.
    Follow(Mode, &'a Reference),
}

impl Goal<'_> {
    /// The mode that clients see.
    pub(crate) fn mode(&self) -> Mode {
        match self {
            Self::Hold | Self::Stop | Self::Contact { .. } => Mode::Hold,
            Self::Follow(mode, _) => *mode,
        }
    }

    pub(crate) fn is_followed(&self) -> bool {
        matches!(self, Self::Follow(..))
    }
}

/// What a client asks for in one cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asked<'a> {
    pub(crate) reference: &'a Reference,
    /// Age of the reference, s: its values are for the time at which it was sent.
    pub(crate) age_s: f64,
    /// The mode was not followed in the last cycle.
    pub(crate) begins: bool,
}

impl<'a> Asked<'a> {
    /// A reference that the loop has planned for this cycle.
    pub(crate) fn planned(reference: &'a Reference) -> Self {
        Self {
            reference,
            age_s: 0.0,
            begins: false,
        }
    }

    /// The reference of a joint at the instant of this cycle.
    pub(crate) fn of_joint(&self, joint: usize) -> JointReference {
        let asked = self.reference.joints.get(joint);
        asked.map_or(JointReference::default(), |asked| JointReference {
            q_d: asked.q_d + asked.dq_d * self.age_s,
            ..*asked
        })
    }

    /// Stiffness and damping that the client gives a joint; none: the configured ones.
    pub(crate) fn impedance(&self, joint: usize) -> Option<Impedance> {
        let given = self.reference.gains_given == 1;
        let asked = self.reference.joints.get(joint).filter(|_| given);
        asked.map(Impedance::of)
    }
}

/// A cycle in which a mode is followed.
#[derive(Debug)]
pub(crate) struct ModeCycle<'a> {
    pub(crate) asked: &'a Asked<'a>,
    pub(crate) seen: &'a Seen<'a>,
    pub(crate) body: &'a mut RigidBody,
    pub(crate) commanded: &'a mut CommandedRecord,
    /// To be set, for each joint.
    pub(crate) tasks: &'a mut [Task],
}

impl ModeCycle<'_> {
    /// Has each joint track its reference by the torque of the rigid bodies, as `of` changes that.
    fn track<T: Into<Task>>(
        &mut self,
        mode: Mode,
        asked: &Asked<'_>,
        mut of: impl FnMut(usize, Follow) -> T,
    ) {
        for (j, task) in self.tasks.iter_mut().enumerate() {
            *task = of(j, Follow::tracking(mode, asked, self.body, j)).into();
        }
    }
}

/// A bit for each joint, in config order.
pub(crate) type JointBits = u64;

/// That for which a mode must not go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Unfit {
    /// Joints.
    Joints(JointBits),
    /// Feet that do not bear the robot, or whose sensors do not show that they do: a bit for each F/T sensor, in config
    /// order.
    FtSensors(u64),
    /// The feet do not hold the robot's centre of mass.
    Balance,
    /// The ground turns under feet that stand still, as the first IMU shows it.
    Imu,
}

impl Unfit {
    fn count(self, counts: &mut Counts) {
        let (bits, subject): (u64, fn(usize) -> Subject) = match self {
            Self::Joints(bits) => (bits, Subject::Joint),
            Self::FtSensors(bits) => (bits, Subject::FtSensor),
            Self::Balance => {
                counts.add(Event::ReferenceRejected);
                return;
            }
            Self::Imu => (1, Subject::Imu),
        };
        for index in (0..64).filter(|index| bits >> index & 1 == 1) {
            counts.add_of(Event::ReferenceRejected, subject(index));
        }
    }
}

/// A mode that clients may ask for.
pub(crate) trait ClientMode: fmt::Debug + Send {
    /// Bits of the sources that the mode needs besides those of torque feedback.
    fn needs(&self) -> u32 {
        source::WHOLE_BODY
    }

    /// Joints and sensors can have every value of the reference that the mode uses.
    fn accepts(&self, bounds: &Bounds, reference: &Reference) -> bool {
        bounds.softened(reference) && bounds.motions(reference) && bounds.wrenches(reference)
    }

    /// The desired position of a joint is followed from cycle to cycle: it must begin where the joint is, and
    /// move no faster than it may.
    fn paces(&self, _reference: &Reference, _joint: usize) -> bool {
        true
    }

    /// Takes a reference with which the mode begins, or another one that follows.
    ///
    /// # Errors
    /// The flaw that forbids to follow it after those before.
    fn takes(&mut self, _: &Reference, _begins: bool, _: &MeasuredRecord) -> Result<(), Event> {
        Ok(())
    }

    /// Sets each joint's task.
    ///
    /// # Errors
    /// That for which the mode must not go on: all joints stop.
    fn set_tasks(&mut self, cycle: ModeCycle<'_>) -> Result<(), Unfit>;

    /// Another mode is followed in this cycle, or none.
    fn idle(&mut self, _: &Seen<'_>, _: &mut CommandedRecord) {}

    /// Time until the robot is at the target of a planned motion, s; 0 without one.
    fn motion_left_s(&self) -> f64 {
        0.0
    }
}

type Made = Result<Option<Box<dyn ClientMode>>, Problem>;
/// A mode's number, and what makes it, or nothing for a robot that has no such mode.
type Row = (Mode, fn(&Robot) -> Made);

/// Every mode that clients may ask for.
const MODES: &[Row] = &[
    (Mode::Torque, torque::make),
    (Mode::InverseDynamics, inverse_dynamics::make),
    (Mode::Position, position::make),
    (Mode::Cartesian, cartesian::make),
    (Mode::Passive, passive::make),
    (Mode::TorqueFeedbackMotion, torque_feedback::make),
    (Mode::LowGainTracking, low_gain::make),
    (Mode::Velocity, velocity::make),
    (Mode::Stand, stand::make),
];

/// The modes of a robot, and the tasks that they set.
#[derive(Debug)]
pub(crate) struct Modes {
    modes: [Option<Box<dyn ClientMode>>; Mode::ALL.len()],
    contact: Contact,
    references: ReferenceCheck,
    body: RigidBody,
    /// Bits of the sources that torque feedback needs.
    feedback: u32,
    /// The mode of the last cycle.
    last: Mode,
    tasks: Vec<Task>,
}

impl Modes {
    /// # Errors
    /// A mode that the robot's parameters do not allow for, but for one that it does not have.
    pub(crate) fn new(robot: &Robot) -> Result<Self, Problem> {
        let mut modes = [const { None }; Mode::ALL.len()];
        for &(mode, make) in MODES {
            if let Some(place) = modes.get_mut(mode.number() as usize) {
                *place = make(robot)?;
            }
        }
        Ok(Self {
            modes,
            contact: Contact::new(robot),
            references: ReferenceCheck::new(robot),
            body: RigidBody::new(robot),
            feedback: feedback_needs(robot),
            last: Mode::Hold,
            tasks: vec![Task::default(); robot.parameters.joints.len()],
        })
    }

    /// Bits of the sources that a mode needs; none: the robot has no such mode.
    pub(crate) fn needs(&self, mode: Mode) -> Option<u32> {
        if mode == Mode::Hold {
            return Some(0);
        }
        let own = self.modes.get(mode.number() as usize)?.as_ref()?;
        Some(own.needs() | self.feedback)
    }

    /// The goal that a reference asks for; the only place where a mode's number is read.
    ///
    /// # Errors
    /// The flaw that forbids to follow the reference.
    pub(crate) fn goal<'a>(&self, reference: &'a Reference) -> Result<Goal<'a>, Event> {
        let mode = Mode::from_number(reference.mode).ok_or(Event::ReferenceRejected)?;
        self.references.is_sound(reference)?;
        let own = self
            .modes
            .get(mode.number() as usize)
            .and_then(Option::as_deref);
        match own {
            None if mode == Mode::Hold => Ok(Goal::Hold),
            // A mode that the robot does not have is not possible; its reference is not wrong for that.
            None => Ok(Goal::Follow(mode, reference)),
            Some(own) if own.accepts(self.references.bounds(), reference) => {
                Ok(Goal::Follow(mode, reference))
            }
            Some(_) => Err(Event::ReferenceLimit),
        }
    }

    /// Takes the references of a mode one after the other; `begins`: the mode does.
    ///
    /// # Errors
    /// The flaw that forbids to follow this one after those before.
    pub(crate) fn take(
        &mut self,
        goal: &Goal<'_>,
        begins: bool,
        measured: &MeasuredRecord,
    ) -> Result<(), Event> {
        self.references.count_cycle();
        let Goal::Follow(mode, reference) = goal else {
            return Ok(());
        };
        let Some(Some(own)) = self.modes.get_mut(mode.number() as usize) else {
            return Ok(());
        };
        self.references
            .take(own.as_mut(), reference, begins, measured)
    }

    /// Sets each joint's task in this cycle.
    pub(crate) fn set_tasks(
        &mut self,
        goal: &Goal<'_>,
        seen: &Seen<'_>,
        commanded: &mut CommandedRecord,
        counts: &mut Counts,
    ) {
        let before = core::mem::replace(&mut self.last, goal.mode());
        self.contact.update(goal, seen);
        self.body.observe(seen);
        for (mode, own) in Mode::ALL.iter().zip(&mut self.modes) {
            if let Some(own) = own.as_mut().filter(|_| *mode != goal.mode()) {
                own.idle(seen, commanded);
            }
        }
        match goal {
            Goal::Hold => self.tasks.fill(Task::of(JointGoal::Hold)),
            Goal::Stop => self.tasks.fill(Task::of(JointGoal::Stop)),
            Goal::Contact { .. } => {
                (self.contact).set_tasks(seen, &mut self.body, &mut self.tasks);
            }
            Goal::Follow(mode, reference) => {
                let asked = Asked {
                    reference,
                    age_s: seen.age_s,
                    begins: before != *mode,
                };
                let Some(Some(own)) = self.modes.get_mut(mode.number() as usize) else {
                    self.tasks.fill(Task::of(JointGoal::Stop));
                    return;
                };
                let cycle = ModeCycle {
                    asked: &asked,
                    seen,
                    body: &mut self.body,
                    commanded,
                    tasks: &mut self.tasks,
                };
                if let Err(unfit) = own.set_tasks(cycle) {
                    unfit.count(counts);
                    self.tasks.fill(Task::of(JointGoal::Stop));
                }
            }
        }
    }

    /// The task of each joint, in config order.
    pub(crate) fn tasks(&self) -> &[Task] {
        &self.tasks
    }

    /// A joint follows a desired torque in this cycle.
    pub(crate) fn follow(&self) -> bool {
        let mut goals = self.tasks.iter().map(|task| task.goal);
        goals.any(|goal| matches!(goal, JointGoal::Follow(_)))
    }

    /// Joints that nothing but a torque has held since the last cycle.
    pub(crate) fn held_by_torque_alone(&self) -> JointBits {
        let alone = |task: &Task| match task.goal {
            JointGoal::Follow(follow) => follow.bristle != Bristle::None,
            JointGoal::Hold | JointGoal::Stop | JointGoal::StopPressing => false,
        };
        let tasks = self.tasks.iter().enumerate();
        let alone = tasks.filter(|(_, task)| alone(task));
        alone.fold(0, |bits, (j, _)| bits | 1 << (j & 63))
    }

    /// Time until the robot is at the target of a planned motion, s; 0 without one.
    pub(crate) fn motion_left_s(&self) -> f64 {
        let own = self.modes.iter().flatten().map(|mode| mode.motion_left_s());
        own.fold(self.contact.motion_left_s(), f64::max)
    }
}

/// Bits of the sources whose torques are fed back.
fn feedback_needs(robot: &Robot) -> u32 {
    let law = robot.parameters.torque_law;
    let joints = &robot.parameters.joints;
    let bits = |used: bool, bits: u32| if used { bits } else { 0 };
    let by_encoders = law.uses_encoders() && joints.iter().any(|j| j.has_link_encoder);
    let by_sensors = law.uses_sensors() || joints.iter().any(|j| !j.has_link_encoder);
    bits(by_encoders, source::ENCODER_TORQUE) | bits(by_sensors, source::WHOLE_BODY)
}
