//! Cycles of the humanoid (30 joints, every estimator on), for their time and for their instructions:
//! `docs/cycle-time.md`.
//!
//! `humanoid [CYCLES]` prints the times of so many cycles (3000) of each mode.
//! `valgrind --tool=callgrind --toggle-collect='cycle::cycle::Cycle::step' target/release/examples/humanoid 500`
//! counts the instructions of `Cycle::step` alone.

#![allow(
    clippy::disallowed_macros,
    clippy::disallowed_methods,
    reason = "prints what the clock shows"
)]

use can_codec::{Frames, MAX_FRAMES};
use cycle::{ClientInput, Cycle, Instants, Stamp};
use plant::{CanRobot, SimParameters};
use robot_state::{JointReference, MAX_JOINTS, Mode, Reference};
use std::time::Instant;
use test_support::read_project_file as read;

/// Cycles after each change of mode that are not counted: filters and transitions settle.
const SETTLING: u64 = 200;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let cycles = match std::env::args().nth(1) {
        Some(number) => number.parse()?,
        None => 3000,
    };
    let path = "config/humanoid/robot.toml";
    let robot = robot_config::load(path, &read).map_err(|e| format!("{e:?}"))?;
    let sim_path = "config/humanoid/sim.toml";
    let sim = SimParameters::parse(&read(sim_path)?, sim_path).map_err(|e| format!("{e:?}"))?;
    let urdf = read(&robot.parameters.urdf_path)?;
    let mut plant = CanRobot::new(&robot, &urdf, &sim).map_err(|e| format!("{e:?}"))?;
    let mut cycle = Cycle::new(&robot).map_err(|e| format!("{e:?}"))?;
    let mut sync = Frames::default();
    for frame in &robot.sync {
        sync.push(*frame);
    }
    let (mut rx, mut tx) = (Frames::new(MAX_FRAMES), Frames::new(MAX_FRAMES));
    let mut reference = Reference::default();
    let mut stood = [0.0; MAX_JOINTS];
    let modes = [
        (Mode::Hold, "hold"),
        (Mode::InverseDynamics, "inverse dynamics"),
        (Mode::Position, "position, a new target in every cycle"),
        (Mode::Stand, "stand"),
    ];
    let mut k = 0;
    for (mode, name) in modes {
        let record = cycle.record();
        (reference.mode, reference.joint_count) = (mode.number(), record.joint_count);
        for (stood, joint) in stood.iter_mut().zip(&record.measured.joints) {
            *stood = joint.q;
        }
        let mut times_us = Vec::new();
        for own in 0..SETTLING + cycles {
            k += 1;
            let now = 1_000_000_000 + 1_000_000 * k;
            rx.clear();
            plant.exchange(&sync, now, &mut rx);
            tx.clear();
            // Slow and small, so that the robot goes on standing.
            let moved = match mode {
                Mode::Position => 0.005 * (2e-3 * own as f64).sin(),
                _ => 0.0,
            };
            for (desired, stood) in reference.joints.iter_mut().zip(stood) {
                *desired = JointReference {
                    q_d: stood + moved,
                    ..JointReference::default()
                };
            }
            reference.sequence = k;
            let client = ClientInput {
                reference: (mode != Mode::Hold).then_some(&reference),
                age_s: 0.001,
                ..ClientInput::default()
            };
            let at = Instants {
                sync: Stamp(now),
                now: Stamp(now),
            };
            let begin = Instant::now();
            cycle.step(at, &rx, &client, &mut tx);
            if own >= SETTLING {
                times_us.push(begin.elapsed().as_secs_f64() * 1e6);
            }
            let mut none = Frames::default();
            plant.exchange(&tx, now, &mut none);
        }
        let reached = cycle.record().mode;
        if reached != mode.number() {
            return Err(format!("{name}: mode {reached}").into());
        }
        times_us.sort_by(f64::total_cmp);
        let share = |share: f64| times_us[(share * (times_us.len() - 1) as f64) as usize];
        let (median, most) = (share(0.5), share(0.99));
        println!("{name}: median {median:.1} us, 99 of 100 below {most:.1} us");
    }
    Ok(())
}
