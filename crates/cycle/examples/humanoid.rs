//! Cycles of the humanoid, for counting the instructions of one: `docs/results/safety.md`.
//!
//! `valgrind --tool=callgrind --toggle-collect='cycle::cycle::Cycle::step' target/release/examples/humanoid`
//! counts those of `Cycle::step` alone: a second of hold, half a second of inverse dynamics.

use can_codec::{Frames, MAX_FRAMES};
use cycle::{ClientInput, Cycle, Instants, Stamp};
use plant::{CanRobot, SimParameters};
use robot_state::{JointReference, Mode, Reference};
use test_support::read_project_file as read;

fn main() -> Result<(), Box<dyn std::error::Error>> {
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
    for k in 0..1500_u64 {
        let now = 1_000_000_000 + 1_000_000 * k;
        rx.clear();
        plant.exchange(&sync, now, &mut rx);
        tx.clear();
        if k == 1000 {
            let record = cycle.record();
            (reference.mode, reference.joint_count) =
                (Mode::InverseDynamics.number(), record.joint_count);
            for (desired, joint) in reference.joints.iter_mut().zip(&record.measured.joints) {
                *desired = JointReference {
                    q_d: joint.q,
                    ..JointReference::default()
                };
            }
        }
        reference.sequence = k + 1;
        let client = ClientInput {
            reference: (k >= 1000).then_some(&reference),
            age_s: 0.001,
            ..ClientInput::default()
        };
        let at = Instants {
            sync: Stamp(now),
            now: Stamp(now),
        };
        cycle.step(at, &rx, &client, &mut tx);
        let mut none = Frames::default();
        plant.exchange(&tx, now, &mut none);
    }
    let record = cycle.record();
    if record.mode != Mode::InverseDynamics.number() {
        return Err(format!("mode {}", record.mode).into());
    }
    Ok(())
}
