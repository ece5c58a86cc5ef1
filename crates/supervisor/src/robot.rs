//! State machine of the robot: whether set-points may leave, and for which joints.
//!
//! ```text
//!            all joints plausible         enable             every drive enabled
//!    boot ───────────────────────► ready ───────► enabling ─────────────────────► holding ◄──► active
//!     ▲                              ▲  ▲             │ refused, timed out           │  │        │
//!     │ a joint no longer plausible  │  └─────────────┘◄─────────────────────────────┘  │ stop   │
//!     └──────────────────────────────┤   disable: all off                               ▼        │
//!                                    ├──────────────────────────────────────────── stopping ◄────┤
//!                                    │            at rest, or the time is over                   │
//!                                    └──── acknowledge ──── fault ◄──────────────────────────────┘
//!                                                             event with reaction hold, stop or off
//! ```
//!
//! | state | set-points leave | modes |
//! | --- | --- | --- |
//! | boot | none: listens only | none |
//! | ready | none, but for joints that a fault left holding | none |
//! | enabling | to all joints: where they stand; left when every drive has followed for a while | none |
//! | holding | to all joints, unchanging | may be entered |
//! | active | to all joints | the one that is active |
//! | stopping | to all joints: brought to rest | none |
//! | fault | as the fault's reaction demands: yielding to a contact, held, brought to rest, or none | none |
//!
//! Nothing leads from fault to motion but the operator: acknowledge, enable, and then a client.
//! A joint that went stale or whose drive is no longer enabled has its set-points withdrawn, and
//! only enabling gives them back, from where the joint then stands.

use robot_state::{Event, RobotState};

/// An operator's request: an edge, seen in one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OperatorRequest {
    /// Drives on, then hold.
    Enable,
    /// Drives off, at once.
    Disable,
    /// Bring the robot to rest, then hold.
    Stop,
    /// The fault of this number has been understood.
    Acknowledge(u32),
}

/// Why a request was not carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// Not possible in this state.
    State(RobotState),
    /// A joint that is not plausible or has not been seen.
    Joint(usize),
    /// A joint that stands outside its position limits.
    Outside(usize),
    /// A joint whose drive reports a fault of its own.
    Drive(usize),
    /// A joint whose gear shows a torsion that does not fit what it bears.
    Unfit(usize),
    /// Another fault is latched, or none: the number.
    OtherFault(u32),
}

/// How a robot in a fault is brought to safety.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Safety {
    /// The limb in contact goes soft; all else is brought to rest.
    Comply,
    /// The limb in contact goes back; all else is brought to rest.
    Retract,
    /// Set-points stay as they are.
    Hold,
    /// Motion is brought to rest, then held.
    Stop,
    /// Drives off.
    Off,
}

/// One joint, as the machine needs it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct JointCondition {
    /// Seen, plausible, not stale.
    pub usable: bool,
    /// Silent for longer than allowed.
    pub stale: bool,
    /// The joint's encoders contradict each other.
    pub distrusted: bool,
    /// One of its encoders has slipped: no later sample of it is right, in use or not.
    pub slipped: bool,
    /// Within its position limits.
    pub inside: bool,
    /// The joint's drive follows set-points.
    pub drive_enabled: bool,
    /// The joint's drive reports a fault of its own.
    pub drive_fault: bool,
    /// The joint moves no faster than what counts as rest.
    pub at_rest: bool,
    /// The torsion of its gear does not fit what it bears: an encoder's zero, or the gear, is another.
    pub unfit: bool,
}

/// The machine.
#[derive(Debug, Clone)]
pub struct RobotMachine {
    state: RobotState,
    fault: Option<Event>,
    safety: Safety,
    automatic: bool,
    /// Set-points are sent to these joints.
    engaged: Vec<bool>,
    /// All joints are usable: one that holds need not be, while it proves itself anew.
    usable: bool,
    /// Longest time of enabling and of stopping, cycles.
    time_limit: u32,
    waited: u32,
    /// Cycles in a row in which all joints have had set-points while enabling.
    followed: u32,
}

