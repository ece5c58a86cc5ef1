//! One run of a joint on the bench.

use crate::joint::BenchJoint;
use crate::scenario::Scenario;
use identification::log::LogRow;
use plant::random::Random;
use plant::{Command, DriveSheet, JointRig, KinematicError, RigTiming};
use robot_state::JointKind;

/// Set points between two samples: drives interpolate (CiA 402's interpolated position mode). A
/// staircase of one step a sample would make a pulse of current in each, always sampled at its
/// end.
const SET_POINTS: usize = 5;
/// Steps of the simulation between two set points.
const SUBSTEPS: usize = 2;
/// Runs a scenario on the bench; the torque of each row is the sensor's, the one beside it the
/// true one.
#[must_use]
pub fn run(joint: &BenchJoint, scenario: &Scenario) -> Vec<(LogRow, f64)> {
    let j = &joint.file.joint;
    let sheet = DriveSheet {
        kind: JointKind::Revolute,
        gear_ratio: j.gear_ratio,
        torque_constant: j.torque_constant,
        rotor_inertia: j.rotor_inertia,
        motor_counts_per_turn: j.motor_counts_per_turn,
        link_counts_per_turn: j.link_counts_per_turn,
        command: Command::Position,
        kinematic_error: KinematicError::default(),
    };
    let period = 1.0 / j.sample_rate;
    let timing = RigTiming {
        period: period / SET_POINTS as f64,
        substeps: SUBSTEPS,
    };
    let load = scenario.load;
    let q_start = (scenario.q)(0.0);
    let mut rig = JointRig::new(&sheet, &joint.drive, load, timing, q_start, joint.seed);
    let start = rig.set_point() - q_start;
    let mut noise = Random::new(joint.seed, 1000 + scenario.stream);
    let count = (scenario.seconds / period).round() as usize;
    // The offset that carries the load at the start fades out.
    let set_point = |t: f64| (scenario.q)(t) + start * (-t / 0.2).exp();
    (1..=count)
        .map(|i| {
            let mut sample = None;
            for k in 1..=SET_POINTS {
                let t = ((i - 1) * SET_POINTS + k) as f64 * timing.period;
                rig.command(set_point(t));
                sample = Some(rig.advance((scenario.external)(t)));
            }
            let t = i as f64 * period;
            let sample = sample.expect("at least one set point a sample");
            let tau = sample.truth.tau;
            let row = LogRow {
                t,
                theta: sample.reading.theta,
                q: sample.reading.q,
                current: sample.reading.current,
                tau_sensor: tau + joint.sensor_noise * noise.normal(),
                feed_forward: f64::NAN,
            };
            (row, tau)
        })
        .collect()
}
