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

#[test]
fn a_tare_leaves_the_sigma_of_the_known_torque_and_it_grows_with_the_change() {
    let mut estimator = CurrentEstimator::of_data_sheet(SHEET);
    let mut sigma = |current: f64, tare: bool| {
        let sample = JointSample {
            dq: 0.5,
            omega: 50.0,
            current,
            ..JointSample::default()
        };
        // The rate of the load settles.
        let estimates = (0..200).map(|_| estimator.update(&sample).sigma);
        let sigma = estimates.last().unwrap();
        if tare {
            estimator.tare(0.1);
        }
        sigma
    };
    let before = sigma(3.0, true);
    let after = sigma(3.0, false);
    assert!(
        before > 0.8 && (after - 0.1).abs() < 1e-9,
        "{before} {after}"
    );
    // 1 A further the torque constant's 5 % and the meshing's 5 % count of 6 N·m alone.
    let further = sigma(4.0, false);
    assert!((0.3..0.6).contains(&further), "{further}");
    estimator.reset();
}
