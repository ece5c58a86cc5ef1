//! Time per estimate of every estimator of a joint's torque.
//!
//! `cargo bench -p estimators`

use estimators::compliance::JointEstimatorParameters;
use estimators::compliance::{ComplianceEstimator, ComplianceParameters};
use estimators::creep::CreepElement;
use estimators::current_based::{CurrentEstimator, CurrentParameters};
use estimators::deformation::{
    AngularFrequency, COEFFICIENTS, DeformationEstimator, DeformationParameters,
};
use estimators::features::{FeatureSet, MAX_FEATURES};
use estimators::hysteresis::{
    GearParameters, HysteresisEstimator, HysteresisParameters, SlipElement,
};
use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::kalman::{ADDED_STATES, KalmanEstimator, KalmanParameters, STATES, Transform};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::local_gp::{LocalGp, LocalGpEstimator, LocalGpParameters, LocalModel};
use estimators::network::{Layer, NetworkEstimator, NetworkParameters};
use estimators::regimes::{Regime, Regimes};
use estimators::tracking::TrackingParameters;
use estimators::wave_generator::{FrictionRule, WaveGeneratorParameters};
use std::error::Error;
use std::hint::black_box;
use std::io::Write;
use std::time::{Duration, Instant};
use test_support::Random;

/// Samples of the log that each estimator runs over, again and again.
const SAMPLES: usize = 4000;
/// Samples timed in one go: short, so that some times fall between two switches of tasks.
const AT_A_TIME: usize = 100;
const ROUNDS: usize = 50;
const LIMIT: f64 = 40.0;

/// Loaded motion to and fro over some turns of the motor, with rest, noise on everything.
fn motion() -> Vec<JointSample> {
    let mut random = Random::new(1);
    let mut noise = move || random.symmetric();
    (0..SAMPLES)
        .map(|i| {
            let t = 1e-3 * i as f64;
            let (s, c) = (2.1 * t).sin_cos();
            let (q, dq) = (1.1 * s * s * s, 6.93 * s * s * c);
            let tau = 11.0 * q.sin() + 3.0 * (5.0 * t).sin();
            let torsion = tau / 7000.0 + 7e-5 * q.sin() + 4e-5 * (200.0 * q).cos();
            JointSample {
                q,
                theta: 100.0 * (q + torsion + 5e-6 * noise()),
                dq: dq + 0.01 * noise(),
                omega: 100.0 * dq + noise(),
                current: tau / 5.0 + 0.4 * dq.clamp(-1.0, 1.0) + 0.05 * noise(),
                feed_forward: None,
                flags: 0,
            }
        })
        .collect()
}

fn joint() -> JointEstimatorParameters {
    JointEstimatorParameters {
        gear_ratio: 100.0,
        torque_limit: LIMIT,
        sample_period: 1e-3,
        low_pass_pole: 0.95,
        link_resolution: 1.2e-5,
        motor_resolution: 1.5e-3,
        torsion_sigma: 5e-5,
        current_sigma: 0.02,
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
        // Z Table I has one harmonic of q and two of theta.
        kinematic_error: KinematicErrorParameters {
            a0: 0.0,
            w_link: 1.0,
            link: vec![(2.6e-6, 7.5e-5)],
            w_motor: 1.0,
            motor: vec![(-2.8e-5, 3.3e-5), (-5.7e-5, -1.6e-5)],
        },
    }
}

fn gear() -> GearParameters {
    let slip = |limit, stiffness| SlipElement { limit, stiffness };
    GearParameters {
        linear: 8000.0,
        cubic: 1e8,
        wind_up: vec![(1e-4, -2000.0), (3e-4, -500.0)],
        slipping: [2e-5, 4e-5, 8e-5, 2e-4, 4e-4, 8e-4]
            .map(|limit| slip(limit, 1000.0))
            .to_vec(),
        creeping: [0.3, 1.0, 4.0]
            .map(|time| CreepElement {
                time,
                stiffness: 80.0,
            })
            .to_vec(),
        damping: 1.0,
        bearing: vec![slip(1e-4, 800.0)],
        bearing_viscous: 0.05,
    }
}

fn kalman<const N: usize>(
    transform: Transform,
    gear: Option<GearParameters>,
) -> KalmanEstimator<N> {
    let parameters = KalmanParameters {
        joint: joint(),
        gear,
        tracking: TRACKING,
        meshing: 0.04,
        rotor_inertia: 1.14e-5,
        sign_smoothing: 1.0,
        process: [1e-8, 1.0, 0.05, 100.0, 1e-9],
        measurement: [1e-6, 1e-10],
    };
    KalmanEstimator::new(parameters, transform)
}

