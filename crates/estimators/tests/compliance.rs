//! Z's model: its curves, its inverse, its cases, its low-pass.

use estimators::compliance::JointEstimatorParameters;
use estimators::compliance::{ComplianceEstimator, ComplianceParameters};
use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::low_pass::LowPass;
use estimators::wave_generator::{FrictionRule, WaveGenerator, WaveGeneratorParameters};
use proptest::prelude::*;

/// Z Table II.
const Z: ComplianceParameters = ComplianceParameters {
    k_fs0: 8333.0,
    c_fs: 0.089,
    k_wg0: 1.33,
    c_wg: 83.5,
};

const MOTOR: WaveGeneratorParameters = WaveGeneratorParameters {
    torque_constant: 0.06,
    friction: 0.02,
    viscous_friction: 1e-4,
    epsilon: 0.5,
    rule: FrictionRule::Physical,
};

/// Simpson's rule.
fn integral(f: impl Fn(f64) -> f64, to: f64) -> f64 {
    let h = to / 2000.0;
    let weight = |i: usize| {
        if i == 0 || i == 2000 {
            1.0
        } else {
            2.0 + 2.0 * (i % 2) as f64
        }
    };
    (0..=2000).map(|i| weight(i) * f(h * i as f64)).sum::<f64>() * h / 3.0
}

proptest! {
    /// Z11: the flexspline's torsion is the integral of 1/K_fl; Z14: the wave generator's that of
    /// 1/K_wg with Z13's stiffness.
    #[test]
    fn torsions_are_integrals_of_compliance(tau in -30.0..30.0f64, tau_wg in -0.3..0.3f64) {
        let flexspline = integral(|x| 1.0 / Z.stiffness(x), tau);
        prop_assert!((flexspline - Z.flexspline_torsion(tau)).abs() < 1e-12);
        let k_wg = |x: f64| Z.k_wg0 * (Z.c_wg * x.abs()).exp();
        let wave_generator = integral(|x| 1.0 / k_wg(x), tau_wg);
        prop_assert!((wave_generator - Z.wave_generator_torsion(tau_wg)).abs() < 1e-9);
    }

    /// Z20 is the inverse of Z12.
    #[test]
    fn torque_inverts_torsion(tau in -29.9..29.9f64, c_fs in prop_oneof![Just(0.0), 0.001..0.2f64]) {
        let p = ComplianceParameters { c_fs, ..Z };
        let inverse = p.torque(p.flexspline_torsion(tau), 30.0);
        prop_assert!((inverse.tau - tau).abs() < 1e-9 && !inverse.saturated);
    }

    #[test]
    fn beyond_the_limit_it_saturates(torsion in 0.0..1e3f64, limit in 1.0..1e3f64) {
        let out = Z.torque(-torsion, limit);
        prop_assert_eq!(out.saturated, torsion >= Z.flexspline_torsion(limit));
        prop_assert!(out.tau <= 0.0 && out.tau >= -limit);
    }

    /// The harmonics of Z18, term by term.
    #[test]
    fn kinematic_error_is_its_fourier_series(q in -9.0..9.0f64, theta in -900.0..900.0f64) {
        let p = KinematicErrorParameters {
            a0: 1e-5,
            w_link: 0.99,
            link: vec![(-1e-6, -7e-5), (3e-6, 1e-6), (2e-6, -4e-6)],
            w_motor: 1.01,
            motor: vec![(3e-5, -3e-5), (6e-5, 2e-5)],
        };
        let terms = |w: f64, x: f64, c: &[(f64, f64)]| -> f64 {
            let n = (1..).map(f64::from);
            c.iter().zip(n).map(|((a, b), n)| a * (n * w * x).cos() + b * (n * w * x).sin()).sum()
        };
        let expected = p.a0 + terms(p.w_link, q, &p.link) + terms(p.w_motor, theta, &p.motor);
        prop_assert!((p.error(q, theta) - expected).abs() < 1e-17);
        prop_assert!(p.error(q, theta).abs() <= p.bound());
    }
}

