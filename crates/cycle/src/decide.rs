//! Decide: the state of the robot, its mode, and whether a client's reference is followed.
//!
//! The state machine is [`supervisor::RobotMachine`]; its diagram stands there. This stage feeds
//! it with the condition of every joint, with operators' requests and with events, leads each
//! joint's [`supervisor::Drive`] where it wants it, and follows a client's reference only while it
//! allows to. A reference with a flaw, or none in time, releases
//! the robot: it holds, and the client is followed again only after it has asked for hold once.
//!
//! Events that the stages before have counted get the reactions that the configuration has chosen.
//! *Degrade* makes the sources that an event speaks against unsound for as long as it lasts: a mode
//! that needs one of them ends, and cannot be entered.

mod bearing;
mod quick_stop;

use core::ops::RangeInclusive;

use robot_config::Robot;
use robot_state::{
    CommandedRecord, CommanderRecord, CycleRecord, DriveState, Event, MeasuredRecord, Mode,
    Reaction, Reactions, Reference, RobotState, not_followed, source,
};
use supervisor::{
    Drive, DriveGoal, DriveTrouble, JointCondition, OperatorRequest, RobotMachine, Safety,
};

use crate::emit::status;
use crate::events::{Counts, Subject, refusal_code};
use crate::inputs::{ClientInput, Known};
use crate::judge::{HoldCheck, Soundness, Unheld};
use crate::mode::{Answer, Goal, Modes};
use bearing::Bearings;
use quick_stop::QuickStops;

/// The state of the robot, and the memory that leads to it.
#[derive(Debug)]
pub(crate) struct Supervisor {
    machine: RobotMachine,
    /// Positions at which a joint may be enabled, rad, and |dq| below which it is at rest, rad/s.
    places: Vec<(RangeInclusive<f64>, f64)>,
    conditions: Vec<JointCondition>,
    holds: HoldCheck,
    drives: Vec<Drive>,
    quick_stops: QuickStops,
    bearings: Bearings,
    /// No control word is sent before the robot was ready or in a fault once.
    listening: bool,
    reference_timeout_s: f64,
    reactions: Reactions,
    /// Bits of the sources that each mode needs, in the order of `Mode::ALL`; none: there is no such mode.
    needs: [Option<u32>; Mode::ALL.len()],
    /// Bits of the sources that are not sound in this cycle.
    unsound: u32,
    /// Number of the event that has made one of them so in this cycle, or 0.
    degraded_by: u32,
    /// Bits of the sources that an event of this cycle speaks against, whatever its reaction.
    doubted: u32,
    fault_subject: Option<Subject>,
    mode: Mode,
    /// The client has lost the robot until it asks for hold.
    released: bool,
    /// Number of the event that has released the robot, or 0.
    released_by: u32,
    /// The lease, and what follows from it.
    commander: CommanderRecord,
    /// Sequence of the message whose flaw was counted last.
    flawed: Option<u64>,
    requests: u32,
    refusal: u32,
    acknowledged: bool,
}

impl Supervisor {
    pub(crate) fn new(robot: &Robot, modes: &Modes) -> Self {
        let p = &robot.parameters;
        let joints = p.joints.len();
        let cycles = |time: f64| (time / p.timing.sample_period).ceil() as u32;
        Self {
            machine: RobotMachine::new(joints, p.safety.automatic, cycles(p.safety.time_limit)),
            places: (p.joints.iter())
                .map(|joint| (joint.desired_range(), joint.limits.rest))
                .collect(),
            conditions: vec![JointCondition::default(); joints],
            holds: HoldCheck::new(robot),
            drives: (p.joints.iter())
                .map(|joint| Drive::new(joint.drive_profile.clone()))
                .collect(),
            quick_stops: QuickStops::new(robot),
            bearings: Bearings::new(robot),
            listening: true,
            reference_timeout_s: p.timing.reference_timeout,
            reactions: p.safety.reactions.clone(),
            needs: Mode::ALL.map(|mode| modes.needs(mode)),
            unsound: 0,
            degraded_by: 0,
            doubted: 0,
            fault_subject: None,
            mode: Mode::Hold,
            released: false,
            released_by: 0,
            commander: CommanderRecord::default(),
            flawed: None,
            requests: 0,
            refusal: 0,
            acknowledged: false,
        }
    }

