//! A joint that slides, estimated as one that turns: the same forces as by the same equations in metres.

use estimators::compliance::{ComplianceEstimator, ComplianceParameters, JointEstimatorParameters};
use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::radius::AtRadius;
use estimators::wave_generator::{FrictionRule, WaveGeneratorParameters};
use test_support::{Random, allocations};

/// A screw of 5 mm in m and N.
fn sliding() -> JointEstimatorParameters {
    JointEstimatorParameters {
        gear_ratio: std::f64::consts::TAU / 5e-3,
        torque_limit: 600.0,
        sample_period: 1e-3,
        low_pass_pole: 0.9,
        link_resolution: 1e-6,
        motor_resolution: std::f64::consts::TAU / 4096.0,
        torsion_sigma: 1e-6,
        current_sigma: 0.02,
        compliance: ComplianceParameters {
            k_fs0: 1.5e6,
            c_fs: 5.5e-3,
            k_wg0: 1.5,
            c_wg: 65.0,
        },
        wave_generator: WaveGeneratorParameters {
            torque_constant: 0.06,
            friction: 0.02,
            viscous_friction: 1e-5,
            epsilon: 0.5,
            rule: FrictionRule::Physical,
        },
        kinematic_error: KinematicErrorParameters {
            a0: 1e-6,
            w_link: 105.0,
            link: vec![(3e-6, -2e-6)],
            w_motor: 1.0,
            motor: vec![(-1.5e-6, 1e-6)],
        },
    }
}

#[test]
fn forces_are_those_of_the_same_equations_in_metres() {
    for radius in [0.1, 0.02, 3.0] {
        let metres = sliding();
        let mut turning = metres.clone();
        turning.gear_ratio *= radius;
        turning.torque_limit *= radius;
        turning.link_resolution /= radius;
        turning.torsion_sigma /= radius;
        turning.compliance.k_fs0 *= radius * radius;
        turning.compliance.c_fs /= radius;
        turning.kinematic_error = metres.kinematic_error.at_radius(1.0 / radius);
        let mut one = ComplianceEstimator::new(metres);
        let mut other = AtRadius::new(Box::new(ComplianceEstimator::new(turning)), radius);
        let mut random = Random::new(7);
        let mut largest = 0.0f64;
        let before = allocations();
        for k in 0..2000 {
            let t = 1e-3 * f64::from(k);
            let (q, dq) = (0.2 * t.sin(), 0.2 * t.cos());
            let force = 200.0 * (3.0 * t).sin() + random.symmetric();
            let ratio = std::f64::consts::TAU / 5e-3;
            let sample = JointSample {
                q,
                dq,
                theta: ratio * (q + force / 1.5e6),
                omega: ratio * dq,
                current: force / ratio / 0.06,
                ..JointSample::default()
            };
            let [a, b] = [one.update(&sample), other.update(&sample)];
            assert_eq!(
                (a.flags, a.source, a.delay_s),
                (b.flags, b.source, b.delay_s)
            );
            assert!(
                (a.tau - b.tau).abs() < 1e-6,
                "{radius}: {} {}",
                a.tau,
                b.tau
            );
            assert!((a.sigma - b.sigma).abs() < 1e-6, "{} {}", a.sigma, b.sigma);
            largest = largest.max(a.tau.abs());
        }
        assert_eq!(allocations() - before, 0);
        assert!(largest > 100.0);
    }
}
