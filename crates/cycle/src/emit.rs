//! Emit: from commands and control words to frames.
//!
//! A joint whose set-points are withdrawn has none, with two exceptions. A drive that takes currents
//! would go on with the last one: it is sent zero until it has been off for a while. And where several joints share a
//! message, the others need it: the joint's slot then has zero current, or the position where it was
//! measured last, if its drive is kept off by control words; else the message ends for all of them. So it does
//! where the drive stays enabled all the same: only its own time-out can still stop it. A CANopen drive, which has none
//! for set-points, is then reset by network management: it starts anew, with its power stage off.
//!
//! A drive that takes positions is sent where its motor stands before it is enabled: one that keeps a target of
//! its own would go there.

use can_codec::{Frame, Frames, Table};
use robot_config::{JointParameters, Plan, Robot, slots};
use robot_state::{DriveState, Event, JointMeasured, MeasuredRecord, measured_flags};
use supervisor::{Drive, DriveGoal, DriveProfile};

use crate::decide::Supervisor;
use crate::events::Counts;
use crate::joint::Joints;

/// Control words are repeated after so many cycles, for a drive that lost one.
const REPEAT: u32 = 100;
/// A node's reset is repeated after so many cycles, as it may be lost. Chosen; no experiment recorded.
const RESET_REPEAT: u32 = 5;
/// Time in which a drive switches off that hears its control word, s: two cycles there and back at 1 kHz, and its step.
const RUNS_S: f64 = 0.005;
/// Way, rad, by which a joint goes on within [`RUNS_S`] whose drive runs away: what the others lose is less.
/// Chosen on the simulated robots: such a joint then moves by 3.4 to 6.5 degrees (docs/safety.md).
const RUNS_WAY: f64 = 0.2 * core::f64::consts::PI / 180.0;

/// Inputs of a joint's set-points.
#[derive(Debug, Clone, Copy)]
struct Addressed {
    takes_position: bool,
    /// Control words keep its drive off.
    controlled: bool,
    zero_current: bool,
    /// The joint has had a set-point.
    driven: bool,
    /// Cycles in a row in which its drive has indicated that it is off.
    off: u32,
    /// Position limits, rad.
    limits: [f64; 2],
    /// The joint has been measured: encoders that contradict each other later leave its last position.
    measured: bool,
    gear_ratio: f64,
    /// Cycles in a row in which its drive has been enabled without a set-point for it, and where it was before the
    /// first of them, rad.
    deaf: u32,
    left_at: f64,
    /// Resets a CANopen drive.
    reset: Option<Frame>,
}

/// The frames that carry set-points and control words.
#[derive(Debug)]
pub(crate) struct Emit {
    table: Table,
    /// NaN while a joint is not engaged or no control word is due: no frame follows from NaN.
    slots: Vec<f64>,
    joints: Vec<Addressed>,
    /// The joints of each message that carries several set-points.
    shared: Vec<Vec<usize>>,
    /// For each message: it carries control words.
    controls: Vec<bool>,
    /// Each drive's last control word.
    words: Vec<Option<u32>>,
    /// Cycles since control words were sent.
    since: u32,
    /// Cycles for which a drive may stay enabled that is to be off, and for which it may while its joint moves.
    deaf_limit: u32,
    runs_limit: u32,
}

impl Emit {
    pub(crate) fn new(robot: &Robot) -> Self {
        let period = robot.parameters.timing.sample_period;
        let cycles = |time: f64| (time / period).ceil() as u32;
        Self {
            slots: vec![f64::NAN; slots::send_len(&robot.parameters)],
            joints: (robot.parameters.joints.iter())
                .map(|joint| Addressed {
                    takes_position: joint.takes_position(),
                    controlled: (joint.drive_profile.as_ref()).is_some_and(|p| p.control.is_some()),
                    zero_current: joint.zero_current,
                    driven: false,
                    off: 0,
                    limits: [joint.limits.position_min, joint.limits.position_max],
                    measured: false,
                    gear_ratio: joint.encoders.gear_ratio,
                    deaf: 0,
                    left_at: f64::NAN,
                    reset: (robot.nodes.plans.iter())
                        .find(|plan| plan.name == joint.name)
                        .map(Plan::reset),
                })
                .collect(),
            shared: shared(&robot.send),
            controls: (0..robot.send.message_count())
                .map(|message| {
                    let mut sent = robot.send.slots(message).map(slots::sent);
                    sent.any(|sent| matches!(sent, slots::Sent::Control(_)))
                })
                .collect(),
            table: robot.send.clone(),
            words: vec![None; robot.parameters.joints.len()],
            since: 0,
            deaf_limit: cycles(robot.parameters.timing.stale_after),
            runs_limit: cycles(RUNS_S),
        }
    }

