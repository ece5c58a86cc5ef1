//! The motor's constants from loaded motion beside a torque sensor (D3, D7).

use crate::least_squares::Batch;
use crate::record::Record;
use estimators::current_based::CurrentParameters;
use estimators::low_pass::LowPass;
use problem::Problem;

/// Time constant of the low-pass on current, s.
const TIME_CONSTANT_S: f64 = 0.005;
/// Samples used at most.
const MAX_SAMPLES: usize = 60_000;

/// Velocities over which the sign of friction may be smoothed, and below which its direction is
/// unknown, over the largest velocity.
const SMOOTHING: [f64; 4] = [0.002, 0.005, 0.01, 0.02];
const MIN_RELATIVE_SPEED: f64 = 0.005;

/// Fits `tau = K1 (i - offset) - K2 dq - (K3 + K4 |tau|) sign(dq) - J ddq` to samples in motion.
///
/// # Errors
/// A log without torque sensor or without motion.
pub fn fit(record: &Record, torque_limit: f64) -> Result<CurrentParameters, Problem> {
    let tau = record.smooth(&record.tau, 0);
    let current = record.smooth(&record.current(), 0);
    let fastest = record.motion.iter().fold(0.0f64, |m, v| m.max(v[0].abs()));
    let rows: Vec<usize> = record
        .spread(MAX_SAMPLES)
        .filter(|&i| record.motion[i][0].abs() > MIN_RELATIVE_SPEED * fastest && tau[i].is_finite())
        .collect();
    let attempt = |smoothing: f64| {
        let mut batch = Batch::new(6);
        for &i in &rows {
            let [dq, ddq] = record.motion[i];
            let direction = (dq / smoothing).tanh();
            let meshing = -direction * tau[i].abs();
            batch.add(&[current[i], 1.0, -dq, -direction, -ddq, meshing], tau[i]);
        }
        let solution = batch.solve_bounded(1e-10, |i| i == 0 || i >= 2)?;
        Some((solution, smoothing))
    };
    let best = SMOOTHING
        .iter()
        .filter_map(|part| attempt((part * fastest).max(1e-6)))
        .min_by(|a, b| a.0.rms.total_cmp(&b.0.rms))
        .filter(|(solution, _)| solution.x[0] > 0.0);
    let Some((solution, smoothing)) = best else {
        return Err(Problem::new(
            "training log: torque does not grow with the current",
            "`tau_sensor` and motion under load",
        ));
    };
    let x = &solution.x;
    let pole = (-record.sample_period / TIME_CONSTANT_S).exp();
    debug_assert!(LowPass::new(pole).delay_samples().is_finite());
    Ok(CurrentParameters {
        k_1: x[0],
        k_2: x[2],
        k_3: x[3],
        inertia: x[4],
        // Half would lock the gear against being driven back.
        k_4: x[5].min(0.5),
        offset: -x[1] / x[0],
        sign_smoothing: smoothing,
        low_pass_pole: pole,
        sigma: solution.rms,
        sample_period: record.sample_period,
        torque_limit,
    })
}