    /// Latches a fault of an earlier run, before the first cycle.
    pub(crate) fn start_with_fault(&mut self, event: Event) {
        self.latch(event, None, Safety::Off);
    }

    /// Writes state, mode, fault and requests into the record.
    pub(crate) fn publish(&self, record: &mut CycleRecord) {
        record.mode = self.mode.number();
        record.state = self.machine.state().number();
        record.fault = self.machine.fault().map_or(0, Event::number);
        let subject = self.fault_subject.filter(|_| record.fault != 0);
        record.fault_subject = subject.map_or(0, Subject::code);
        (record.requests, record.refusal) = (self.requests, self.refusal);
        record.commander = self.commander;
        let possible = Mode::ALL.into_iter().filter(|mode| self.is_possible(*mode));
        record.possible_modes = possible.fold(0, |bits, mode| bits | 1 << mode.number());
    }

    /// An operator has just acknowledged the fault. To be asked once a cycle.
    pub(crate) fn take_acknowledgement(&mut self) -> bool {
        std::mem::take(&mut self.acknowledged)
    }

    /// Set-points may be sent to this joint.
    pub(crate) fn is_engaged(&self, joint: usize) -> bool {
        self.machine.is_engaged(joint)
    }

    /// The joint's drive is being enabled, its samples are usable, and it has no set-points yet.
    pub(crate) fn is_about_to_engage(&self, joint: usize) -> bool {
        self.machine.state() == RobotState::Enabling
            && !self.machine.is_engaged(joint)
            && (self.conditions.get(joint)).is_some_and(|joint| joint.usable && joint.inside)
    }