    /// Appends this cycle's frames: set-points of messages whose joints are all engaged, and control
    /// words while a drive is not where it should be, when one changes, and every 100 cycles.
    pub(crate) fn update(
        &mut self,
        joints: &Joints,
        supervisor: &Supervisor,
        measured: &MeasuredRecord,
        tx: &mut Frames,
        counts: &mut Counts,
    ) {
        for (j, last) in joints.last().enumerate() {
            // No set-point leaves in the cycle in which the command itself is the fault, either.
            let last = last.filter(|_| supervisor.is_engaged(j));
            let state = supervisor.drives().get(j).map(Drive::state);
            let state = state.unwrap_or_default();
            let angle = measured.joints.get(j).map_or(f64::NAN, |joint| joint.q);
            self.note(j, last.is_some(), state, angle);
            let set_point = last
                .or_else(|| self.no_current(j, state))
                .or_else(|| self.where_it_stands(j, supervisor, measured));
            self.set(slots::command(j), set_point);
        }
        self.complete_shared(measured);
        let due = self.control_words_due(supervisor.drives());
        for j in 0..self.words.len() {
            self.set(
                slots::control(j),
                self.words[j].filter(|_| due).map(f64::from),
            );
        }
        let mut frame = Frame::zeroed(0, 0, 0, false);
        for (message, &control) in self.controls.iter().enumerate() {
            // Of drives by profiles each has a message of its own for its control word, which is seldom due.
            if (due || !control) && self.table.encode(message, &self.slots, &mut frame) {
                tx.push(frame);
            }
        }
        let drives = supervisor.drives().iter().zip(&measured.joints);
        for (joint, (drive, measured)) in self.joints.iter().zip(drives) {
            let beyond = joint.deaf.checked_sub(self.deaf_limit + 1);
            let due = beyond.is_some_and(|cycles| cycles.is_multiple_of(RESET_REPEAT));
            let to_be_off = matches!(drive.goal(), DriveGoal::Off | DriveGoal::Stopped);
            // One without a status in this cycle may be starting anew already.
            let due = due && to_be_off && status(measured).is_some();
            if let Some(reset) = joint.reset.filter(|_| due) {
                tx.push(reset);
            }
        }
        counts.add_many(Event::SendFailed, tx.overflow());
    }

    /// Whether the joint's set-point can leave: no joint without one shares its message. To be called after `update`.
    pub(crate) fn reaches(&self, joint: usize) -> bool {
        let mut its = self.shared.iter().filter(|joints| joints.contains(&joint));
        its.all(|joints| joints.iter().all(|&j| self.has_set_point(j)))
    }

    fn has_set_point(&self, joint: usize) -> bool {
        (self.slots.get(slots::command(joint))).is_some_and(|x| !x.is_nan())
    }

    /// Zero for a drive that would go on with the last current. One status word that is wrong must not end it:
    /// the drive has to indicate for a while that it is off, and gets zero again whenever it does not.
    fn no_current(&mut self, joint: usize, state: DriveState) -> Option<f64> {
        let joint = self.joints.get_mut(joint)?;
        joint.off = match state {
            DriveState::Enabled | DriveState::Stopping | DriveState::Unknown => 0,
            _ => joint.off.saturating_add(1),
        };
        (joint.zero_current && joint.driven && joint.off <= REPEAT).then_some(0.0)
    }

