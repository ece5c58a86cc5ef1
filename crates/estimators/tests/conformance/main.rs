//! The suite that every `JointTorqueEstimator` passes.

mod subjects;
mod suite;

use estimators::compliance::ComplianceEstimator;
use estimators::current_based::UNCERTAIN;
use estimators::deformation::AngularFrequency;
use estimators::encoder::{EncoderParameters, JointEncoders};
use estimators::feed_forward::{CorrectionParameters, UNCERTAIN as OF_FEED_FORWARD};
use estimators::filter_bank::FilterBank;
use estimators::fusion::{FusedSource, Fusion, FusionParameters, REGIMES, SourceError};
use estimators::joint::{AnyEstimator, JointSample, JointTorqueEstimator};
use estimators::kalman::{ADDED_STATES, STATES, Transform};
use estimators::role::Role;
use estimators::savitzky_golay::SavitzkyGolayParameters;
use estimators::set::{EstimatorSet, Source, ZeroParameters};
use estimators::validity::Validity;
use estimators::wave_generator::FrictionRule;
use subjects::*;
use suite::*;
use test_support::allocations;

#[test]
fn compliance_physical() {
    conforms(&|| Box::new(compliance()), LOADED);
}

#[test]
fn compliance_published() {
    let p = test_joint(FrictionRule::Published, 0.95);
    conforms(&|| Box::new(ComplianceEstimator::new(p.clone())), LOADED);
}

#[test]
fn compliance_without_low_pass() {
    let p = test_joint(FrictionRule::Physical, 0.0);
    let expected = Expected {
        jump: 4.0,
        ..LOADED
    };
    conforms(&|| Box::new(ComplianceEstimator::new(p.clone())), expected);
}

#[test]
fn compliance_with_hysteresis() {
    conforms(&|| Box::new(hysteresis()), LOADED);
}

#[test]
fn current_based_torque() {
    conforms(&|| Box::new(current_based()), LOADED);
    conforms(&|| Box::new(current_with_presliding()), LOADED);
}

#[test]
fn feed_forward_torque() {
    conforms(&|| Box::new(feed_forward()), LOADED);
}

#[test]
fn deformation_model() {
    conforms(&|| Box::new(deformation(AngularFrequency::Spatial)), LOADED);
    let published = || deformation(AngularFrequency::Published);
    conforms(&|| Box::new(published()), LOADED);
}

#[test]
fn network_model() {
    conforms(
        &|| Box::new(network()),
        Expected {
            jump: 0.1,
            reaches_limit: false,
        },
    );
}

#[test]
fn local_gaussian_processes() {
    conforms(&|| Box::new(local_gp()), LOADED);
}

#[test]
fn kalman_filters() {
    // Their tau is a compromise with the motor's equation.
    let expected = || Expected {
        reaches_limit: false,
        ..LOADED
    };
    conforms(
        &|| Box::new(kalman::<STATES>(Transform::Linear, None)),
        expected(),
    );
    conforms(
        &|| Box::new(kalman::<STATES>(Transform::Unscented, None)),
        expected(),
    );
    conforms(
        &|| Box::new(kalman::<ADDED_STATES>(Transform::Unscented, Some(gear()))),
        expected(),
    );
}

fn source(name: &str, role: Role, estimator: AnyEstimator) -> Source {
    Source {
        name: name.into(),
        role,
        estimator,
    }
}

fn fused(role: Role, errors: [SourceError; REGIMES]) -> FusedSource {
    FusedSource {
        role,
        errors,
        fused: true,
    }
}

#[test]
fn fused_sources() {
    let new = || {
        let kalman = Box::new(kalman::<STATES>(Transform::Unscented, None));
        let sources = vec![
            source("compliance", Role::Torsion, Box::new(compliance())),
            source("current", Role::Torsion, Box::new(current_based())),
            source("kalman", Role::Torsion, kalman),
        ];
        let error = |variance: f64| SourceError {
            variance,
            reported: 0.5,
        };
        let of_current = |r: usize| error(if r.is_multiple_of(2) { 4.0 } else { 0.3 });
        let errors = [
            [error(0.2); REGIMES],
            std::array::from_fn(of_current),
            [error(0.2); REGIMES],
        ];
        let fusion = Fusion::new(FusionParameters {
            moving: 0.01,
            loading: [1e-3, 3e-3, 1e-2],
            sources: errors.map(|errors| fused(Role::Torsion, errors)).to_vec(),
            blend: 0.02,
            gear_ratio: 100.0,
            sample_period: 1e-3,
            torque_limit: LIMIT,
            rated_torque: LIMIT / 2.5,
            rest_factor: 1.0,
            zero_unknown: false,
            correction: None,
        });
        EstimatorSet::new(sources, Some(fusion))
    };
    // One of them never quite reaches the limit.
    conforms(
        &|| Box::new(new()),
        Expected {
            reaches_limit: false,
            ..LOADED
        },
    );
}