const TRACKING: TrackingParameters = TrackingParameters {
    poles: [0.5, 0.9, 0.98],
    sigma: 1e-5,
};

fn regimes() -> Regimes {
    let regime = Regime {
        gain: 1.0,
        sigma: 0.1,
    };
    Regimes {
        speed: 0.05,
        time_constant: 0.05,
        sample_period: 1e-3,
        rest: regime,
        moving: regime,
    }
}

/// Mean and standard deviation of each input.
fn spreads(features: FeatureSet, samples: &[JointSample]) -> Vec<(f64, f64)> {
    let inputs: Vec<[f64; MAX_FEATURES]> = samples
        .iter()
        .map(|s| features.of(s, s.current, 100.0))
        .collect();
    let n = inputs.len() as f64;
    (0..features.len())
        .map(|c| {
            let mean = inputs.iter().map(|x| x[c]).sum::<f64>() / n;
            let square = inputs.iter().map(|x| (x[c] - mean).powi(2)).sum::<f64>() / n;
            (mean, square.sqrt())
        })
        .collect()
}

fn network(
    features: FeatureSet,
    samples: &[JointSample],
) -> Result<NetworkEstimator, Box<dyn Error>> {
    let sizes = [features.len(), 16, 16, 1];
    let mut weight = 0.3f64;
    let layers = sizes
        .windows(2)
        .map(|w| Layer {
            weights: (0..w[1])
                .map(|_| {
                    let mut next = || {
                        weight = (weight * 7.13 + 0.37).fract();
                        2.0 * weight - 1.0
                    };
                    (0..w[0]).map(|_| next()).collect()
                })
                .collect(),
            bias: vec![0.1; w[1]],
        })
        .collect();
    let scale = |(mean, spread): (f64, f64)| (mean, 2.0 * spread);
    Ok(NetworkEstimator::new(NetworkParameters {
        features,
        inputs: spreads(features, samples).into_iter().map(scale).collect(),
        torque: (0.0, 8.0),
        layers,
        regimes: regimes(),
        low_pass_pole: 0.5,
        current_filter: [0.05, 0.25, 0.01],
        gear_ratio: 100.0,
        torque_limit: LIMIT,
    })?)
}

/// 20 models of 200 points each, from the motion itself: centres far apart, each sample with the
/// nearest centre, points evenly from each model's samples. `width`: of the kernel, in standard
/// deviations of the inputs; 1 to 5 is what fits come to.
fn local_gp(
    features: FeatureSet,
    width: f64,
    tolerance: f64,
    samples: &[JointSample],
) -> Result<LocalGp, Box<dyn Error>> {
    const MODELS: usize = 20;
    const POINTS: usize = 200;
    let d = features.len();
    let inputs: Vec<(f64, f64)> = spreads(features, samples)
        .into_iter()
        .map(|(mean, spread)| (mean, width * spread))
        .collect();
    let scaled: Vec<Vec<f64>> = samples
        .iter()
        .map(|s| {
            let x = features.of(s, s.current, 100.0);
            let scale = |(x, (mean, width)): (&f64, &(f64, f64))| (x - mean) / width;
            x.iter().zip(&inputs).map(scale).collect()
        })
        .collect();
    let square =
        |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum() };
    let mut centres = vec![scaled[0].clone()];
    while centres.len() < MODELS {
        let away = |x: &Vec<f64>| {
            centres
                .iter()
                .map(|c| square(x, c))
                .fold(f64::MAX, f64::min)
        };
        let furthest = scaled.iter().max_by(|a, b| away(a).total_cmp(&away(b)));
        centres.push(furthest.ok_or("no samples")?.clone());
    }
    let models = centres.iter().map(|centre| {
        let mut by_distance: Vec<usize> = (0..scaled.len()).collect();
        by_distance
            .sort_by(|&a, &b| square(&scaled[a], centre).total_cmp(&square(&scaled[b], centre)));
        let points: Vec<usize> = by_distance
            .into_iter()
            .take(2 * POINTS)
            .step_by(2)
            .collect();
        LocalModel {
            centre: centre.clone(),
            residuals: points
                .iter()
                .map(|&i| 0.3 * (3.0 * scaled[i][0]).sin())
                .collect(),
            noise: vec![1e-3; POINTS],
            points: points
                .iter()
                .flat_map(|&i| scaled[i][..d].to_vec())
                .collect(),
        }
    });
    Ok(LocalGp::new(&LocalGpParameters {
        features,
        models: models.collect(),
        inputs,
        signal_variance: 0.04,
        noise_variance: 2.5e-3,
        directions: 12,
        tolerance,
        regimes: regimes(),
        gear_ratio: 100.0,
    })?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let samples = motion();
    let mut out = std::io::stdout();
    writeln!(
        out,
        "ns per estimate, least of {ROUNDS} rounds at each place of a log: mean and largest over the log"
    )?;
    let mut show = |what: &str, estimator: &mut dyn JointTorqueEstimator| {
        let times = times(estimator, &samples);
        let mean = times.iter().sum::<f64>() / times.len() as f64;
        let largest = times.iter().fold(0.0f64, |m, t| m.max(*t));
        writeln!(out, "  {what:<56} {mean:8.1} {largest:8.1}")
    };
    show("compliance (Z)", &mut ComplianceEstimator::new(joint()))?;
    show("compliance with hysteresis, 6 springs", &mut hysteresis())?;
    show("deformation (S-model)", &mut deformation())?;
    show("current", &mut current())?;
    for (features, name) in [
        (FeatureSet::Published, "network 6-16-16-1"),
        (FeatureSet::Phase, "network 9-16-16-1, theta by its phase"),
    ] {
        show(name, &mut network(features, &samples)?)?;
    }
    show("CM-KF", &mut kalman::<STATES>(Transform::Linear, None))?;
    show("CM-UKF", &mut kalman::<STATES>(Transform::Unscented, None))?;
    show(
        "UKF with hysteresis and added states",
        &mut kalman::<ADDED_STATES>(Transform::Unscented, Some(gear())),
    )?;
    for (features, width, tolerance) in [
        (FeatureSet::Position, 1.0, 1.6e-3),
        (FeatureSet::Position, 2.0, 1.6e-3),
        (FeatureSet::Phase, 1.0, 1.6e-3),
        (FeatureSet::Phase, 2.0, 1.6e-3),
        (FeatureSet::Phase, 2.0, 0.0),
    ] {
        let gp = local_gp(features, width, tolerance, &samples)?;
        let used: usize = samples
            .iter()
            .map(|s| gp.predict(&features.of(s, s.current, 100.0)).used)
            .sum();
        let used = used as f64 / samples.len() as f64;
        let d = features.len();
        let name = format!("local GP, 20 x 200, {d} inputs, width {width}, {used:.1} models near");
        let base = Box::new(ComplianceEstimator::new(joint()));
        show(&name, &mut LocalGpEstimator::new(base, gp, LIMIT))?;
    }
    Ok(())
}

