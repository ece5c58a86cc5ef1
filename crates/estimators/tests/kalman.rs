//! Kalman filters on motion made by their own model, where their promises can be checked.

use estimators::compliance::ComplianceParameters;
use estimators::compliance::JointEstimatorParameters;
use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::kalman::{ADDED_STATES, KalmanEstimator, KalmanParameters, STATES, Transform};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::tracking::TrackingParameters;
use estimators::wave_generator::{FrictionRule, WaveGeneratorParameters};
use test_support::Random;

const N: f64 = 100.0;
const T: f64 = 1e-3;

fn parameters() -> KalmanParameters {
    KalmanParameters {
        joint: JointEstimatorParameters {
            gear_ratio: N,
            torque_limit: 30.0,
            sample_period: T,
            low_pass_pole: 0.0,
            link_resolution: 1.2e-5,
            motor_resolution: 1.5e-3,
            torsion_sigma: 0.0,
            current_sigma: 0.0,
            compliance: ComplianceParameters {
                k_fs0: 8333.0,
                c_fs: 0.089,
                k_wg0: 1.33,
                c_wg: 83.5,
            },
            wave_generator: WaveGeneratorParameters {
                torque_constant: 0.06,
                friction: 0.02,
                viscous_friction: 1e-5,
                epsilon: 0.5,
                rule: FrictionRule::Physical,
            },
            kinematic_error: KinematicErrorParameters::default(),
        },
        gear: None,
        tracking: TrackingParameters::default(),
        meshing: 0.0,
        rotor_inertia: 1.14e-5,
        sign_smoothing: 1.0,
        process: [1e-12, 1e-4, 0.02f64.powi(2), 1.0, 1e-12],
        measurement: [1e-6, 4e-10],
    }
}

/// RMS error, mean sigma, mean normalised innovation.
struct Outcome {
    rms: f64,
    sigma: f64,
    innovation: f64,
    consistent: bool,
}

/// Runs a filter over motion of the very model it has, but for an offset of the current.
fn run<const S: usize>(transform: Transform, offset: f64) -> Outcome {
    let p = parameters();
    let mut filter = KalmanEstimator::<S>::new(p.clone(), transform);
    let mut random = Random::new(5);
    let (mut theta, mut omega, mut tau) = (3.0, 0.0, 2.0);
    let (mut square, mut sigma, mut innovation) = (0.0, 0.0, 0.0);
    let count = 20_000;
    for i in 0..count + 2000 {
        // A motor that follows the load and swings about it.
        let t = T * f64::from(i);
        let tau_m = tau / N + 0.02 * (4.0 * t).sin() - 2e-4 * omega;
        let friction = 1e-5 * omega + 0.02 * omega.tanh();
        theta += T * omega;
        omega += T / 1.14e-5 * (tau_m - friction - tau / N) + 1e-2 * random.normal();
        tau += -T * tau + 0.02 * random.normal();
        let c = &p.joint.compliance;
        let torsion = c.flexspline_torsion(tau) + c.wave_generator_torsion(tau / N) / N;
        let theta_read = theta + 1e-3 * random.normal();
        let torsion_read = torsion + 2e-5 * random.normal();
        let sample = JointSample {
            theta: theta_read,
            q: theta_read / N - torsion_read,
            omega,
            dq: omega / N,
            current: tau_m / 0.06 + offset,
            feed_forward: None,
            flags: 0,
        };
        let estimate = filter.update(&sample);
        if i >= 2000 {
            square += (estimate.tau - tau).powi(2);
            sigma += estimate.sigma;
            innovation += filter.normalized_innovation();
        }
    }
    let count = f64::from(count);
    Outcome {
        rms: (square / count).sqrt(),
        sigma: sigma / count,
        innovation: innovation / count,
        consistent: filter.consistent(),
    }
}

#[test]
fn sigma_of_the_unscented_filter_covers_its_error() {
    for o in [
        run::<STATES>(Transform::Unscented, 0.0),
        run::<ADDED_STATES>(Transform::Unscented, 0.0),
    ] {
        assert!(o.consistent);
        assert!(
            (0.8..1.25).contains(&(o.rms / o.sigma)),
            "rms {} sigma {}",
            o.rms,
            o.sigma
        );
        assert!(
            (1.6..2.4).contains(&o.innovation),
            "two measurements: {}",
            o.innovation
        );
        // Alone, the torsion's noise is worth 0.17 N·m and more.
        assert!(o.rms < 0.12, "{}", o.rms);
    }
}

#[test]
fn added_states_compensate_a_current_offset() {
    // 0.1 A is 0.6 N·m at the link.
    let plain = run::<STATES>(Transform::Unscented, 0.1);
    let added = run::<ADDED_STATES>(Transform::Unscented, 0.1);
    assert!(added.consistent && added.rms < 0.12, "{}", added.rms);
    assert!(
        !plain.consistent && plain.rms > 1.05 * added.rms,
        "{} {}",
        plain.rms,
        added.rms
    );
}

#[test]
fn constant_stiffness_costs_the_linear_filter_its_accuracy() {
    let linear = run::<STATES>(Transform::Linear, 0.0).rms;
    let unscented = run::<STATES>(Transform::Unscented, 0.0).rms;
    assert!(linear > 2.0 * unscented, "{linear} {unscented}");
}
