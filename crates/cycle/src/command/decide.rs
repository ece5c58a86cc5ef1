//! Decide: which mode the robot is in, and whether a client's reference is trusted.
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

use robot_state::{Event, Reaction, Reference, Settings, mode};

use crate::events::Counts;
use crate::measure::Readiness;

/// What the loop hands to a cycle besides frames: what clients want.
#[derive(Debug, Clone, Copy, Default)]
pub struct Wanted<'a> {
    /// The newest reference, if a client commands.
    pub reference: Option<&'a Reference>,
    /// How long ago it arrived, s.
    pub age_s: f64,
    /// The settings that hold now; none: those of the configuration.
    pub settings: Option<&'a Settings>,
}

/// The mode, and the memory that leads to it.
#[derive(Debug)]
pub(crate) struct Supervisor {
    joint_count: u32,
    reference_timeout_s: f64,
    mode: u32,
    fault: Option<Event>,
    blocked: bool,
    last_sequence: Option<u64>,
}

impl Supervisor {
    pub(crate) fn new(joint_count: usize, reference_timeout_s: f64) -> Self {
        Self {
            joint_count: joint_count as u32,
            reference_timeout_s,
            mode: mode::HOLD,
            fault: None,
            blocked: false,
            last_sequence: None,
        }
    }

    pub(crate) fn mode(&self) -> u32 {
        self.mode
    }

    /// The latched fault's number, or 0.
    pub(crate) fn fault_number(&self) -> u32 {
        self.fault.map_or(0, Event::number)
    }

    /// Settles the mode of this cycle and gives the reference if it is to be followed.
    pub(crate) fn decide<'a>(
        &mut self,
        wanted: &Wanted<'a>,
        readiness: Readiness,
        counts: &mut Counts,
    ) -> Option<&'a Reference> {
        if readiness.stale && self.fault.is_none() {
            self.report(Event::JointStale, counts);
        }
        let reference = self.trusted(wanted, counts);
        if let Some(reference) = reference {
            if reference.reset_fault == 1 && !readiness.stale {
                self.fault = None;
            }
            if reference.mode == mode::HOLD {
                self.blocked = false;
            }
        }
        let allowed = self.fault.is_none() && !self.blocked && readiness.ready;
        let followed = reference.filter(|r| allowed && r.mode != mode::HOLD);
        self.mode = followed.map_or(mode::HOLD, |r| r.mode);
        followed
    }

    /// Counts an event and does what it asks for.
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
        self.mode = mode::HOLD;
    }

    /// The reference, unless something about it forbids to follow it. A flaw is counted once for
    /// each message, not once for each cycle in which the message is the newest.
    fn trusted<'a>(&mut self, wanted: &Wanted<'a>, counts: &mut Counts) -> Option<&'a Reference> {
        let Some(reference) = wanted.reference else {
            if self.mode != mode::HOLD {
                self.report(Event::ReferenceStale, counts);
            }
            return None;
        };
        if wanted.age_s.is_nan() || wanted.age_s > self.reference_timeout_s {
            if self.mode != mode::HOLD {
                self.report(Event::ReferenceStale, counts);
            }
            return None;
        }
        let is_new = self.last_sequence != Some(reference.sequence);
        self.last_sequence = Some(reference.sequence);
        let Some(flaw) = self.flaw(reference) else {
            return Some(reference);
        };
        if is_new {
            self.report(flaw, counts);
        }
        self.block();
        None
    }

    /// What forbids to follow the reference.
    fn flaw(&self, reference: &Reference) -> Option<Event> {
        let known = matches!(
            reference.mode,
            mode::HOLD | mode::TORQUE | mode::INVERSE_DYNAMICS
        );
        if !known || reference.joint_count != self.joint_count {
            return Some(Event::ReferenceRejected);
        }
        (!is_finite(reference)).then_some(Event::ReferenceNotFinite)
    }
}

fn is_finite(reference: &Reference) -> bool {
    let joints = reference.joints.iter().take(reference.joint_count as usize);
    let joints_finite = joints
        .flat_map(|j| [j.q_d, j.dq_d, j.ddq_d, j.tau_d])
        .all(f64::is_finite);
    let wrenches = reference.contact.iter();
    joints_finite
        && wrenches
            .flat_map(|w| w.force.iter().chain(&w.torque))
            .all(|x| x.is_finite())
}
