//! Reference: whether a robot can do what its client asks for.
//!
//! In: a client's message, field by field. Out: the goal that it asks for, or the numbered flaw that
//! forbids to follow it. Each message is judged by itself (finite, within the limits of joints and
//! sensors) and against those before (positions and velocities move no faster than the joints may,
//! and velocities are those of the positions). Values that a mode does not use are only to be
//! finite.
//!
//! A desired velocity that its positions do not make is a force: `K_d dq_d` pulls the joint off a
//! `q_d` that stands still. So the way that `dq_d` makes ahead of `q_d` is followed, forgotten within
//! [`MEMORY_S`], and limited. Positions that move without a velocity are allowed: `dq_d = 0` only
//! damps. Smaller torques and accelerations than the limits are the client's own affair: the limiter
//! has the last word on them, and lets them rise no faster than the torque's rate.

use core::ops::RangeInclusive;

use control::JointGains;
use robot_config::{FtParameters, JointParameters, Robot, TorqueLaw};
use robot_state::{
    Event, JointMeasured, JointReference, MeasuredRecord, Mode, Reference, Wrench, source,
};
use supervisor::Limits;

use super::frame_check::FrameCheck;
use crate::time::SECONDS_PER_NS;

/// Greatest first distance of a desired position from the measured one: the joint's way in this
/// time at its velocity limit, s. Later ones may move at the velocity limit.
const FIRST_DISTANCE_S: f64 = 0.05;
/// Desired positions and velocities may change this much faster than the limits, for clients' jitter.
const PACE: f64 = 1.5;
/// Way that a desired position may make at once, rad (of a prismatic joint what counts as much), and as a
/// share of the velocity limit the change that a desired velocity may.
const SLACK: f64 = 0.02;
/// For rounding of values that are meant to be the limit.
const ROUNDING: f64 = 1.001;
/// Desired torques up to this share of the limit are limited; greater ones are no torques of this
/// joint, and refused.
const OVERDRIVEN: f64 = 2.0;
/// Least speed of a motion to a target, as a share of the velocity limit.
const SLOWEST: f64 = 1e-3;
/// Time within which the way that `dq_d` is ahead of `q_d` is forgotten, s.
const MEMORY_S: f64 = 0.1;
/// Greatest such way: the joint's in this time at its velocity limit, s, and a share of the way that
/// `dq_d` makes within `MEMORY_S`, as clients differentiate by differences.
const AHEAD_S: f64 = 0.0025;
const AHEAD_SHARE: f64 = 0.1;

/// Reaction of the limb of a joint in contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Answer {
    /// It is braked at once.
    Stop,
    /// It goes soft.
    Comply,
    /// It goes back on its way.
    Retract,
}

