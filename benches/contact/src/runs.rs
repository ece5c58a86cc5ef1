//! The runs: steps of external torque, motion without contact, collisions.

use crate::robots::{Busy, Changes, Doing, SURFACE, Study, limb, swell};
use robot_state::{CycleRecord, Event, JointReference, Mode, Reference, RobotState};
use safety_bench::{At, Drives, Rig};

/// One step on one joint.
#[derive(Debug, Clone)]
pub(crate) struct Step {
    pub(crate) joint: usize,
    /// Time from its begin to the flag of that joint, and of any joint, ms.
    pub(crate) own: Option<usize>,
    pub(crate) any: Option<usize>,
    /// Time to event 209, ms.
    pub(crate) event: Option<usize>,
}

/// Time for which a step acts, and for which the robot is left alone after it, cycles.
const ACTS: usize = 60;
const RESTS: usize = 300;

/// Steps of `share` of the rated torque, up and down in turn, on every joint.
///
/// # Errors
/// A robot that does not get into the state.
pub(crate) fn steps(study: &Study, doing: Doing, share: f64) -> Result<Vec<Step>, String> {
    let mut busy = Busy::new(study, doing)?;
    let mut steps = Vec::new();
    for (joint, rated) in study.rated.iter().enumerate() {
        let torque = share * rated * if joint % 2 == 0 { 1.0 } else { -1.0 };
        // A flag of before is no answer to this step.
        for _ in 0..10 * RESTS {
            busy.step(|_, _, _| {});
            if flagged(busy.rig.cycle.record()).next().is_none() {
                break;
            }
        }
        let before = busy.rig.count(Event::ExternalContact);
        let mut step = Step {
            joint,
            own: None,
            any: None,
            event: None,
        };
        for k in 1..=ACTS {
            busy.step(move |at, rig, _| load(at, rig, joint, torque));
            let record = busy.rig.cycle.record();
            if flagged(record).any(|j| j == joint) {
                step.own.get_or_insert(k);
            }
            if flagged(record).next().is_some() {
                step.any.get_or_insert(k);
            }
            if busy.rig.count(Event::ExternalContact) > before {
                step.event.get_or_insert(k);
            }
        }
        for _ in 0..RESTS {
            busy.step(move |at, rig, _| load(at, rig, joint, 0.0));
        }
        steps.push(step);
    }
    Ok(steps)
}

fn load(at: At, rig: &mut Rig, joint: usize, torque: f64) {
    if at == At::Before {
        rig.plant.robot_mut().set_load(joint, torque);
    }
}

fn flagged(record: &CycleRecord) -> impl Iterator<Item = usize> {
    let joints = record.estimated.joints.iter().enumerate();
    let joints = joints.take(record.joint_count as usize);
    joints
        .filter(|(_, joint)| joint.contact_flag == 1)
        .map(|(j, _)| j)
}

/// Motion without contact.
#[derive(Debug, Clone, Default)]
pub(crate) struct Quiet {
    /// Simulated time, s.
    pub(crate) seconds: f64,
    /// Times that a flag was set, and events 209.
    pub(crate) flags: usize,
    pub(crate) events: u64,
    /// Greatest ratio to the lower threshold, the joint, and the time, s.
    pub(crate) ratio: f64,
    pub(crate) joint: String,
    pub(crate) at: f64,
    /// The same of each route, and mean lower thresholds over the rated torque.
    pub(crate) change: f64,
    pub(crate) lasting: f64,
    pub(crate) fault: u32,
}

/// Runs for a time without any contact that is not declared.
///
/// # Errors
/// A robot that does not get into the state.
pub(crate) fn quiet(study: &Study, doing: Doing, seconds: f64) -> Result<Quiet, String> {
    let mut busy = Busy::new(study, doing)?;
    let mut quiet = Quiet {
        seconds,
        ..Quiet::default()
    };
    let before = busy.rig.count(Event::ExternalContact);
    let mut last = vec![false; study.rated.len()];
    for k in 0..(1e3 * seconds) as usize {
        busy.step(|_, _, _| {});
        let record = busy.rig.cycle.record();
        for (j, joint) in record.estimated.joints.iter().enumerate().take(last.len()) {
            let now = joint.contact_flag == 1;
            quiet.flags += usize::from(now && !last[j]);
            last[j] = now;
            quiet.change = quiet
                .change
                .max(joint.tau_ext_change.abs() / study.rated[j]);
            quiet.lasting = quiet.lasting.max(joint.tau_ext.abs() / study.rated[j]);
            if joint.contact_ratio > quiet.ratio {
                (quiet.ratio, quiet.at) = (joint.contact_ratio, 1e-3 * k as f64);
                quiet
                    .joint
                    .clone_from(&busy.rig.robot.parameters.joints[j].name);
            }
        }
        if record.fault != 0 {
            quiet.fault = record.fault;
            quiet.seconds = 1e-3 * k as f64;
            break;
        }
    }
    quiet.events = busy.rig.count(Event::ExternalContact) - before;
    Ok(quiet)
}

