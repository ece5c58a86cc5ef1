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

/// The calibrated humanoid crouches and swings its arms, slowly: both sources are good, and where their levels differ
/// `tau_hat` follows the one of which less is unknown. `benches/fusion` has the figures of longer runs and all robots.
#[test]
fn beside_a_calibrated_gear_the_level_is_shared_by_what_is_known() {
    const CYCLES: u32 = 3_500;
    const FROM: u32 = 500;
    let mut bench = Bench::reading("humanoid", &|path| {
        common::read(&path.replace("humanoid/robot.toml", "humanoid/calibrated.toml"))
    });
    let mut reference = bench.follow();
    let joints = &bench.robot.parameters.joints;
    let size = |name: &str| match name.split_once('_').map_or(name, |(_, part)| part) {
        "hip_pitch" | "ankle_pitch" => -0.1,
        "knee" => 0.2,
        "shoulder_pitch" | "elbow" => -0.3,
        "shoulder_yaw" | "wrist_yaw" | "wrist_pitch" => 0.2,
        _ => 0.0,
    };
    let sizes: Vec<f64> = joints.iter().map(|joint| size(&joint.name)).collect();
    let start = reference.joints.map(|joint| joint.q_d);
    // Squared errors of tau_hat and encoders, and the former over its sigma.
    let mut sums = vec![[0.0; 3]; sizes.len()];
    for k in 0..CYCLES {
        let omega = core::f64::consts::TAU / 3.0;
        let (sin, cos) = (omega * 1e-3 * f64::from(k)).sin_cos();
        reference.sequence += 1;
        for ((joint, start), size) in reference.joints.iter_mut().zip(start).zip(&sizes) {
            joint.q_d = start + 0.5 * size * (1.0 - cos);
            joint.dq_d = 0.5 * size * omega * sin;
            joint.ddq_d = 0.5 * size * omega * omega * cos;
        }
        bench.gather();
        let truth: Vec<f64> = (bench.plant.robot().truth().joints.iter())
            .map(|joint| joint.tau)
            .collect();
        let record = bench.compute(&client_input(&reference));
        for ((sums, joint), truth) in sums.iter_mut().zip(&record.estimated.joints).zip(truth) {
            let (hat, encoder) = (&joint.tau_hat, &joint.tau_encoder);
            if k >= FROM {
                sums[0] += (hat.tau - truth).powi(2);
                sums[1] += (encoder.tau - truth).powi(2);
                sums[2] += ((hat.tau - truth) / hat.sigma).powi(2);
            }
        }
    }
    let ratios: Vec<f64> = sums.iter().map(|s| (s[0] / s[1]).sqrt()).collect();
    let mean = (ratios.iter().map(|x| x.ln()).sum::<f64>() / ratios.len() as f64).exp();
    let worst = ratios.iter().copied().fold(0.0, f64::max);
    let normed = sums
        .iter()
        .map(|s| (s[2] / f64::from(CYCLES - FROM)).sqrt());
    let normed: Vec<f64> = normed.collect();
    let right = normed.iter().filter(|x| (0.4..2.0).contains(*x)).count();
    assert!(mean < 0.92 && worst < 1.3, "{mean}, {worst}: {ratios:?}");
    assert!(10 * right >= 9 * normed.len(), "{normed:?}");
}
