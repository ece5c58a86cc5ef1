//! Decide: the mode of the robot, and whether a client's reference is followed.
//!
//! ```text
//!            reference asks for a mode, joints ready
//!   ┌──────┐ ───────────────────────────────────────► ┌────────────────────────┐
//!   │ hold │                                          │ torque                 │
//!   └──────┘ ◄─────────────────────────────────────── │ inverse dynamics       │
//!      ▲ ▲      reference asks for hold               └────────────────────────┘
//!      │ └─ blocked: reference stale, not finite, refused ◄────┘   │
//!      │      until the client has asked for hold once             │
//!      └─── fault latched: until a client resets it ◄──────────────┘
//! ```

use robot_state::{Event, Mode, Reaction, Reference, Settings};

use crate::events::Counts;
use crate::measure::Readiness;

/// Clients' input to one cycle, as it arrived: unchecked.
#[derive(Debug, Clone, Copy, Default)]
pub struct ClientInput<'a> {
    /// The newest reference, if a client commands.
    pub reference: Option<&'a Reference>,
    /// Age of that reference, s.
    pub age_s: f64,
    /// The settings in use; none: those of the configuration.
    pub settings: Option<&'a Settings>,
}

/// The goal of one cycle: a mode, with the checked reference that it follows.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Goal<'a> {
    Hold,
    Torque(&'a Reference),
    InverseDynamics(&'a Reference),
}

impl<'a> Goal<'a> {
    pub(crate) fn mode(&self) -> Mode {
        match self {
            Self::Hold => Mode::Hold,
            Self::Torque(_) => Mode::Torque,
            Self::InverseDynamics(_) => Mode::InverseDynamics,
        }
    }

    pub(crate) fn reference(&self) -> Option<&'a Reference> {
        match *self {
            Self::Hold => None,
            Self::Torque(reference) | Self::InverseDynamics(reference) => Some(reference),
        }
    }
}

/// The mode, and the memory that leads to it.
#[derive(Debug)]
pub(crate) struct Supervisor {
    joint_count: u32,
    reference_timeout_s: f64,
    mode: Mode,
    fault: Option<Event>,
    blocked: bool,
    last_sequence: Option<u64>,
}

impl Supervisor {
    pub(crate) fn new(joint_count: usize, reference_timeout_s: f64) -> Self {
        Self {
            joint_count: joint_count as u32,
            reference_timeout_s,
            mode: Mode::Hold,
            fault: None,
            blocked: false,
            last_sequence: None,
        }
    }

    pub(crate) fn mode(&self) -> Mode {
        self.mode
    }

    /// The latched fault's number, or 0.
    pub(crate) fn fault_number(&self) -> u32 {
        self.fault.map_or(0, Event::number)
    }

    /// Settles the mode of this cycle, and the reference that it follows.
    pub(crate) fn decide<'a>(
        &mut self,
        client: &ClientInput<'a>,
        readiness: Readiness,
        counts: &mut Counts,
    ) -> Goal<'a> {
        if readiness.stale && self.fault.is_none() {
            self.report(Event::JointStale, counts);
        }
        let mut goal = Goal::Hold;
        if let Some((asked, reference)) = self.checked(client, counts) {
            if reference.reset_fault == 1 && !readiness.stale {
                self.fault = None;
            }
            if asked.mode() == Mode::Hold {
                self.blocked = false;
            }
            if self.fault.is_none() && !self.blocked && readiness.ready {
                goal = asked;
            }
        }
        self.mode = goal.mode();
        goal
    }

    /// Counts an event and reacts to it.
    pub(crate) fn report(&mut self, event: Event, counts: &mut Counts) {
        counts.add(event);
        match event.reaction() {
            Reaction::Count => {}
            Reaction::Hold => self.block(),
            Reaction::Fault => {
                self.fault.get_or_insert(event);
                self.block();
            }
        }
    }

    fn block(&mut self) {
        self.blocked = true;
        self.mode = Mode::Hold;
    }

    /// The reference and the goal that it asks for, unless a flaw forbids to follow it. A flaw is
    /// counted once for each message, not once for each cycle in which the message is the newest.
    fn checked<'a>(
        &mut self,
        client: &ClientInput<'a>,
        counts: &mut Counts,
    ) -> Option<(Goal<'a>, &'a Reference)> {
        let too_old = client.age_s.is_nan() || client.age_s > self.reference_timeout_s;
        let Some(reference) = client.reference.filter(|_| !too_old) else {
            if self.mode != Mode::Hold {
                self.report(Event::ReferenceStale, counts);
            }
            return None;
        };
        let is_new = self.last_sequence != Some(reference.sequence);
        self.last_sequence = Some(reference.sequence);
        match self.decode(reference) {
            Ok(goal) => Some((goal, reference)),
            Err(flaw) => {
                if is_new {
                    self.report(flaw, counts);
                }
                self.block();
                None
            }
        }
    }

    /// The goal that a reference asks for; the only place where a mode's number is read.
    ///
    /// # Errors
    /// The flaw that forbids to follow the reference.
    fn decode<'a>(&self, reference: &'a Reference) -> Result<Goal<'a>, Event> {
        let goal = match Mode::from_number(reference.mode) {
            Some(Mode::Hold) => Goal::Hold,
            Some(Mode::Torque) => Goal::Torque(reference),
            Some(Mode::InverseDynamics) => Goal::InverseDynamics(reference),
            None => return Err(Event::ReferenceRejected),
        };
        if reference.joint_count != self.joint_count {
            return Err(Event::ReferenceRejected);
        }
        match is_finite(reference) {
            true => Ok(goal),
            false => Err(Event::ReferenceNotFinite),
        }
    }
}

fn is_finite(reference: &Reference) -> bool {
    let joints = reference.joints.iter().take(reference.joint_count as usize);
    let joints_finite = joints
        .flat_map(|j| [j.q_d, j.dq_d, j.ddq_d, j.tau_d])
        .all(f64::is_finite);
    let wrenches = reference.contact_wrench.iter();
    joints_finite
        && wrenches
            .flat_map(|w| w.force.iter().chain(&w.torque))
            .all(|x| x.is_finite())
}