    /// Settles state and mode of this cycle, and the reference that it follows.
    pub(crate) fn decide<'a>(
        &mut self,
        client: &ClientInput<'a>,
        known: &Known<'_>,
        modes: &mut Modes,
        counts: &mut Counts,
    ) -> Goal<'a> {
        let (soundness, measured) = (known.soundness, known.measured);
        self.unsound = if soundness.ready.sensors {
            0
        } else {
            source::WHOLE_BODY
        };
        (self.degraded_by, self.doubted) = (0, 0);
        self.react_to(counts);
        self.follow_drives(measured, counts);
        self.judge(known);
        self.follow_lease(&client.commander, counts);
        if let Some(request) = client.request {
            self.requests = self.requests.wrapping_add(1);
            self.carry_out(request);
            let acknowledges = matches!(request, OperatorRequest::Acknowledge(_));
            self.acknowledged = acknowledges && self.refusal == 0;
        }
        if let Some((event, joint)) = self.machine.update(&self.conditions) {
            self.report(event, joint.map(Subject::Joint), counts);
        }
        self.leave_to_brakes(known, counts);
        self.lead_drives(known);
        let goal = self.goal(client, soundness, (measured, modes), counts);
        self.machine.set_active(goal.is_followed());
        self.mode = goal.mode();
        self.explain(client.reference, soundness.ready.joints);
        goal
    }

    /// Counts refused references, and takes the robot from a commander that was replaced.
    fn follow_lease(&mut self, lease: &CommanderRecord, counts: &mut Counts) {
        let before = std::mem::replace(&mut self.commander, *lease);
        let since = |now: u32, before: u32| u64::from(now.wrapping_sub(before));
        let pieces = since(lease.pieces_refused, before.pieces_refused);
        let ended = since(lease.trajectories_ended, before.trajectories_ended);
        counts.add_many(
            Event::CommanderRefused,
            since(lease.refused, before.refused),
        );
        counts.add_many(Event::TrajectoryRefused, pieces);
        counts.add_many(Event::TrajectoryEnded, ended);
        if lease.replaced != before.replaced {
            self.report(Event::CommanderReplaced, None, counts);
        }
    }

    /// Shows commanders whether and why no mode is followed, as of this cycle's reference.
    fn explain(&mut self, reference: Option<&Reference>, ready: bool) {
        let fault = self.machine.fault().map_or(0, Event::number);
        let asked = reference.and_then(|reference| Mode::from_number(reference.mode));
        let (reason, cause) = if fault != 0 {
            (not_followed::FAULT, fault)
        } else if !self.machine.may_follow() {
            (not_followed::STATE, 0)
        } else if !asked.is_none_or(|mode| self.is_possible(mode)) {
            (not_followed::NOT_POSSIBLE, self.degraded_by)
        } else if self.released {
            (not_followed::HOLD_FIRST, self.released_by)
        } else if !ready {
            (not_followed::NOT_READY, 0)
        } else {
            (0, 0)
        };
        self.commander.sequence = reference.map_or(0, |reference| reference.sequence);
        (self.commander.not_followed, self.commander.cause) = (reason, cause);
    }

    /// Whatever the operator has changed, a client is followed again only after it has asked for hold.
    fn carry_out(&mut self, request: OperatorRequest) {
        let before = self.machine.state();
        let outcome = self.machine.request(request, &self.conditions);
        if outcome.is_ok() && self.machine.state() != before {
            self.release(0);
        }
        self.refusal = outcome.map_or_else(refusal_code, |()| 0);
        if matches!(request, OperatorRequest::Disable) {
            self.bearings.end();
        }
        if outcome.is_ok() && matches!(request, OperatorRequest::Acknowledge(_)) {
            self.drives.iter_mut().for_each(Drive::acknowledge);
            // Joints prove themselves anew from the next cycle on.
            for condition in &mut self.conditions {
                (condition.distrusted, condition.slipped) = (false, false);
            }
        }
    }

    /// The drives, one for each joint.
    pub(crate) fn drives(&self) -> &[Drive] {
        &self.drives
    }

    /// Writes each drive's state into the record.
    pub(crate) fn publish_drives(&self, commanded: &mut CommandedRecord) {
        for (joint, drive) in commanded.joints.iter_mut().zip(&self.drives) {
            joint.drive_state = drive.state().number();
        }
    }

    /// Takes the drives' status words, and reports what went wrong with them.
    fn follow_drives(&mut self, measured: &MeasuredRecord, counts: &mut Counts) {
        for (j, joint) in measured.joints.iter().enumerate().take(self.drives.len()) {
            let event = match self.drives[j].update(status(joint)) {
                Some(DriveTrouble::Fault) => Event::DriveFault,
                Some(DriveTrouble::Lost(_)) => Event::DriveLost,
                Some(DriveTrouble::Unguarded) => Event::DriveUnguarded,
                Some(DriveTrouble::TimeOut(_)) => Event::EnableTimeOut,
                None => continue,
            };
            self.report(event, Some(Subject::Joint(j)), counts);
        }
    }

    fn lead_drives(&mut self, known: &Known<'_>) {
        self.listening &= self.machine.state() == RobotState::Boot;
        let safety = self.machine.safety();
        let all_off = safety == Some(Safety::Off);
        let joints = self.drives.iter_mut().zip(&self.conditions);
        for (j, (drive, condition)) in joints.enumerate() {
            // The event may speak against this joint's drive.
            let may_stop = all_off && self.fault_subject != Some(Subject::Joint(j));
            let wanted = self.machine.wants_drive(j);
            let measured = &known.measured.joints[j];
            let bears = (self.bearings).update(j, (wanted, safety), drive, measured);
            drive.pursue(if self.listening {
                DriveGoal::Listen
            } else if wanted {
                DriveGoal::Enabled
            } else if bears || self.quick_stops.update(j, may_stop, drive, condition) {
                DriveGoal::Stopped
            } else {
                DriveGoal::Off
            });
        }
    }

    /// In a fault a joint whose encoders contradict each other is not held for ever.
    fn leave_to_brakes(&mut self, known: &Known<'_>, counts: &mut Counts) {
        let stopped = self.machine.fault().is_some();
        for (j, readiness) in known.soundness.joints.iter().enumerate() {
            let (measured, commanded) = (&known.measured.joints[j], &known.commanded.joints[j]);
            let engaged = stopped && self.machine.is_engaged(j);
            let judged = (&self.conditions[j], readiness);
            match (self.holds).update(j, judged, (measured, commanded), engaged) {
                Unheld::No => {}
                Unheld::ToBrake => self.machine.withdraw(j),
                Unheld::Away => {
                    self.report(Event::FollowingError, Some(Subject::Joint(j)), counts);
                }
            }
        }
    }

    fn judge(&mut self, known: &Known<'_>) {
        let joints = self.conditions.iter_mut().zip(&known.soundness.joints);
        let drives = self.drives.iter().zip(&self.places);
        let measured = &known.measured.joints;
        for (j, ((condition, joint), ((drive, (range, rest)), measured))) in
            joints.zip(drives.zip(measured)).enumerate()
        {
            *condition = JointCondition {
                usable: joint.plausible && !joint.stale,
                stale: joint.stale,
                distrusted: joint.distrusted,
                slipped: joint.slipped,
                // One that was stopped at its limit stands beyond by its torsion; only inwards it moves.
                inside: range.contains(&measured.q),
                drive_enabled: drive.is_enabled(),
                drive_fault: drive.state() == DriveState::Fault,
                at_rest: measured.dq.abs() < *rest,
                unfit: known.soundness.is_unfit(j),
            };
        }
    }

    fn goal<'a>(
        &mut self,
        client: &ClientInput<'a>,
        soundness: &Soundness,
        (measured, modes): (&MeasuredRecord, &mut Modes),
        counts: &mut Counts,
    ) -> Goal<'a> {
        let asked = self.checked(client, modes, counts);
        if matches!(asked, Some(Goal::Hold)) {
            self.released = false;
        }
        if self.machine.fault().is_some() {
            return self.safe_goal(soundness);
        }
        if self.machine.is_braking() {
            return Goal::Hold;
        }
        let mode = self.mode;
        // Commands of the mode may have followed from the sensor that failed.
        if !self.is_possible(mode) {
            self.release(self.degraded_by);
            return Goal::Stop;
        } else if soundness.ready.overslept && mode != Mode::Hold {
            self.release(Event::SkippedCycle.number());
            return Goal::Stop;
        }
        let allowed = self.machine.may_follow() && !self.released && soundness.ready.joints;
        let asked = asked.filter(|goal| allowed && self.is_possible(goal.mode()));
        let Some(goal) = asked else {
            return Goal::Hold;
        };
        // References that an earlier visit of the mode has followed do not count.
        let first = goal.mode() != mode;
        match modes.take(&goal, first, measured) {
            Ok(()) => goal,
            Err(flaw) => {
                self.report(flaw, None, counts);
                Goal::Hold
            }
        }
    }

    /// Reaction of a robot in a fault. A limb yields to a contact by its torque and by gravity: as soon as
    /// a source of these is in doubt it is stopped instead, and stays so.
    fn safe_goal(&mut self, soundness: &Soundness) -> Goal<'static> {
        let (Some(Event::ExternalContact), Some(Subject::Joint(joint))) =
            (self.machine.fault(), self.fault_subject)
        else {
            return Goal::Stop;
        };
        let mut answer = match self.machine.safety() {
            Some(Safety::Comply) => Answer::Comply,
            Some(Safety::Retract) => Answer::Retract,
            Some(Safety::Stop) => Answer::Stop,
            _ => return Goal::Stop,
        };
        if answer != Answer::Stop && !self.may_yield(soundness) {
            self.machine.latch(Event::ExternalContact, Safety::Stop);
            answer = Answer::Stop;
        }
        Goal::Contact { joint, answer }
    }

    /// All joints are driven, and nothing speaks against what inverse dynamics needs.
    fn may_yield(&self, soundness: &Soundness) -> bool {
        let needs = self.needs[Mode::InverseDynamics.number() as usize].unwrap_or(u32::MAX);
        let mut joints = self.conditions.iter().enumerate();
        (self.unsound | self.doubted) & needs == 0
            && soundness.ready.joints
            && !soundness.ready.overslept
            && joints
                .all(|(j, joint)| joint.usable && !joint.distrusted && self.machine.is_engaged(j))
    }

    /// The sources allow the mode.
    fn is_possible(&self, mode: Mode) -> bool {
        let needs = self.needs.get(mode.number() as usize).copied().flatten();
        needs.is_some_and(|needs| needs & self.unsound == 0)
    }

    /// Reacts to the events that were counted since, or last. A robot whose drives are off needs no
    /// reaction that latches a fault; where the event lasts, it follows when they are on.
    pub(crate) fn react_to(&mut self, counts: &mut Counts) {
        while let Some((event, subject)) = counts.take_raised() {
            let off = matches!(self.machine.state(), RobotState::Boot | RobotState::Ready);
            if !(off && self.reactions.of(event).latches()) {
                self.react(event, subject);
            }
        }
    }

    /// Counts an event and reacts to it, whatever the robot's state.
    pub(crate) fn report(&mut self, event: Event, subject: Option<Subject>, counts: &mut Counts) {
        counts.add_about(event, subject);
        self.react(event, subject);
    }

    fn react(&mut self, event: Event, subject: Option<Subject>) {
        // A collision may well exceed what a joint can bear.
        if event != Event::TorqueSaturated {
            self.doubted |= event.against();
        }
        match self.reactions.of(event) {
            // Why a sensor has had no usable sample.
            Reaction::Warn if event == Event::SensorSaturated && self.degraded_by != 0 => {
                self.degraded_by = event.number();
            }
            Reaction::Warn => {}
            Reaction::Degrade => {
                self.unsound |= event.against();
                self.degraded_by = event.number();
            }
            Reaction::Release => self.release(event.number()),
            Reaction::Comply => self.latch(event, subject, Safety::Comply),
            Reaction::Retract => self.latch(event, subject, Safety::Retract),
            Reaction::Hold => self.latch(event, subject, Safety::Hold),
            Reaction::Stop => self.latch(event, subject, Safety::Stop),
            Reaction::Off => self.latch(event, subject, Safety::Off),
        }
    }

    fn latch(&mut self, event: Event, subject: Option<Subject>, safety: Safety) {
        if self.machine.fault().is_none() {
            self.fault_subject = subject;
        }
        match (event, subject) {
            (Event::FollowingError, Some(Subject::Joint(joint))) => self.machine.withdraw(joint),
            (Event::HoldSwings, Some(Subject::Joint(joint))) if self.holds.brakes(joint) => {
                self.machine.withdraw(joint);
            }
            _ => {}
        }
        self.machine.latch(event, safety);
        self.release(event.number());
    }

    /// Takes the robot from its client; `cause`: number of an event, or 0.
    fn release(&mut self, cause: u32) {
        (self.released, self.released_by) = (true, cause);
        self.mode = Mode::Hold;
    }

    /// The goal that the reference asks for, unless a flaw forbids to follow it. A flaw is counted
    /// once for each message, not once for each cycle in which the message is the newest.
    fn checked<'a>(
        &mut self,
        client: &ClientInput<'a>,
        modes: &Modes,
        counts: &mut Counts,
    ) -> Option<Goal<'a>> {
        // One that is sent later than now has no age to go by either.
        let in_time = (0.0..=self.reference_timeout_s).contains(&client.age_s);
        let Some(reference) = client.reference.filter(|_| in_time) else {
            if self.mode != Mode::Hold {
                self.report(Event::ReferenceStale, None, counts);
            }
            return None;
        };
        let goal = modes.goal(reference);
        let flawed = goal.is_err().then_some(reference.sequence);
        let before = std::mem::replace(&mut self.flawed, flawed);
        match goal {
            Ok(goal) => Some(goal),
            Err(flaw) => {
                if before != flawed {
                    self.report(flaw, None, counts);
                }
                self.release(flaw.number());
                None
            }
        }
    }
}