    /// Fills slots of withdrawn joints in messages that other joints need.
    fn complete_shared(&mut self, measured: &MeasuredRecord) {
        for (joint, measured) in self.joints.iter_mut().zip(&measured.joints) {
            joint.measured |= measured.flags & measured_flags::NEVER == 0;
        }
        for joints in &self.shared {
            if !joints.iter().any(|&j| self.has_set_point(j)) {
                continue;
            }
            for &j in joints {
                let (Some(slot), Some(joint)) =
                    (self.slots.get_mut(slots::command(j)), self.joints.get(j))
                else {
                    continue;
                };
                let hears = joint.controlled && joint.deaf <= self.deaf_limit;
                if slot.is_nan() && !joint.takes_position {
                    *slot = 0.0;
                }
                if slot.is_nan() && hears && joint.measured {
                    let [min, max] = joint.limits;
                    *slot = (measured.joints.get(j)).map_or(f64::NAN, |m| m.q.max(min).min(max));
                }
            }
        }
    }

    fn control_words_due(&mut self, drives: &[Drive]) -> bool {
        self.since += 1;
        let mut due = self.since >= REPEAT;
        for (last, drive) in self.words.iter_mut().zip(drives) {
            let word = drive.control_word();
            due |= word != *last || !drive.is_settled();
            *last = word;
        }
        if due {
            self.since = 0;
        }
        due
    }

    /// Notes whether a joint has a set-point, and its drive's state.
    fn note(&mut self, joint: usize, driven: bool, state: DriveState, angle: f64) {
        let Some(joint) = self.joints.get_mut(joint) else {
            return;
        };
        joint.driven |= driven;
        if driven || state != DriveState::Enabled {
            (joint.deaf, joint.left_at) = (0, angle);
            return;
        }
        joint.deaf = joint.deaf.saturating_add(1);
        let runs = (angle - joint.left_at).abs() > RUNS_WAY;
        if runs && joint.deaf > self.runs_limit {
            joint.deaf = joint.deaf.max(self.deaf_limit.saturating_add(1));
        }
    }

    /// Where the motor of a joint stands whose drive is about to be enabled, rad; none of others.
    fn where_it_stands(
        &self,
        j: usize,
        supervisor: &Supervisor,
        measured: &MeasuredRecord,
    ) -> Option<f64> {
        let joint =
            (self.joints.get(j)).filter(|joint| joint.takes_position && joint.controlled)?;
        let now = measured.joints.get(j)?;
        let [min, max] = joint.limits;
        let angle = (now.theta / joint.gear_ratio).max(min).min(max);
        (supervisor.is_about_to_engage(j) && angle.is_finite()).then_some(angle)
    }

    fn set(&mut self, slot: usize, value: Option<f64>) {
        if let Some(slot) = self.slots.get_mut(slot) {
            *slot = value.unwrap_or(f64::NAN);
        }
    }
}

/// The joints of each message that carries several set-points.
fn shared(table: &Table) -> Vec<Vec<usize>> {
    let joints = |message| {
        let sent = table.slots(message).map(slots::sent);
        let commands = sent.filter_map(|sent| match sent {
            slots::Sent::Command(joint) => Some(joint),
            slots::Sent::Control(_) => None,
        });
        commands.collect::<Vec<_>>()
    };
    let messages = (0..table.message_count()).map(joints);
    messages.filter(|joints| joints.len() > 1).collect()
}

/// A brake holds the joint, whose drive has no position loop, while its control words keep it off.
pub(crate) fn has_brake(joint: &JointParameters) -> bool {
    let brake = |profile: &DriveProfile| profile.brake && profile.control.is_some();
    !joint.takes_position() && joint.drive_profile.as_ref().is_some_and(brake)
}

/// The drive's status word, if one arrived in this cycle.
pub(crate) fn status(measured: &JointMeasured) -> Option<u32> {
    let missed = measured_flags::NEVER | measured_flags::MISSED | measured_flags::STALE;
    (measured.flags & missed == 0).then_some(measured.status)
}
