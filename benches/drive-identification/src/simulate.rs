//! Robots in the identification's motion, in lock-step: the loop with its frames, and the plant.

use crate::variant::Variant;
use can_codec::{Frames, MAX_FRAMES};
use cycle::{ClientInput, Cycle, Instants, Stamp};
use dynamics::Base;
use identification::drive::chirp::Chirp;
use identification::drive::recorded::{DriveSample, Gather, knowledge};
use identification::drive::{DriveKnowledge, DriveLog};
use plant::parameters::HarnessParameters;
use plant::{CanRobot, SimParameters};
use robot_config::Robot;
use robot_state::{Mode, Reference, measured_flags};

/// True parameters of the plant's drive, link side.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Truth {
    pub(crate) stiffness: f64,
    pub(crate) damping: f64,
    pub(crate) dead_zone: f64,
    pub(crate) inertia: f64,
    pub(crate) delay: f64,
    pub(crate) coulomb: f64,
    /// Stiffness of the gear beyond its wind-up.
    pub(crate) gear: f64,
}

/// A joint's log, what its configuration states, and what is true.
pub(crate) struct Recorded {
    pub(crate) joint: String,
    pub(crate) known: DriveKnowledge,
    pub(crate) log: DriveLog,
    pub(crate) truth: Truth,
    /// The fault that ended it, or 0.
    pub(crate) fault: u32,
}

/// The link by which the humanoid hangs.
const HARNESS: &str = "chest_pitch_link";
/// Time at rest before and after the motion, s.
const REST_S: f64 = 0.5;

/// Text of a file of the project.
fn read(path: &str) -> std::io::Result<String> {
    std::fs::read_to_string(format!("{}/../../{path}", env!("CARGO_MANIFEST_DIR")))
}

/// Loads a robot and its simulation.
pub(crate) fn load(name: &str) -> Result<(Robot, SimParameters), String> {
    let robot = robot_config::load(&format!("config/{name}/robot.toml"), &read);
    let path = format!("config/{name}/sim.toml");
    let text = read(&path).map_err(|e| format!("{path}: {e}"))?;
    let sim = SimParameters::parse(&text, &path).map_err(|e| e.to_string())?;
    Ok((robot.map_err(|e| e.to_string())?, sim))
}