#[test]
fn table_1_in_radians_is_worth_0_6_newton_metres() {
    // Amplitude in degrees, as printed; models.md: about 7.5e-5 rad, 0.6 N·m through K_fs0.
    let b_l1 = -0.004309f64.to_radians();
    let p = KinematicErrorParameters {
        w_link: 1.0,
        link: vec![(0.0, b_l1)],
        ..Default::default()
    };
    assert!((p.bound() - 7.52e-5).abs() < 1e-7);
    assert!((Z.k_fs0 * p.bound() - 0.627).abs() < 1e-3);
}

#[test]
fn cases_after_z22() {
    // At 100 rad/s tau_fm is 0.02 + 0.01.
    let tau_fm = 0.03;
    let tau_over_n = 0.004;
    let tau_wg = |rule, omega: f64, tau_m: f64| {
        let mut wave_generator = WaveGenerator::new(WaveGeneratorParameters { rule, ..MOTOR });
        let out = wave_generator.update(tau_m / 0.06, omega, tau_over_n);
        (out.tau_wg, out.unknown)
    };
    use FrictionRule::{Physical, Published};
    let near = |(a, _): (f64, f64), b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    for rule in [Physical, Published] {
        // Driving, both ways.
        near(tau_wg(rule, 100.0, 0.1), 0.1 - tau_fm);
        near(tau_wg(rule, -100.0, -0.1), -0.1 + tau_fm);
        // In the band.
        near(tau_wg(rule, 100.0, 0.02), tau_over_n);
        near(tau_wg(rule, -100.0, -0.02), tau_over_n);
        assert_eq!(
            tau_wg(rule, 100.0, 0.02).1,
            tau_fm,
            "the whole band is possible"
        );
        // Below eps nothing is known but what was held.
        near(tau_wg(rule, 0.4, 0.1), 0.0);
    }
    // Braking: friction adds to the brake, unless one follows the print.
    near(tau_wg(Physical, 100.0, -0.1), -0.1 - tau_fm);
    near(tau_wg(Physical, -100.0, 0.1), 0.1 + tau_fm);
    near(tau_wg(Published, 100.0, -0.1), -0.1 + tau_fm);
    near(tau_wg(Published, -100.0, 0.1), 0.1 - tau_fm);
}

#[test]
fn torque_is_held_below_epsilon() {
    let mut wave_generator = WaveGenerator::new(MOTOR);
    let moving = wave_generator.update(2.0, 100.0, 0.0);
    let held = wave_generator.update(-5.0, 0.1, 0.3);
    assert_eq!(held.tau_wg, moving.tau_wg);
    assert_eq!((moving.unknown, held.unknown > 0.0), (0.0, true));
    wave_generator.reset();
    assert_eq!(wave_generator.update(-5.0, 0.1, 0.3).tau_wg, 0.0);
}

#[test]
fn low_pass_follows_z() {
    let mut low_pass = LowPass::new(0.95);
    let x = |i: usize| (0.1 * i as f64).sin() + 1.0;
    let mut y = x(0);
    assert_eq!(low_pass.update(x(0)), y, "no transient from zero");
    for i in 1..100 {
        y = 0.95 * y + 0.025 * x(i) + 0.025 * x(i - 1);
        assert!((low_pass.update(x(i)) - y).abs() < 1e-14);
    }
    // A ramp comes out late by the group delay.
    let mut low_pass = LowPass::new(0.95);
    let ramp = (0..1000)
        .map(|i| low_pass.update(f64::from(i)))
        .last()
        .unwrap();
    assert!((999.0 - ramp - low_pass.delay_samples()).abs() < 1e-9);
    assert_eq!(LowPass::new(0.0).delay_samples(), 0.0);
}

fn parameters() -> JointEstimatorParameters {
    JointEstimatorParameters {
        gear_ratio: 100.0,
        torque_limit: 30.0,
        sample_period: 1e-3,
        low_pass_pole: 0.95,
        link_resolution: 1.2e-5,
        motor_resolution: 1.5e-3,
        torsion_sigma: 0.0,
        current_sigma: 0.0,
        compliance: Z,
        wave_generator: WaveGeneratorParameters {
            friction: 0.0,
            viscous_friction: 0.0,
            ..MOTOR
        },
        kinematic_error: KinematicErrorParameters {
            a0: 2e-5,
            ..Default::default()
        },
    }
}