/// A collision.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Collision {
    /// Speed of the limb's end when it meets the surface, m/s.
    pub(crate) speed: f64,
    /// Greatest force, N, and when, ms after the first touch; force after a second, N.
    pub(crate) peak: f64,
    pub(crate) peak_ms: f64,
    pub(crate) after: f64,
    /// Time from the touch to the flag and to the event, ms.
    pub(crate) flag_ms: Option<usize>,
    pub(crate) event_ms: Option<usize>,
    /// Greatest depth, mm.
    pub(crate) depth: f64,
    pub(crate) fault: u32,
    pub(crate) state: u32,
}

/// A limb's end comes down on a surface at `speed`, m/s.
///
/// # Errors
/// A robot that does not get into the state.
pub(crate) fn collision(
    (robot, drives): (&'static str, Drives),
    reaction: &'static str,
    seed: u64,
    speed: f64,
) -> Result<Collision, String> {
    let changes = Changes {
        seed,
        reaction: Some(reaction),
        surface: true,
        ..Changes::default()
    };
    let study = Study::new(robot, drives, &changes)?;
    let mut busy = Busy::new(&study, Doing::Hang)?;
    let limb = limb(robot);
    let names = &study.prepared.robot.parameters.joints;
    let hip = names
        .iter()
        .position(|joint| joint.name == limb.joint)
        .unwrap_or(0);
    let begin = busy.rig.client.reference;
    let rate = speed / limb.length;
    let mut result = Collision::default();
    let mut touched: Option<usize> = None;
    for k in 0..2500 {
        let next = approach(&begin, hip, rate, 1e-3 * k as f64);
        busy.step(move |at, rig, _| {
            if at == At::Client {
                let sequence = rig.client.reference.sequence;
                rig.client.reference = next;
                rig.client.reference.sequence = sequence;
            }
        });
        let truth = busy.rig.plant.truth();
        let force = truth.external.first().map_or(0.0, |e| {
            e.wrench.force.iter().map(|f| f * f).sum::<f64>().sqrt()
        });
        let record = busy.rig.cycle.record();
        let Some(begin) = touched else {
            if record.fault != 0 || flagged(record).next().is_some() {
                result.fault = record.fault;
                return Err(format!("{reaction}: flag before the contact, {result:?}"));
            }
            if force > 0.0 {
                touched = Some(k);
                result.speed = limb.length * truth.joints[hip].dq;
            }
            continue;
        };
        if force > result.peak {
            (result.peak, result.peak_ms) = (force, (k - begin) as f64);
        }
        result.depth = result.depth.max(1e3 * force / SURFACE);
        if flagged(record).next().is_some() {
            result.flag_ms.get_or_insert(k - begin);
        }
        if busy.rig.count(Event::ExternalContact) > 0 {
            result.event_ms.get_or_insert(k - begin);
        }
        if k - begin == 1000 {
            (result.after, result.fault, result.state) = (force, record.fault, record.state);
            break;
        }
    }
    match touched {
        Some(_) => Ok(result),
        None => Err(format!("{reaction}: the surface was not touched")),
    }
}

/// The reference on the way down: at the rate from 0.3 s on, 1.2 rad in all: beyond the second that is judged.
fn approach(begin: &Reference, hip: usize, rate: f64, t: f64) -> Reference {
    let mut reference = *begin;
    let ramp = 0.3;
    let end = ramp + 1.2 / rate;
    let position = |t: f64| {
        // Integral of the swelling rate.
        let t = t.min(end);
        let x = (t / ramp).min(1.0);
        let during = ramp * 0.5 * (x - (std::f64::consts::PI * x).sin() / std::f64::consts::PI);
        rate * (during + (t - ramp).max(0.0))
    };
    let (dq, ddq) = match t {
        t if t < ramp => {
            let (s, ds, _) = swell(t / ramp);
            (rate * s, rate * ds / ramp)
        }
        t if t < end => (rate, 0.0),
        _ => (0.0, 0.0),
    };
    if let Some(asked) = reference.joints.get_mut(hip) {
        *asked = JointReference {
            q_d: asked.q_d + position(t),
            dq_d: dq,
            ddq_d: ddq,
            ..*asked
        };
    }
    reference.mode = Mode::InverseDynamics.number();
    reference
}

/// The state's name.
pub(crate) fn state(number: u32) -> &'static str {
    RobotState::from_number(number).map_or("?", RobotState::name)
}
