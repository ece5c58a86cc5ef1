//! The torque from current: its sigma under parameters of a data sheet.

use estimators::current_based::{CurrentEstimator, CurrentParameters, NO_PRESLIDING};
use estimators::joint::{JointSample, JointTorqueEstimator};

const SHEET: CurrentParameters = CurrentParameters {
    k_1: 6.0,
    k_2: 4.0,
    k_3: 2.5,
    k_4: 0.0,
    inertia: 0.2,
    offset: 0.0,
    sign_smoothing: 0.02,
    presliding: NO_PRESLIDING,
    gear_ratio: 100.0,
    low_pass_pole: 0.0,
    sigma: 0.0,
    sample_period: 1e-3,
    torque_limit: 500.0,
};

/// Torque and sigma at 3 A in a motion that accelerates, N·m.
fn accelerating(parameters: CurrentParameters) -> (f64, f64) {
    let mut estimator = CurrentEstimator::of_data_sheet(parameters);
    let mut last = None;
    for step in 0..500 {
        let dq = 0.2 + 4e-3 * f64::from(step);
        let sample = JointSample {
            dq,
            omega: 100.0 * dq,
            current: 3.0,
            ..JointSample::default()
        };
        last = Some(estimator.update(&sample));
    }
    let estimate = last.unwrap();
    (estimate.tau, estimate.sigma)
}

#[test]
fn a_data_sheets_sigma_is_what_its_usual_errors_make_of_the_torque() {
    let (tau, sigma) = accelerating(SHEET);
    let change = |parameters: CurrentParameters| accelerating(parameters).0 - tau;
    let changes = [
        change(CurrentParameters {
            k_1: 1.05 * SHEET.k_1,
            ..SHEET
        }),
        change(CurrentParameters {
            k_2: 1.3 * SHEET.k_2,
            ..SHEET
        }),
        change(CurrentParameters {
            k_3: 1.3 * SHEET.k_3,
            ..SHEET
        }),
        change(CurrentParameters {
            inertia: 1.1 * SHEET.inertia,
            ..SHEET
        }),
        // To first order in K4, as its variance is.
        (change(CurrentParameters { k_4: 5e-4, ..SHEET })) * 100.0,
    ];
    let expected = changes.iter().map(|c| c * c).sum::<f64>().sqrt();
    assert!(changes.iter().all(|c| c.abs() > 0.01), "{changes:?}");
    assert!((sigma / expected - 1.0).abs() < 1e-2, "{sigma} {expected}");
}