/// The goal of one cycle: a mode, with the checked reference that it follows.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Goal<'a> {
    /// Every joint in use stays where its last command holds it.
    Hold,
    /// The same at once, as something has failed: matters to drives without a position loop.
    Stop,
    /// The limb of a joint in contact answers it; all else stops.
    Contact {
        joint: usize,
        answer: Answer,
    },
    Torque(&'a Reference),
    InverseDynamics(&'a Reference),
    /// The targets of the reference, on the way that the loop plans.
    Position(&'a Reference),
    /// The frames of the reference, besides inverse dynamics.
    Cartesian(&'a Reference),
    /// Joints that are not held give way; the others follow the reference.
    Passive(&'a Reference),
    /// The positions of the reference, with the carried torque fed back.
    TorqueFeedbackMotion(&'a Reference),
    /// The positions of the reference, by a low stiffness and a learned feed-forward.
    LowGainTracking(&'a Reference),
}

impl<'a> Goal<'a> {
    pub(crate) fn mode(&self) -> Mode {
        match self {
            Self::Hold | Self::Stop | Self::Contact { .. } => Mode::Hold,
            Self::Torque(_) => Mode::Torque,
            Self::InverseDynamics(_) => Mode::InverseDynamics,
            Self::Position(_) => Mode::Position,
            Self::Cartesian(_) => Mode::Cartesian,
            Self::Passive(_) => Mode::Passive,
            Self::TorqueFeedbackMotion(_) => Mode::TorqueFeedbackMotion,
            Self::LowGainTracking(_) => Mode::LowGainTracking,
        }
    }

    pub(crate) fn reference(&self) -> Option<&'a Reference> {
        match *self {
            Self::Hold | Self::Stop | Self::Contact { .. } => None,
            Self::Torque(reference)
            | Self::InverseDynamics(reference)
            | Self::Position(reference)
            | Self::Cartesian(reference)
            | Self::Passive(reference)
            | Self::TorqueFeedbackMotion(reference)
            | Self::LowGainTracking(reference) => Some(reference),
        }
    }

    /// A joint is let go: the mode is passive, and it is not among those that are held.
    pub(crate) fn lets_go(&self, joint: usize) -> bool {
        match self {
            Self::Passive(reference) => reference.held_joints >> (joint & 63) & 1 == 0,
            _ => false,
        }
    }
}

/// Limits of a joint, and its last reference.
#[derive(Debug, Clone)]
struct Joint {
    limits: Limits,
    /// Positions that a reference may ask for, rad.
    range: RangeInclusive<f64>,
    gains: JointGains,
    /// Greatest |ddq_d|, rad/s².
    acceleration: f64,
    q_d: f64,
    dq_d: f64,
    /// Way that a desired position may make at once, rad.
    slack: f64,
    /// The part of it left for `q_d`, rad.
    credit: f64,
    /// Way that `dq_d` made and `q_d` did not, rad.
    ahead: f64,
    /// It gave way: the position at which it is held next begins anew.
    let_go: bool,
}

/// Follows a client's references.
#[derive(Debug)]
pub(super) struct ReferenceCheck {
    joints: Vec<Joint>,
    /// Greatest force and torque along each axis that each F/T sensor can measure, N and N·m.
    wrenches: Vec<[f64; 6]>,
    frames: FrameCheck,
    sample_period: f64,
    longest: f64,
    last: Option<(u64, u64)>,
    /// Cycles since the last new message.
    cycles: f64,
}

impl ReferenceCheck {
    pub(super) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        Self {
            joints: p.joints.iter().map(Joint::new).collect(),
            wrenches: p.ft_sensors.iter().map(FtParameters::reach).collect(),
            frames: FrameCheck::new(robot),
            sample_period: p.timing.sample_period,
            longest: p.timing.reference_timeout,
            last: None,
            cycles: 0.0,
        }
    }

    /// The goal that a reference asks for; the only place where a mode's number is read.
    ///
    /// # Errors
    /// The flaw that forbids to follow the reference.
    pub(super) fn goal<'a>(&self, reference: &'a Reference) -> Result<Goal<'a>, Event> {
        let goal = match Mode::from_number(reference.mode) {
            Some(Mode::Hold) => Goal::Hold,
            Some(Mode::Torque) => Goal::Torque(reference),
            Some(Mode::InverseDynamics) => Goal::InverseDynamics(reference),
            Some(Mode::Position) => Goal::Position(reference),
            Some(Mode::Cartesian) if self.frames.exist() => Goal::Cartesian(reference),
            Some(Mode::Cartesian) => return Err(Event::ReferenceRejected),
            Some(Mode::Passive) => Goal::Passive(reference),
            Some(Mode::TorqueFeedbackMotion) => Goal::TorqueFeedbackMotion(reference),
            Some(Mode::LowGainTracking) => Goal::LowGainTracking(reference),
            None => return Err(Event::ReferenceRejected),
        };
        if reference.joint_count as usize != self.joints.len() {
            return Err(Event::ReferenceRejected);
        }
        if !is_finite(reference) {
            return Err(Event::ReferenceNotFinite);
        }
        match self.is_within(&goal) {
            true => Ok(goal),
            false => Err(Event::ReferenceLimit),
        }
    }

    /// Every value that the goal uses is one that joint or sensor can have.
    fn is_within(&self, goal: &Goal<'_>) -> bool {
        let Some(reference) = goal.reference() else {
            return true;
        };
        let mut joints = self.joints.iter().zip(&reference.joints);
        if goal.mode() == Mode::Torque {
            return joints.all(|(joint, asked)| {
                asked.tau_d.abs() <= OVERDRIVEN * joint.limits.torque * ROUNDING
            });
        }
        let softens = reference.gains_given == 1;
        let mut gains = self.joints.iter().zip(&reference.joints);
        if softens && !gains.all(|(joint, asked)| joint.can_be_as_soft(asked)) {
            return false;
        }
        if goal.mode() == Mode::Position {
            return joints.all(|(joint, asked)| joint.can_go_to(asked));
        }
        if goal.mode() == Mode::Passive {
            let mut joints = joints.enumerate();
            return joints.all(|(j, (joint, asked))| goal.lets_go(j) || joint.can(asked));
        }
        if goal.mode() == Mode::Cartesian {
            return joints.all(|(joint, asked)| joint.can(asked))
                && self.frames.is_within(reference);
        }
        let wrenches = self.wrenches.iter().zip(&reference.contact_wrench);
        let given = reference.contact_wrench_given == 1;
        joints.all(|(joint, asked)| joint.can(asked))
            && (!given || wrenches.fold(true, |all, (reach, w)| all && is_measurable(reach, w)))
    }

    /// Takes the references of a mode one after the other; `first`: the mode begins.
    ///
    /// # Errors
    /// The flaw that forbids to follow this one after those before.
    pub(super) fn follows(
        &mut self,
        goal: &Goal<'_>,
        first: bool,
        measured: &MeasuredRecord,
    ) -> Result<(), Event> {
        self.cycles += 1.0;
        let paced = !matches!(goal, Goal::Torque(_) | Goal::Position(_));
        let reference = goal.reference().filter(|_| paced);
        let Some(reference) = reference.filter(|_| first || self.is_new(goal)) else {
            return Ok(());
        };
        let time = self.time_since(reference);
        self.last = Some((reference.sequence, reference.sent_ns));
        self.cycles = 0.0;
        if matches!(goal, Goal::Cartesian(_)) {
            match first {
                true if !self.frames.begins_near(reference, measured) => {
                    return Err(Event::ReferenceJump);
                }
                false if !self.frames.goes_on(reference) => return Err(Event::ReferenceRejected),
                _ => {}
            }
        }
        let joints = self.joints.iter_mut().zip(&reference.joints);
        for (j, ((joint, asked), measured)) in joints.zip(&measured.joints).enumerate() {
            let begins = first || joint.let_go;
            joint.let_go = goal.lets_go(j);
            if joint.let_go {
                continue;
            }
            if begins {
                joint.start(asked, measured)?;
            } else {
                joint.go_on(asked, time)?;
            }
        }
        Ok(())
    }

    fn is_new(&self, goal: &Goal<'_>) -> bool {
        // A trajectory's reference is another one in every cycle, by its time alone.
        let message = goal.reference().map(|r| (r.sequence, r.sent_ns));
        message != self.last
    }

    /// Time between the last reference and this one, s: as the loop has seen it, or longer where the
    /// client's own times of sending show that the loop has not run.
    fn time_since(&self, reference: &Reference) -> f64 {
        let sent = self.last.map_or(0, |(_, last)| match last {
            0 => 0,
            last => reference.sent_ns.saturating_sub(last),
        });
        let seen = self.cycles * self.sample_period;
        seen.max((sent as f64 * SECONDS_PER_NS).min(self.longest))
    }
}

impl Joint {
    fn new(joint: &JointParameters) -> Self {
        Self {
            limits: joint.limits,
            range: joint.desired_range(),
            gains: joint.gains,
            acceleration: joint.desired_acceleration(),
            q_d: 0.0,
            dq_d: 0.0,
            slack: joint.kind.threshold(SLACK),
            credit: 0.0,
            ahead: 0.0,
            let_go: false,
        }
    }

    /// Position, velocity and acceleration are within the joint's limits.
    fn can(&self, asked: &JointReference) -> bool {
        let limits = &self.limits;
        self.range.contains(&asked.q_d)
            && asked.dq_d.abs() <= limits.velocity * ROUNDING
            && asked.ddq_d.abs() <= self.acceleration * ROUNDING
    }

    /// Neither gain exceeds the configured one, and damping is reduced by no more than stiffness: a
    /// stiffness with less damping than the loop's margins were judged with swings.
    fn can_be_as_soft(&self, asked: &JointReference) -> bool {
        let JointGains { k_s, k_d, .. } = self.gains;
        let within = |gain: f64, most: f64| (0.0..=most * ROUNDING).contains(&gain);
        within(asked.stiffness, k_s)
            && within(asked.damping, k_d)
            && asked.damping * k_s * ROUNDING >= asked.stiffness * k_d
    }

    /// The target is within the position limits, and the speed on the way is none or one that leads
    /// there in a time that can be planned.
    fn can_go_to(&self, asked: &JointReference) -> bool {
        let limits = &self.limits;
        let speeds = SLOWEST * limits.velocity..=limits.velocity * ROUNDING;
        (limits.position_min..=limits.position_max).contains(&asked.q_d)
            && (asked.dq_d == 0.0 || speeds.contains(&asked.dq_d))
    }

    fn start(&mut self, asked: &JointReference, measured: &JointMeasured) -> Result<(), Event> {
        let way = FIRST_DISTANCE_S * self.limits.velocity;
        if (asked.q_d - measured.q).abs() > way {
            return Err(Event::ReferenceJump);
        }
        let slack = SLACK * self.limits.velocity;
        if (asked.dq_d - measured.dq).abs() > slack + PACE * self.acceleration * FIRST_DISTANCE_S {
            return Err(Event::ReferenceLimit);
        }
        (self.q_d, self.dq_d) = (asked.q_d, asked.dq_d);
        (self.credit, self.ahead) = (self.slack, 0.0);
        Ok(())
    }

    /// `time`: since the last message, s.
    fn go_on(&mut self, asked: &JointReference, time: f64) -> Result<(), Event> {
        let Limits { velocity, .. } = self.limits;
        let way = asked.q_d - std::mem::replace(&mut self.q_d, asked.q_d);
        let change = asked.dq_d - std::mem::replace(&mut self.dq_d, asked.dq_d);
        let pace = PACE * velocity * time;
        self.credit = (self.credit + pace).min(self.slack.max(pace)) - way.abs();
        if self.credit < 0.0 {
            return Err(Event::ReferenceJump);
        }
        let kept = (1.0 - time / MEMORY_S).max(0.0);
        let ahead = kept * self.ahead + asked.dq_d * time - way;
        let most = AHEAD_S * velocity + AHEAD_SHARE * MEMORY_S * asked.dq_d.abs();
        let pushes = ahead * asked.dq_d > 0.0 && ahead.abs() > most;
        self.ahead = ahead.clamp(-most, most);
        let quick = change.abs() > SLACK * velocity + PACE * self.acceleration * time;
        match pushes || quick {
            true => Err(Event::ReferenceLimit),
            false => Ok(()),
        }
    }
}

fn is_measurable(reach: &[f64; 6], wrench: &Wrench) -> bool {
    let axes = wrench.to_array();
    axes.iter()
        .zip(reach)
        .all(|(axis, most)| axis.abs() <= *most)
}

fn is_finite(reference: &Reference) -> bool {
    let joints = reference.joints.iter().take(reference.joint_count as usize);
    let joints_finite = joints
        .flat_map(|j| [j.q_d, j.dq_d, j.ddq_d, j.tau_d, j.stiffness, j.damping])
        .all(f64::is_finite);
    let wrenches = reference.contact_wrench.iter();
    joints_finite
        && super::frame_check::is_finite(reference)
        && wrenches
            .flat_map(|w| w.force.iter().chain(&w.torque))
            .all(|x| x.is_finite())
}

/// Bits of the sources that a mode needs; none: the robot does not have the mode.
pub(super) fn needs(mode: Mode, robot: &Robot) -> Option<u32> {
    let law = robot.parameters.torque_law;
    let used = |used: bool, bits: u32| if used { bits } else { 0 };
    let joints = &robot.parameters.joints;
    let by_encoders = law.uses_encoders() && joints.iter().any(|j| j.has_link_encoder);
    let by_sensors = law.uses_sensors() || joints.iter().any(|j| !j.has_link_encoder);
    let feedback = used(by_encoders, source::ENCODER_TORQUE) | used(by_sensors, source::WHOLE_BODY);
    let needs = match mode {
        Mode::Hold => 0,
        Mode::Torque | Mode::TorqueFeedbackMotion => feedback,
        // Gravity by the base's motion, and the contact wrenches.
        Mode::InverseDynamics
        | Mode::Position
        | Mode::Cartesian
        | Mode::Passive
        | Mode::LowGainTracking => feedback | source::WHOLE_BODY,
    };
    let exists = match mode {
        Mode::Cartesian => !robot.parameters.frames.is_empty(),
        // Its margins are known of torque without delay alone.
        Mode::TorqueFeedbackMotion => {
            matches!(law, TorqueLaw::Predictive(_)) && joints.iter().all(|j| j.has_link_encoder)
        }
        Mode::LowGainTracking => joints.iter().any(|joint| joint.feed_forward.is_some()),
        _ => true,
    };
    exists.then_some(needs)
}