/// Cycles in which every drive must be enabled and follow before the robot is said to hold: what a
/// following error needs to be found.
const FOLLOWED: u32 = 25;

impl RobotMachine {
    /// A robot that has just been switched on. `automatic`: enabling needs no operator, as for
    /// simulated robots, until the first disabling; `time_limit`: cycles for enabling and for stopping.
    #[must_use]
    pub fn new(joints: usize, automatic: bool, time_limit: u32) -> Self {
        Self {
            state: RobotState::Boot,
            fault: None,
            safety: Safety::Hold,
            automatic,
            engaged: vec![false; joints],
            usable: false,
            time_limit,
            waited: 0,
            followed: 0,
        }
    }

    /// The state.
    #[must_use]
    pub fn state(&self) -> RobotState {
        self.state
    }

    /// The latched fault.
    #[must_use]
    pub fn fault(&self) -> Option<Event> {
        self.fault
    }

    /// How a robot in a fault is brought to safety; none without a fault.
    #[must_use]
    pub fn safety(&self) -> Option<Safety> {
        self.fault.map(|_| self.safety)
    }

    /// Set-points may be sent to this joint.
    #[must_use]
    pub fn is_engaged(&self, joint: usize) -> bool {
        self.engaged.get(joint).copied().unwrap_or(false)
    }

    /// A client's mode may be entered or goes on.
    #[must_use]
    pub fn may_follow(&self) -> bool {
        self.usable && matches!(self.state, RobotState::Holding | RobotState::Active)
    }

    /// The robot is to be brought to rest.
    #[must_use]
    pub fn is_braking(&self) -> bool {
        match self.state {
            RobotState::Stopping => true,
            RobotState::Fault => self.safety == Safety::Stop,
            _ => false,
        }
    }

    /// This joint's drive is to be on.
    #[must_use]
    pub fn wants_drive(&self, joint: usize) -> bool {
        self.state == RobotState::Enabling || self.is_engaged(joint)
    }

    /// Set-points to this joint end, and its drive is to be off, until the robot is enabled again.
    pub fn withdraw(&mut self, joint: usize) {
        if let Some(engaged) = self.engaged.get_mut(joint) {
            *engaged = false;
        }
    }

    /// Latches a fault; of several the first is shown, and the strongest reaction holds.
    pub fn latch(&mut self, event: Event, safety: Safety) {
        if self.state == RobotState::Fault {
            self.safety = self.safety.max(safety);
        } else {
            self.safety = safety;
            self.enter(RobotState::Fault);
        }
        self.fault.get_or_insert(event);
        if self.safety == Safety::Off {
            self.engaged.fill(false);
        }
    }

    /// A client's mode is active, or no longer.
    pub fn set_active(&mut self, active: bool) {
        if matches!(self.state, RobotState::Holding | RobotState::Active) {
            let state = if active {
                RobotState::Active
            } else {
                RobotState::Holding
            };
            if state != self.state {
                self.enter(state);
            }
        }
    }

    /// Carries out an operator's request, or refuses it with the reason.
    ///
    /// # Errors
    /// The request is not possible now; nothing has changed.
    pub fn request(
        &mut self,
        request: OperatorRequest,
        joints: &[JointCondition],
    ) -> Result<(), Refusal> {
        use RobotState as S;
        match (request, self.state) {
            (OperatorRequest::Enable, S::Ready) => {
                self.may_enable(joints)?;
                self.enter(S::Enabling);
            }
            (OperatorRequest::Enable, S::Enabling | S::Holding | S::Active) => {}
            (OperatorRequest::Disable, _) => {
                self.engaged.fill(false);
                self.automatic = false;
                if !matches!(self.state, S::Boot | S::Fault) {
                    self.enter(S::Ready);
                }
                if self.state == S::Fault {
                    self.safety = Safety::Off;
                }
            }
            (OperatorRequest::Stop, S::Holding | S::Active) => self.enter(S::Stopping),
            (OperatorRequest::Stop, S::Enabling) => {
                self.engaged.fill(false);
                self.enter(S::Ready);
            }
            (OperatorRequest::Stop, S::Boot | S::Ready | S::Stopping | S::Fault) => {}
            (OperatorRequest::Acknowledge(number), S::Fault) => {
                let latched = self.fault.map_or(0, Event::number);
                if number != latched {
                    return Err(Refusal::OtherFault(latched));
                }
                self.fault = None;
                let all = self.engaged.iter().all(|&engaged| engaged);
                self.enter(if all { S::Holding } else { S::Ready });
            }
            (OperatorRequest::Acknowledge(_), _) => return Err(Refusal::OtherFault(0)),
            (OperatorRequest::Enable, state) => return Err(Refusal::State(state)),
        }
        Ok(())
    }

