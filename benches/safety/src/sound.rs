//! Sound motion for hours: nothing is broken, yet the loop pauses, answers are late and frames are lost. A fault that
//! latches here is a false stop.

use can_codec::Frame;
use problem::Problem;
use robot_state::{EVENT_COUNT, Event, Mode};
use serde::Serialize;
use std::f64::consts::TAU;

use crate::rig::{At, Fault, Rig};
use crate::robots::Prepared;
use crate::run::{begin, is_of_arm};
use crate::scenarios::{Place, Start, both, noise};

/// Simulated time of a run, cycles: a minute.
const CYCLES: usize = 60_000;
/// Longest pause of the loop, cycles, and the time in which one falls.
const LONGEST_PAUSE: f64 = 15.0;
const PAUSE_EVERY: usize = 1000;
/// Share of the frames that are lost on their way, in both directions.
const LOST: f64 = 1e-3;
/// Share of the answers that come late, and by how many cycles at most.
const LATE: f64 = 1e-2;
const LATE_CYCLES: f64 = 2.0;
/// Least and greatest frequency of the motion, Hz.
const FREQUENCIES: (f64, f64) = (0.1, 1.0);
/// Greatest amplitude, rad, and the greatest share of the velocity limit that it reaches.
const AMPLITUDE: f64 = 0.25;
const SPEED_SHARE: f64 = 0.3;
/// Amplitude of the desired torque in mode torque, share of the torque limit: joints stay within their range.
const TORQUE_SHARE: f64 = 0.01;
/// Stiffness and damping of the client's springs, torque limits per rad and per rad/s.
const STIFFNESS: f64 = 0.5;
const DAMPING: f64 = 0.05;

/// A minute of one robot in one state.
#[derive(Debug, Clone, Serialize)]
pub struct SoundOutcome {
    /// Robot and drives.
    pub robot: String,
    /// State at the beginning.
    pub start: &'static str,
    /// Seed of motion and disturbances.
    pub seed: u64,
    /// Simulated time until the fault, or of the whole run, s.
    pub seconds: f64,
    /// The latched fault's number, or 0.
    pub fault: u32,
    /// Number of the event that ended the client's mode without a latched fault; 0: the mode went on.
    pub ended_by: u32,
}

/// Runs a minute of sound motion.
///
/// # Errors
/// A robot that does not get into the state.
pub fn run_sound(prepared: &Prepared, start: Start, seed: u64) -> Result<SoundOutcome, Problem> {
    let place = Place {
        variant: prepared.variant,
        joint: 0,
        other: 0,
        bus: 0,
        // Its motion begins at rest.
        start: if start == Start::Motion {
            Start::InverseDynamics
        } else {
            start
        },
    };
    let (mut rig, _) = begin(prepared, &place, None)?;
    let mut act = both(
        match start {
            Start::Motion => motion(&rig, seed),
            Start::Torque => torques(&rig, seed),
            _ => Box::new(|_, _, _| {}),
        },
        disturbances(seed),
    );
    let mode = rig.cycle.record().mode;
    let mut outcome = SoundOutcome {
        robot: prepared.variant.name(),
        start: start.name(),
        seed,
        seconds: 1e-3 * CYCLES as f64,
        fault: 0,
        ended_by: 0,
    };
    let mut before = rig.cycle.record().events;
    for k in 0..CYCLES {
        rig.step(Some((&mut act, k)));
        let record = rig.cycle.record();
        let left = mode != Mode::Hold.number() && record.mode != mode;
        if record.fault != 0 || left {
            outcome.seconds = 1e-3 * (k + 1) as f64;
            outcome.fault = record.fault;
            outcome.ended_by = newest(&record.events, &before);
            break;
        }
        before = record.events;
    }
    Ok(outcome)
}

/// The last event, by its number, that this cycle has counted.
fn newest(now: &[u64; EVENT_COUNT], before: &[u64; EVENT_COUNT]) -> u32 {
    let new = (Event::ALL.iter()).filter(|event| now[event.index()] > before[event.index()]);
    new.map(|event| event.number()).max().unwrap_or(0)
}

/// Joints that move: what the humanoid stands on does not.
fn moves(rig: &Rig, joint: usize) -> bool {
    let p = &rig.robot.parameters;
    p.name != "humanoid" || is_of_arm(&p.joints[joint].name)
}