/// The forward model (Z8, Z12, Z15) built here gives torsions from which the torque is recovered.
#[test]
fn torque_of_the_forward_model_is_recovered() {
    let mut estimator = ComplianceEstimator::new(parameters());
    for i in 0..3000 {
        let tau = 15.0 * (2e-3 * f64::from(i)).sin();
        let q = 0.3 + 1e-3 * f64::from(i);
        let torsion_wg = Z.wave_generator_torsion(tau / 100.0);
        let theta = 100.0 * (q + Z.flexspline_torsion(tau) + torsion_wg / 100.0 + 2e-5);
        let current = tau / 100.0 / 0.06;
        let sample = JointSample {
            q,
            theta,
            omega: 100.0,
            current,
            ..JointSample::default()
        };
        let estimate = estimator.update(&sample);
        let late = 15.0 * (2e-3 * (f64::from(i) - estimate.delay_s * 1e3)).sin();
        if i > 200 {
            assert!(
                (estimate.tau - late).abs() < 0.03,
                "{} {late}",
                estimate.tau
            );
        }
    }
}

/// At rest the error of quantisation is uniform within a count of each encoder; sigma covers it.
#[test]
fn sigma_covers_quantisation() {
    let mut square = 0.0;
    let mut expected = 0.0;
    let count = 4000;
    for i in 0..count {
        // Angles spread over many counts by irrational steps.
        let q = 0.618_034 * 1e-3 * f64::from(i);
        let tau = 8.0;
        let theta = 100.0 * (q + Z.flexspline_torsion(tau) + 2e-5) + 1e-2 * f64::from(i);
        let q = q + 1e-4 * f64::from(i);
        let p = parameters();
        let read = |angle: f64, count: f64| (angle / count).round() * count;
        let sample = JointSample {
            q: read(q, p.link_resolution),
            theta: read(theta, p.motor_resolution),
            ..JointSample::default()
        };
        let estimate = ComplianceEstimator::new(p).update(&sample);
        square += (estimate.tau - tau).powi(2);
        expected += estimate.sigma.powi(2);
    }
    let ratio = (square / expected).sqrt();
    assert!((0.95..1.05).contains(&ratio), "{ratio}");
}

/// A joint begins to turn and to turn back under one torque, its torsion unchanged: friction passes through all of its
/// cases. The torque by torsion alone goes on, to the width of its table, and is right.
#[test]
fn torque_by_torsion_alone_does_not_step_with_the_cases_of_friction() {
    let wave_generator = WaveGeneratorParameters {
        friction: 0.05,
        ..MOTOR
    };
    let mut estimator = ComplianceEstimator::new(JointEstimatorParameters {
        wave_generator,
        ..parameters()
    });
    let tau = 4.0;
    let torsion = Z.flexspline_torsion(tau) + Z.wave_generator_torsion(tau / 100.0) / 100.0 + 2e-5;
    let mut published = Vec::new();
    // At rest, where the torque is held; turning, with a current within and beyond friction; back.
    for (omega, current) in [
        (0.0, 0.7),
        (1.0, 0.7),
        (20.0, 1.6),
        (-20.0, -0.2),
        (0.0, 0.0),
    ] {
        let sample = JointSample {
            q: 0.3,
            theta: 100.0 * (0.3 + torsion),
            omega,
            current,
            ..JointSample::default()
        };
        for _ in 0..50 {
            published.push(estimator.update(&sample).tau);
            let tau_now = estimator.undelayed().unwrap();
            assert!((tau_now - tau).abs() < 5e-3, "{omega} {current}: {tau_now}");
        }
    }
    let least = published.iter().copied().fold(f64::INFINITY, f64::min);
    let most = published.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    assert!(most - least > 0.5, "Z's cases step: {least} {most}");
}