    /// Moves on by one cycle. Returns what went wrong, for the caller to react to
    /// ([`RobotMachine::latch`]): a joint in use that went stale or implausible, a time limit; and
    /// the first joint concerned.
    pub fn update(&mut self, joints: &[JointCondition]) -> Option<(Event, Option<usize>)> {
        use RobotState as S;
        self.waited = self.waited.saturating_add(1);
        let mut wrong = None;
        for (j, (engaged, joint)) in self.engaged.iter_mut().zip(joints).enumerate() {
            let in_use = *engaged || self.state == S::Enabling;
            if in_use && joint.stale {
                // Where it stands when it comes back is not where it stood.
                *engaged = false;
                let earlier = wrong.filter(|(event, _)| *event == Event::JointStale);
                wrong = earlier.or(Some((Event::JointStale, Some(j))));
            } else if *engaged && !joint.drive_enabled {
                *engaged = false;
                wrong = wrong.or(Some((Event::DriveLost, Some(j))));
            } else if joint.slipped || in_use && joint.distrusted {
                wrong = wrong.or(Some((Event::EncoderImplausible, Some(j))));
            }
        }
        let usable = joints.iter().all(|joint| joint.usable);
        self.usable = usable;
        match self.state {
            // A fault is latched already, and its cause is known.
            S::Fault => wrong = None,
            S::Boot if usable => self.enter(S::Ready),
            S::Ready if !usable && !self.engaged.contains(&true) => self.enter(S::Boot),
            S::Ready if self.automatic && self.may_enable(joints).is_ok() => {
                self.enter(S::Enabling)
            }
            S::Enabling => {
                for (engaged, joint) in self.engaged.iter_mut().zip(joints) {
                    *engaged |= joint.drive_enabled && joint.usable;
                }
                let all = self.engaged.iter().all(|&engaged| engaged);
                self.followed = if all { self.followed + 1 } else { 0 };
                if self.followed > FOLLOWED {
                    self.enter(S::Holding);
                } else if !all && self.waited > self.time_limit {
                    let waiting = self.engaged.iter().position(|engaged| !engaged);
                    wrong = Some((Event::EnableTimeOut, waiting));
                }
            }
            S::Stopping
                if self.waited > self.time_limit || joints.iter().all(|joint| joint.at_rest) =>
            {
                self.enter(S::Holding);
            }
            _ => {}
        }
        wrong
    }

    fn enter(&mut self, state: RobotState) {
        self.state = state;
        (self.waited, self.followed) = (0, 0);
    }

    fn may_enable(&self, joints: &[JointCondition]) -> Result<(), Refusal> {
        if let Some(joint) = joints.iter().position(|joint| !joint.usable) {
            return Err(Refusal::Joint(joint));
        }
        if let Some(joint) = joints.iter().position(|joint| joint.drive_fault) {
            return Err(Refusal::Drive(joint));
        }
        if let Some(joint) = joints.iter().position(|joint| joint.unfit) {
            return Err(Refusal::Unfit(joint));
        }
        match joints.iter().position(|joint| !joint.inside) {
            Some(joint) => Err(Refusal::Outside(joint)),
            None => Ok(()),
        }
    }
}
