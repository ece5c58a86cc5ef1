//! The suite that every `JointTorqueEstimator` passes.

mod subjects;
mod suite;

use estimators::compliance::ComplianceEstimator;
use estimators::deformation::AngularFrequency;
use estimators::encoder::{EncoderParameters, JointEncoders};
use estimators::filter_bank::FilterBank;
use estimators::fusion::{Fusion, FusionParameters, SourceError};
use estimators::joint::JointTorqueEstimator;
use estimators::kalman::{ADDED_STATES, STATES, Transform};
use estimators::savitzky_golay::SavitzkyGolayParameters;
use estimators::set::EstimatorSet;
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

#[test]
fn fused_sources() {
    let new = || {
        let sources: Vec<(String, Box<dyn JointTorqueEstimator + Send>)> = vec![
            ("compliance".into(), Box::new(compliance())),
            ("current".into(), Box::new(current_based())),
            (
                "kalman".into(),
                Box::new(kalman::<STATES>(Transform::Unscented, None)),
            ),
        ];
        let error = |variance: f64| SourceError {
            variance,
            reported: 0.5,
        };
        let regime = |r: usize| {
            vec![
                error(0.2),
                error(if r.is_multiple_of(2) { 4.0 } else { 0.3 }),
                error(0.2),
            ]
        };
        let fusion = Fusion::new(
            3,
            FusionParameters {
                moving: 0.01,
                loading: [1e-3, 3e-3, 1e-2],
                errors: std::array::from_fn(regime),
                blend: 0.02,
                gear_ratio: 100.0,
                sample_period: 1e-3,
                torque_limit: LIMIT,
                independent: None,
                reference: None,
                left_out: Vec::new(),
                rest_factor: 1.0,
            },
        );
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

#[test]
fn nothing_around_the_estimators_allocates_either() {
    let parameters = SavitzkyGolayParameters::centred(80, 2, 2, 1e-3);
    let mut bank = FilterBank::new(30, parameters).unwrap();
    let mut encoders = JointEncoders::new(EncoderParameters {
        gear_ratio: 100.0,
        sample_period: 1e-3,
        max_velocity: 6.0,
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
