//! The delay-compensated torque in the cycle: better than either of its sources at the same instant.

use crate::common;

use common::{Bench, client_input};
use robot_state::torque_flags;

/// The standing humanoid swings an arm once a second.
#[test]
fn the_delay_compensated_torque_is_better_than_its_sources() {
    const MOVED: [(&str, f64); 2] = [("left_shoulder_pitch", 0.5), ("left_elbow", -0.6)];
    const CYCLES: u32 = 4_000;
    const FROM: u32 = 1_500;
    let mut bench = Bench::new("humanoid");
    let mut reference = bench.follow();
    let joints = &bench.robot.parameters.joints;
    let place = |name: &str| joints.iter().position(|j| j.name == name).expect("joint");
    let moved = MOVED.map(|(name, size)| (place(name), size));
    let start = reference.joints.map(|j| j.q_d);
    // Squared errors: delay-compensated, encoders, F/T sensors.
    let mut sums = [[0.0; 3]; MOVED.len()];
    for k in 0..CYCLES {
        let omega = core::f64::consts::TAU;
        let (sin, cos) = (omega * 1e-3 * f64::from(k)).sin_cos();
        reference.sequence += 1;
        for (j, size) in moved {
            let joint = &mut reference.joints[j];
            joint.q_d = start[j] + 0.5 * size * (1.0 - cos);
            joint.dq_d = 0.5 * size * omega * sin;
            joint.ddq_d = 0.5 * size * omega * omega * cos;
        }
        bench.gather();
        let truth = moved.map(|(j, _)| bench.plant.robot().truth().joints[j].tau);
        let record = bench.compute(&client_input(&reference));
        for ((sums, (j, _)), truth) in sums.iter_mut().zip(moved).zip(truth) {
            let joint = &record.estimated.joints[j];
            let sources = [&joint.tau_hat, &joint.tau_encoder, &joint.tau_whole_body];
            for (sum, source) in sums.iter_mut().zip(sources) {
                assert!(source.flags & torque_flags::VALID != 0);
                *sum += if k < FROM {
                    0.0
                } else {
                    (source.tau - truth).powi(2)
                };
            }
        }
    }
    for (sums, (name, _)) in sums.iter().zip(MOVED) {
        let [compensated, encoders, whole_body] =
            sums.map(|s| (s / f64::from(CYCLES - FROM)).sqrt());
        assert!(
            compensated < 0.85 * encoders,
            "{name}: {compensated} of {encoders} N·m"
        );
        assert!(
            compensated < 0.85 * whole_body,
            "{name}: {compensated} of {whole_body} N·m"
        );
    }
}