/// Moves some joints of a robot, and gives the log of each.
pub(crate) fn run(
    name: &str,
    joints: &[usize],
    seed: u64,
    variant: Variant,
) -> Result<Vec<Recorded>, String> {
    let (robot, mut sim) = load(name)?;
    sim.seed = seed;
    let p = &robot.parameters;
    if p.base == Base::Floating {
        hang(&mut sim);
    }
    variant.apply(&mut sim, p.timing.sample_period);
    let urdf = read(&p.urdf_path).map_err(|e| e.to_string())?;
    let mut plant = CanRobot::new(&robot, &urdf, &sim).map_err(|e| e.to_string())?;
    let mut cycle = Cycle::new(&robot).map_err(|e| e.to_string())?;
    let (mut rx, mut tx) = (Frames::new(MAX_FRAMES), Frames::new(MAX_FRAMES));
    let (mut sync, mut none) = (Frames::default(), Frames::default());
    for frame in &robot.sync {
        sync.push(*frame);
    }
    let dt = p.timing.sample_period;
    let mut gather: Vec<Gather> = (joints.iter())
        .map(|&j| Gather::new(&p.joints[j], dt))
        .collect();
    let chirps: Vec<Chirp> = (joints.iter())
        .map(|&j| {
            Chirp::of_joint(
                p.joints[j].kind,
                p.joints[j].limits.velocity,
                p.joints[j].acceleration(),
            )
        })
        .collect();
    let mut reference = Reference {
        mode: Mode::Hold.number(),
        joint_count: p.joints.len() as u32,
        ..Reference::default()
    };
    let mut start: Option<(u64, Vec<f64>)> = None;
    let (mut now, mut fault) = (1_000_000_000_u64, 0);
    let cycles = ((3.0 + 12.0 + 2.0 * REST_S) / dt) as u64;
    for k in 0..cycles {
        now += (1e9 * dt) as u64;
        rx.clear();
        plant.exchange(&sync, now, &mut rx);
        tx.clear();
        let at = Instants {
            sync: Stamp(now),
            now: Stamp(now),
        };
        let input = ClientInput {
            reference: Some(&reference),
            ..ClientInput::default()
        };
        let record = cycle.step(at, &rx, &input, &mut tx);
        fault = record.fault;
        let measured = &record.measured.joints[..p.joints.len()];
        let unready = measured_flags::NEVER | measured_flags::SETTLING;
        if start.is_none() && measured.iter().all(|j| j.flags & unready == 0) && k as f64 * dt > 1.0
        {
            start = Some((k, measured.iter().map(|j| j.q).collect()));
        }
        if let Some((first, from)) = &start {
            let t = (k - first) as f64 * dt;
            let motion = t - REST_S;
            if motion > 0.0 && motion < chirps[0].duration && record.mode == reference.mode {
                let stamp = now as f64 * 1e-9;
                for (gather, &j) in gather.iter_mut().zip(joints) {
                    if let Some(sample) = DriveSample::of(record, j, 0.0) {
                        gather.take(stamp, &sample);
                    }
                }
            }
            reference.sequence += 1;
            reference.mode = Mode::InverseDynamics.number();
            for (joint, q) in reference.joints.iter_mut().zip(from) {
                joint.q_d = *q;
            }
            for (&j, chirp) in joints.iter().zip(&chirps) {
                let [q, dq, ddq] = match variant {
                    Variant::Plan => parts(motion, chirp),
                    _ => chirp.at(motion),
                };
                let range = &p.joints[j].limits;
                // Towards the middle of its range.
                let middle = 0.5 * (range.position_min + range.position_max);
                let side = if from[j] > middle { -1.0 } else { 1.0 };
                let place = &mut reference.joints[j];
                (place.q_d, place.dq_d, place.ddq_d) = (from[j] + side * q, side * dq, side * ddq);
            }
        }
        plant.exchange(&tx, now, &mut none);
    }
    let results = joints.iter().zip(gather).map(|(&j, gather)| {
        let joint = &p.joints[j];
        let drive = &sim.drives[&joint.drive];
        let n = joint.encoders.gear_ratio;
        let torque = n * plant.robot().torque_of_current(j);
        Recorded {
            joint: joint.name.clone(),
            known: knowledge(joint),
            log: gather.end(),
            truth: Truth {
                stiffness: torque * drive.controller.k_4,
                damping: torque * drive.controller.k_5,
                dead_zone: drive.controller.dead_zone,
                inertia: joint.rotor_inertia * n * n,
                delay: delay(&sim, drive, dt),
                coulomb: n * drive.friction.coulomb,
                gear: drive.transmission.stiffness,
            },
            fault,
        }
    });
    Ok(results.collect())
}

/// Mean time from a sample until the current of its command flows: transport, wait for the drive's position
/// loop, current loop.
fn delay(sim: &SimParameters, drive: &plant::parameters::DriveParameters, period: f64) -> f64 {
    let tick = (1.0 / (drive.controller.rate * sim.substep))
        .round()
        .max(1.0)
        * sim.substep;
    let transport = sim.transport.delay.unwrap_or(period);
    let (mut wait, count) = (0.0, 1000);
    for k in 0..count {
        for part in 0..20 {
            let jitter = sim.transport.jitter * (f64::from(part) + 0.5) / 20.0;
            let arrives = ((f64::from(k) * period + transport + jitter) / sim.substep).round();
            let steps = (tick / sim.substep).round();
            let next = (arrives / steps - 1e-9).ceil() * steps;
            wait += jitter + (next - arrives) * sim.substep;
        }
    }
    transport + wait / f64::from(20 * count) + drive.controller.current_loop
}

/// The parts of the command's own plan: a growing sine, then low and high chirps in turn.
fn parts(t: f64, chirp: &Chirp) -> [f64; 3] {
    let plan = chirp.parts();
    let lengths = plan.map(|part| part.duration);
    let mut start = 0.0;
    for (part, length) in plan.iter().zip(lengths) {
        if t < start + length {
            return part.at(t - start);
        }
        start += length;
    }
    [0.0; 3]
}

/// A stiff harness instead of the floor.
fn hang(sim: &mut SimParameters) {
    (sim.ground, sim.start.on_ground) = (None, false);
    sim.harness = Some(HarnessParameters {
        link: HARNESS.to_owned(),
        stiffness: 2e5,
        damping: 3e3,
        angular_stiffness: 2e4,
        angular_damping: 3e2,
        slack: 0.0,
        angular_slack: 0.0,
    });
}