/// A set as a joint file makes it: covariances, ranges of validity, an unknown zero.
#[test]
fn covariances_ranges_and_tares_neither_allocate_nor_break() {
    // A hundredth of the first parameter, next to nothing of the others.
    let directions = |n: usize, first: f64| vec![[vec![first], vec![1e-6; n - 1]].concat(); 3];
    let validity = Validity {
        torque: [-5.0, 5.0],
        angle: [-0.5, 0.5],
        speed: 0.5,
        loading: 10.0,
        speed_error: 0.2,
    };
    let error = SourceError {
        variance: 0.2,
        reported: 0.3,
    };
    let correction = CorrectionParameters {
        change_sigma: [0.3, 0.6],
        loading: 2.0,
        sample_period: 1e-3,
    };
    let roles = [Role::Gear, Role::Current, Role::Model];
    let fusion = Fusion::new(FusionParameters {
        moving: 0.01,
        loading: [1e-3, 3e-3, 1e-2],
        sources: roles.map(|role| fused(role, [error; REGIMES])).to_vec(),
        blend: 0.02,
        gear_ratio: 100.0,
        sample_period: 1e-3,
        torque_limit: LIMIT,
        rated_torque: LIMIT / 2.5,
        rest_factor: 4.0,
        zero_unknown: false,
        correction: Some(correction),
    });
    let gear = hysteresis().with_uncertainty(&directions(gear().uncertain(), 80.0), validity);
    let current =
        current_with_presliding().with_uncertainty(&directions(UNCERTAIN, 0.06), validity);
    let model = feed_forward().with_uncertainty(&directions(OF_FEED_FORWARD, 0.06), validity);
    let sources = vec![
        source("hysteresis", Role::Gear, Box::new(gear)),
        source("current", Role::Current, Box::new(current)),
        source("feed_forward", Role::Model, Box::new(model)),
    ];
    let mut set = EstimatorSet::new(sources, Some(fusion)).with_zero(ZeroParameters {
        unknown: true,
        gear_ratio: 100.0,
        stiffness: 8000.0,
    });
    let before = allocations();
    let mut disagreed = false;
    for i in 0..8000 {
        let sample = match i {
            1000..1100 => JointSample {
                theta: f64::NAN,
                ..motion(i)
            },
            // The encoder slips.
            4000.. => JointSample {
                theta: motion(i).theta + 0.5,
                ..motion(i)
            },
            _ => motion(i),
        };
        let fused = set.update(&sample);
        assert!(fused.tau.is_finite() && fused.sigma.is_finite() && fused.sigma > 0.0);
        if (2000..2050).contains(&i) {
            set.tare_to(12.0 * (2e-3 * i as f64).sin(), 0.1);
        }
        disagreed |= set.disagrees();
        assert!(i >= 4000 || !disagreed, "{i}");
    }
    assert!(disagreed, "a slip of 40 N·m is a disagreement");
    set.reset();
    assert!(!set.disagrees());
    assert_eq!(allocations(), before);
}

#[test]
fn nothing_around_the_estimators_allocates_either() {
    let parameters = SavitzkyGolayParameters::centred(80, 2, 2, 1e-3);
    let mut bank = FilterBank::new(30, parameters).unwrap();
    let mut encoders = JointEncoders::new(EncoderParameters {
        gear_ratio: 100.0,
        sample_period: 1e-3,
        max_velocity: 6.0,
        max_velocity_change: 0.0,
        motor_wrap: std::f64::consts::TAU,
        link_wrap: f64::INFINITY,
        skew: 1e-3,
    });
    let before = allocations();
    for i in 0..200 {
        let missed = if i % 9 == 0 { f64::NAN } else { 0.1 };
        encoders.update(missed, missed);
        bank.update(&[missed; 30]);
    }
    bank.reset();
    encoders.reset();
    assert_eq!(allocations(), before);
}