fn hysteresis() -> HysteresisEstimator {
    HysteresisEstimator::new(HysteresisParameters {
        gear: gear(),
        kinematic_error: joint().kinematic_error,
        gear_ratio: 100.0,
        tracking: TRACKING,
        torsion_sigma: 1e-5,
        sample_period: 1e-3,
        torque_limit: LIMIT,
    })
}

fn deformation() -> DeformationEstimator {
    let mut coefficients = [1e-5; COEFFICIENTS];
    coefficients[..5].copy_from_slice(&[1.2e-4, 1.0e-4, 0.8e-4, 1.0e-4, 0.8e-4]);
    DeformationEstimator::new(DeformationParameters {
        rated_torque: 16.0,
        coefficients,
        frequency: AngularFrequency::Spatial,
        current_limit: 5.0,
        gear_ratio: 100.0,
        low_pass_pole: 0.6,
        torsion_sigma: 1e-5,
        sample_period: 1e-3,
        torque_limit: LIMIT,
    })
}

fn current() -> CurrentEstimator {
    CurrentEstimator::new(CurrentParameters {
        k_1: 6.0,
        k_2: 0.3,
        k_3: 2.0,
        k_4: 0.04,
        inertia: 0.114,
        offset: 0.0,
        sign_smoothing: 0.05,
        presliding: [(1e-4, 0.4), (5e-4, 0.3), (3e-3, 0.3)],
        gear_ratio: 100.0,
        low_pass_pole: 0.9,
        sigma: 1.0,
        sample_period: 1e-3,
        torque_limit: LIMIT,
    })
}

/// Least time per estimate at each stretch of the log, ns.
#[allow(clippy::disallowed_methods, reason = "a benchmark looks at the clock")]
fn times(estimator: &mut dyn JointTorqueEstimator, samples: &[JointSample]) -> Vec<f64> {
    let mut best = vec![Duration::MAX; samples.len() / AT_A_TIME];
    for _ in 0..ROUNDS {
        for (best, stretch) in best.iter_mut().zip(samples.chunks_exact(AT_A_TIME)) {
            let start = Instant::now();
            for sample in black_box(stretch) {
                black_box(estimator.update(sample));
            }
            *best = (*best).min(start.elapsed());
        }
    }
    let per_estimate = |d: Duration| d.as_secs_f64() * 1e9 / AT_A_TIME as f64;
    best.into_iter().map(per_estimate).collect()
}
