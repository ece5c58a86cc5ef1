//! Springs that slip, and what is not known of their past; torques that no data covered.

use estimators::hysteresis::{
    Gear, GearParameters, Hysteresis, HysteresisEstimator, HysteresisParameters, SlipElement,
};
use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::tracking::TrackingParameters;
use estimators::validity::Validity;
use test_support::Random;

const SPRINGS: [SlipElement; 2] = [
    SlipElement {
        limit: 1e-4,
        stiffness: 3e3,
    },
    SlipElement {
        limit: 3e-4,
        stiffness: 1e3,
    },
];

#[test]
fn a_past_that_was_not_seen_lies_between_the_bounds_and_fades() {
    let mut random = Random::new(7);
    for _ in 0..200 {
        let (mut whole, mut seen) = (Hysteresis::new(&SPRINGS), Hysteresis::new(&SPRINGS));
        let mut x = 0.0;
        for _ in 0..20 {
            x += 2e-4 * random.normal();
            whole.update(x);
        }
        let first = seen.unknown();
        let mut last = f64::INFINITY;
        for k in 0..60 {
            whole.update(x);
            seen.update(x);
            for (stretch, [middle, half]) in whole.stretches().zip(seen.intervals()) {
                assert!((stretch - middle).abs() <= half + 1e-15);
            }
            // Anywhere between the bounds: off by at most twice the standard deviation.
            let error = (whole.torque() - seen.torque()).abs();
            assert!(error <= 2.0 * seen.unknown() + 1e-12, "{error}");
            let half: f64 = seen.intervals().map(|[_, half]| half).sum();
            assert!(half <= last + 1e-15);
            last = half;
            x += 4e-5 * (0.05 * f64::from(k) * f64::from(k)).sin();
        }
        assert!(first > 0.0);
        // Through twice the largest limit one way: nothing of the past is left.
        for step in [-7e-4, 1e-4] {
            x += step;
            whole.update(x);
            seen.update(x);
        }
        assert!(seen.unknown() < 1e-12);
        assert!((whole.torque() - seen.torque()).abs() < 1e-12);
    }
}

/// A gear at rest, then in small motion, beside another one with a past and a torque that shows it, wrong by an error
/// that lasts and by noise.
#[test]
fn a_torque_from_elsewhere_shows_the_past_and_what_stays_unknown_holds_the_error() {
    let parameters = GearParameters {
        linear: 5e3,
        slipping: SPRINGS.to_vec(),
        bearing: vec![SlipElement {
            limit: 1e-3,
            stiffness: 50.0,
        }],
        ..GearParameters::default()
    };
    let mut random = Random::new(3);
    let (sigma, mut squares, mut ratios) = (0.03, [0.0; 2], 0.0);
    for _ in 0..100 {
        let (mut whole, mut seen) = (
            Gear::new(parameters.clone(), 1e-3),
            Gear::new(parameters.clone(), 1e-3),
        );
        let (mut x, mut q) = (0.0, 0.0);
        for _ in 0..20 {
            (x, q) = (x + 3e-4 * random.normal(), q + 1e-3 * random.normal());
            whole.update(x);
            whole.bearing(q, 0.0);
        }
        let lasts = sigma * random.normal();
        let mut unknown = f64::INFINITY;
        for k in 0..4000 {
            let swing = 5e-5 * (3e-3 * f64::from(k)).sin();
            let torque = |gear: &mut Gear| gear.update(x + swing) - gear.bearing(q + swing, 0.0);
            let error = torque(&mut whole) - torque(&mut seen);
            if k == 0 {
                squares[0] += error * error;
            }
            let shown = seen.learn(error + lasts + 0.1 * random.normal(), sigma, 1e-3);
            assert!(shown.is_finite());
            let [gear, bearing] = seen.unknown();
            assert!(gear.hypot(bearing) <= unknown + 1e-12);
            unknown = gear.hypot(bearing);
            if k == 3999 {
                squares[1] += error * error;
                ratios += error * error / (unknown * unknown + sigma * sigma);
            }
        }
        // A torque that is no past is not taken for one.
        let before = seen.unknown();
        assert_eq!(seen.learn(50.0, sigma, 1e-3), 0.0);
        assert_eq!(seen.learn(f64::NAN, sigma, 1e-3), 0.0);
        assert_eq!(seen.unknown(), before);
    }
    let [first, last] = squares.map(|sum| f64::sqrt(sum / 100.0));
    assert!(last < 0.25 * first && first > 0.1, "{first} {last}");
    let ratio = f64::sqrt(ratios / 100.0);
    assert!((0.5..1.2).contains(&ratio), "{ratio}");
}

#[test]
fn a_tare_at_a_torque_that_was_not_covered_knows_the_error_there_but_not_within() {
    let gear = GearParameters {
        linear: 1e4,
        ..GearParameters::default()
    };
    let count = gear.uncertain();
    let parameters = HysteresisParameters {
        gear,
        kinematic_error: KinematicErrorParameters::default(),
        gear_ratio: 100.0,
        tracking: TrackingParameters::default(),
        torsion_sigma: 0.0,
        sample_period: 1e-3,
        torque_limit: 100.0,
    };
    let covered = Validity {
        torque: [-1.0, 10.0],
        ..Validity::default()
    };
    // A covariance without size: the range alone counts.
    let new = || {
        HysteresisEstimator::new(parameters.clone()).with_uncertainty(&[vec![0.0; count]], covered)
    };
    let at = |estimator: &mut HysteresisEstimator, tau: f64| {
        let sample = JointSample {
            theta: 100.0 * tau / 1e4,
            ..JointSample::default()
        };
        (0..200).fold(0.0, |_, _| estimator.update(&sample).sigma)
    };
    let mut estimator = new();
    assert!(at(&mut estimator, 5.0) < 1e-9);
    let outside = at(&mut estimator, 30.0);
    assert!(outside > 1.0, "{outside}");
    estimator.tare(0.1);
    assert!((at(&mut estimator, 30.0) - 0.1).abs() < 1e-9);
    let further = at(&mut estimator, 40.0);
    assert!(
        (further - (0.5 * outside).hypot(0.1)).abs() < 1e-6,
        "{further}"
    );
    // Below the range is another slope, and within it what the tare moved is off.
    assert!((at(&mut estimator, 5.0) - outside.hypot(0.1)).abs() < 1e-6);
}
