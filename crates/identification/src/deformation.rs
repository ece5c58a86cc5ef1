//! S's coefficients by least squares (S 15-17), all segments at once.

use crate::least_squares::Batch;
use crate::record::Record;
use estimators::deformation::{
    AngularFrequency, COEFFICIENTS, DeformationParameters, SEGMENTS, regressor,
};
use estimators::joint::JointSample;
use problem::Problem;

/// Samples used at most.
const MAX_SAMPLES: usize = 60_000;

/// Fits S10 to loaded motion.
///
/// # Errors
/// A log whose torques do not determine the segments.
pub fn fit(
    record: &Record,
    rated_torque: f64,
    torque_limit: f64,
    frequency: AngularFrequency,
    low_pass_pole: f64,
) -> Result<DeformationParameters, Problem> {
    let tau = record.smooth(&record.tau, 0);
    let current = record.smooth(&record.current(), 0);
    let mut batch = Batch::new(COEFFICIENTS);
    let mut current_limit = 0.0f64;
    for i in record.spread(MAX_SAMPLES) {
        let s = JointSample {
            current: current[i],
            ..record.samples[i]
        };
        current_limit = current_limit.max(s.current.abs());
        let row = regressor(&s, tau[i], rated_torque, record.gear_ratio, frequency);
        batch.add(&row, s.theta / record.gear_ratio - s.q);
    }
    let solution = batch
        .solve_bounded(1e-9, |i| i < SEGMENTS)
        .filter(|s| s.x[0] > 0.0);
    let Some(solution) = solution else {
        return Err(Problem::new(
            "training log: the middle segment's stiffness is not determined",
            "a reference torque and loads of both signs",
        ));
    };
    let mut coefficients: [f64; COEFFICIENTS] = std::array::from_fn(|i| solution.x[i]);
    // Segments that the load never reached go on with the stiffness of their inner neighbour.
    for (outer, inner) in [(1, 0), (2, 1), (3, 0), (4, 3)] {
        if coefficients[outer] <= 0.05 * coefficients[inner] {
            coefficients[outer] = coefficients[inner];
        }
    }
    Ok(DeformationParameters {
        rated_torque,
        coefficients,
        frequency,
        current_limit: current_limit.max(1e-9),
        gear_ratio: record.gear_ratio,
        low_pass_pole,
        torsion_sigma: solution.rms,
        sample_period: record.sample_period,
        torque_limit,
    })
}