/// Each joint swings at a frequency of its own, led in without a step.
fn motion(rig: &Rig, seed: u64) -> Fault {
    let mut random = noise(seed ^ 0x5eed);
    let joints = &rig.robot.parameters.joints;
    let swings: Vec<_> = (0..joints.len())
        .map(|j| {
            let u = (random() + 1.0) / 2.0;
            let w = TAU * FREQUENCIES.0 * (FREQUENCIES.1 / FREQUENCIES.0).powf(u);
            let most = SPEED_SHARE * joints[j].limits.velocity / w;
            let way = joints[j].kind.threshold(AMPLITUDE).min(most);
            (moves(rig, j), w, way)
        })
        .collect();
    let mut at_start = None;
    Box::new(move |at, rig, k| {
        if at != At::Client {
            return;
        }
        let q_0 = *at_start.get_or_insert(rig.client.reference.joints.map(|joint| joint.q_d));
        let t = 1e-3 * k as f64;
        let asked = rig.client.reference.joints.iter_mut();
        for ((joint, q_0), (_, w, way)) in asked.zip(q_0).zip(&swings).filter(|(_, s)| s.0) {
            let half = 0.5 * way;
            joint.q_d = q_0 + half * (1.0 - (w * t).cos());
            joint.dq_d = half * w * (w * t).sin();
            joint.ddq_d = half * w * w * (w * t).cos();
        }
    })
}

/// The torque that each joint carries, a small one beside it that swings, and the springs and dampers of a client that
/// keeps the joint where it is: by torques alone it would go away in a minute.
fn torques(rig: &Rig, seed: u64) -> Fault {
    let mut random = noise(seed ^ 0x70a9);
    let joints = &rig.robot.parameters.joints;
    let swings: Vec<_> = (joints.iter())
        .map(|joint| {
            let w = TAU * (0.55 + 0.45 * random());
            (w, TORQUE_SHARE * joint.limits.torque)
        })
        .collect();
    let carried = rig.client.reference.joints.map(|joint| joint.tau_d);
    let limits: Vec<f64> = joints.iter().map(|joint| joint.limits.torque).collect();
    let units: Vec<f64> = joints
        .iter()
        .map(|joint| joint.kind.threshold(1.0))
        .collect();
    let q_0: Vec<f64> = (rig.cycle.record().measured.joints.iter())
        .map(|joint| joint.q)
        .collect();
    Box::new(move |at, rig, k| {
        if at != At::Client {
            return;
        }
        let measured = rig.cycle.record().measured.joints;
        let asked = rig.client.reference.joints.iter_mut();
        for (j, ((joint, tau), (w, amplitude))) in asked.zip(carried).zip(&swings).enumerate() {
            let way = (measured[j].q - q_0[j]) / units[j];
            let held = limits[j] * (STIFFNESS * way + DAMPING * measured[j].dq / units[j]);
            joint.tau_d = tau + amplitude * (w * 1e-3 * k as f64).sin() - held;
        }
    })
}

/// Pauses, late answers and lost frames of a busy computer and a long cable.
fn disturbances(seed: u64) -> Fault {
    let mut random = noise(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let mut chance = move || (random() + 1.0) / 2.0;
    let mut late: Vec<(usize, Frame)> = Vec::new();
    let mut pause = 0..0;
    Box::new(move |at, rig, k| match at {
        At::Before => {
            if k % PAUSE_EVERY == 0 {
                let from = k + (chance() * (PAUSE_EVERY as f64 - LONGEST_PAUSE)) as usize;
                pause = from..from + 1 + (chance() * LONGEST_PAUSE) as usize;
            }
            rig.asleep = pause.contains(&k);
            if k == pause.end {
                rig.cycle.note(Event::SkippedCycle, pause.len() as u64);
            }
        }
        At::Answers => {
            let due = late.iter().filter(|(when, _)| *when <= k);
            let due: Vec<Frame> = due.map(|(_, frame)| *frame).collect();
            late.retain(|(when, _)| *when > k);
            let mut kept = due;
            for frame in std::mem::take(&mut rig.rx) {
                match chance() {
                    u if u < LOST => {}
                    u if u < LOST + LATE => {
                        let cycles = 1 + (chance() * LATE_CYCLES) as usize;
                        late.push((k + cycles, frame));
                    }
                    _ => kept.push(frame),
                }
            }
            rig.rx = kept;
        }
        At::Commands => rig.sent.retain(|_| chance() >= LOST),
        At::Client => {}
    })
}
