//! Reference: whether a robot can do what its client asks for, as far as that is the same in all modes.
//!
//! In: a client's message, field by field. Out: the numbered flaw that forbids to follow it. Each message is judged by
//! itself (finite, within the limits of joints and sensors) and against those before (positions and velocities move no
//! faster than the joints may, and velocities are those of the positions). Values that a mode does not use are only to
//! be finite.
//!
//! A desired velocity that its positions do not make is a force: `K_d dq_d` pulls the joint off a
//! `q_d` that stands still. So the way that `dq_d` makes ahead of `q_d` is followed, forgotten within
//! [`MEMORY_S`], and limited. Positions that move without a velocity are allowed: `dq_d = 0` only
//! damps. Smaller torques and accelerations than the limits are the client's own affair: the limiter
//! has the last word on them, and lets them rise no faster than the torque's rate.

use core::ops::RangeInclusive;

use control::JointGains;
use robot_config::{FtParameters, JointParameters, Robot};
use robot_state::{Event, JointMeasured, JointReference, MeasuredRecord, Reference, Wrench};
use supervisor::Limits;

use super::{ClientMode, cartesian};
use crate::time::SECONDS_PER_NS;

/// Greatest first distance of a desired position from the measured one: the joint's way in this time at its velocity
/// limit, s (docs/safety-promises.md, 6). Later ones may move at the velocity limit. Chosen; no experiment recorded.
const FIRST_DISTANCE_S: f64 = 0.05;
/// Desired positions and velocities may change this much faster than the limits, for clients' jitter.
/// Chosen; no experiment recorded.
const PACE: f64 = 1.5;
/// Way that a desired position may make at once, rad, or what counts as much of a prismatic joint. As a share of the
/// velocity limit it is the change that a desired velocity may make at once. Chosen; no experiment recorded.
const SLACK: f64 = 0.02;
/// For rounding of values that are meant to be the limit: as `ROUNDING` of crates/control/src/trajectory.rs.
const ROUNDING: f64 = 1.001;
/// Desired torques up to this share of the limit are limited; greater ones are no torques of this joint, and refused.
/// Chosen; no experiment recorded.
const OVERDRIVEN: f64 = 2.0;
/// Least speed of a motion to a target, as a share of the velocity limit. Chosen; no experiment recorded.
const SLOWEST: f64 = 1e-3;
/// Time within which the way that `dq_d` is ahead of `q_d` is forgotten, s. Chosen; no experiment recorded.
const MEMORY_S: f64 = 0.1;
/// Greatest way that `dq_d` is ahead of `q_d`: the joint's in this time at its velocity limit, s. Two and a half cycles
/// of a client at 1 kHz: velocities by differences are late.
const AHEAD_S: f64 = 0.0025;
/// Further way that `dq_d` may be ahead of `q_d`, as a share of the way that it makes within `MEMORY_S`: clients
/// differentiate by differences. Chosen; no experiment recorded.
const AHEAD_SHARE: f64 = 0.1;

/// What joints and sensors can have.
#[derive(Debug)]
pub(crate) struct Bounds {
    joints: Vec<JointBounds>,
    /// Greatest force and torque along each axis that each F/T sensor can measure, N and N·m.
    wrenches: Vec<[f64; 6]>,
}

/// Limits of a joint.
#[derive(Debug, Clone)]
struct JointBounds {
    limits: Limits,
    /// Positions that a reference may ask for, rad.
    range: RangeInclusive<f64>,
    gains: JointGains,
    /// Greatest |ddq_d|, rad/s².
    acceleration: f64,
}

/// Pace of a joint's references.
#[derive(Debug, Clone)]
struct Pace {
    /// The last one.
    q_d: f64,
    dq_d: f64,
    /// Way that a desired position may make at once, rad.
    slack: f64,
    /// The part of it left for `q_d`, rad.
    credit: f64,
    /// Way that `dq_d` made and `q_d` did not, rad.
    ahead: f64,
    /// The joint's position was not followed: it begins anew.
    begins: bool,
}

/// Follows a client's references.
#[derive(Debug)]
pub(super) struct ReferenceCheck {
    bounds: Bounds,
    paces: Vec<Pace>,
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
            bounds: Bounds {
                joints: p.joints.iter().map(JointBounds::new).collect(),
                wrenches: p.ft_sensors.iter().map(FtParameters::reach).collect(),
            },
            paces: p.joints.iter().map(Pace::new).collect(),
            sample_period: p.timing.sample_period,
            longest: p.timing.reference_timeout,
            last: None,
            cycles: 0.0,
        }
    }

    pub(super) fn bounds(&self) -> &Bounds {
        &self.bounds
    }

    /// The message is for this robot, and all its numbers are finite.
    ///
    /// # Errors
    /// The flaw that it has.
    pub(super) fn is_sound(&self, reference: &Reference) -> Result<(), Event> {
        if reference.joint_count as usize != self.paces.len() {
            return Err(Event::ReferenceRejected);
        }
        if is_finite(reference) {
            Ok(())
        } else {
            Err(Event::ReferenceNotFinite)
        }
    }

    /// A cycle passes.
    pub(super) fn count_cycle(&mut self) {
        self.cycles += 1.0;
    }

    /// Takes the references of a mode one after the other; `begins`: the mode does.
    ///
    /// # Errors
    /// The flaw that forbids to follow this one after those before.
    pub(super) fn take(
        &mut self,
        mode: &mut dyn ClientMode,
        reference: &Reference,
        begins: bool,
        measured: &MeasuredRecord,
    ) -> Result<(), Event> {
        // A trajectory's reference is another one in every cycle, by its time alone.
        let is_new = self.last != Some((reference.sequence, reference.sent_ns));
        if !(begins || is_new) {
            return Ok(());
        }
        let time = self.time_since(reference);
        self.last = Some((reference.sequence, reference.sent_ns));
        self.cycles = 0.0;
        mode.takes(reference, begins, measured)?;
        let joints = self.paces.iter_mut().zip(&self.bounds.joints);
        let asked = reference.joints.iter().zip(&measured.joints);
        for (j, ((pace, bounds), (asked, measured))) in joints.zip(asked).enumerate() {
            let anew = begins || pace.begins;
            pace.begins = !mode.paces(reference, j);
            if pace.begins {
                continue;
            }
            if anew {
                pace.start(bounds, asked, measured)?;
            } else {
                pace.go_on(bounds, asked, time)?;
            }
        }
        Ok(())
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

impl Bounds {
    fn all(
        &self,
        reference: &Reference,
        mut can: impl FnMut(usize, &JointBounds, &JointReference) -> bool,
    ) -> bool {
        let joints = self.joints.iter().zip(&reference.joints).enumerate();
        let mut joints = joints.map(|(j, (joint, asked))| can(j, joint, asked));
        joints.all(|can| can)
    }

    /// Every desired torque is one that the joint may have, or is limited to.
    pub(super) fn torques(&self, reference: &Reference) -> bool {
        self.all(reference, |_, joint, asked| {
            asked.tau_d.abs() <= OVERDRIVEN * joint.limits.torque * ROUNDING
        })
    }

    /// Gains that the client gives are none, or within the configured ones.
    pub(super) fn softened(&self, reference: &Reference) -> bool {
        reference.gains_given != 1
            || self.all(reference, |_, joint, asked| joint.can_be_as_soft(asked))
    }

    /// Every desired position, velocity and acceleration is within the joint's limits.
    pub(super) fn motions(&self, reference: &Reference) -> bool {
        self.motions_of(reference, |_| true)
    }

    /// Motions of the joints for which `is_used` is true.
    pub(super) fn motions_of(
        &self,
        reference: &Reference,
        is_used: impl Fn(usize) -> bool,
    ) -> bool {
        self.all(reference, |j, joint, asked| !is_used(j) || joint.can(asked))
    }

    /// Every target can be gone to.
    pub(super) fn targets(&self, reference: &Reference) -> bool {
        self.all(reference, |_, joint, asked| joint.can_go_to(asked))
    }

    /// Contact wrenches, if the client gives any, are those that the F/T sensors can measure.
    pub(super) fn wrenches(&self, reference: &Reference) -> bool {
        let mut wrenches = self.wrenches.iter().zip(&reference.contact_wrench);
        reference.contact_wrench_given != 1
            || wrenches.all(|(reach, wrench)| is_measurable(reach, wrench))
    }
}

impl JointBounds {
    fn new(joint: &JointParameters) -> Self {
        Self {
            limits: joint.limits,
            range: joint.desired_range(),
            gains: joint.gains,
            acceleration: joint.desired_acceleration(),
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
}

impl Pace {
    fn new(joint: &JointParameters) -> Self {
        Self {
            q_d: 0.0,
            dq_d: 0.0,
            slack: joint.kind.threshold(SLACK),
            credit: 0.0,
            ahead: 0.0,
            begins: false,
        }
    }

    fn start(
        &mut self,
        bounds: &JointBounds,
        asked: &JointReference,
        measured: &JointMeasured,
    ) -> Result<(), Event> {
        let velocity = bounds.limits.velocity;
        if (asked.q_d - measured.q).abs() > FIRST_DISTANCE_S * velocity {
            return Err(Event::ReferenceJump);
        }
        let change = SLACK * velocity + PACE * bounds.acceleration * FIRST_DISTANCE_S;
        if (asked.dq_d - measured.dq).abs() > change {
            return Err(Event::ReferenceLimit);
        }
        (self.q_d, self.dq_d) = (asked.q_d, asked.dq_d);
        (self.credit, self.ahead) = (self.slack, 0.0);
        Ok(())
    }

    /// `time`: since the last message, s.
    fn go_on(
        &mut self,
        bounds: &JointBounds,
        asked: &JointReference,
        time: f64,
    ) -> Result<(), Event> {
        let Limits { velocity, .. } = bounds.limits;
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
        let quick = change.abs() > SLACK * velocity + PACE * bounds.acceleration * time;
        if pushes || quick {
            Err(Event::ReferenceLimit)
        } else {
            Ok(())
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
        && reference
            .center_of_mass_offset
            .iter()
            .all(|x| x.is_finite())
        && cartesian::is_finite(reference)
        && wrenches
            .flat_map(|w| w.force.iter().chain(&w.torque))
            .all(|x| x.is_finite())
}
