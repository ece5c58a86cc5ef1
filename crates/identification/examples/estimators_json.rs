//! Computes what JSON asks for, for comparison with other libraries.
//!
//! stdin, one of: `{"savgol": [[window, order, derivative, delay_samples]]}`;
//! `{"gp": {"points", "residuals", "widths", "signal_variance", "noise_variance", "queries"}}`;
//! `{"kalman": {"joint", "process", "measurement", "samples": [[q, theta, dq, omega, current]]}}`.
//! stdout: an object with the answers.

use estimators::compliance::ComplianceParameters;
use estimators::compliance::JointEstimatorParameters;
use estimators::features::{FeatureSet, MAX_FEATURES};
use estimators::joint::{JointSample, JointTorqueEstimator};
use estimators::kalman::{KalmanEstimator, KalmanParameters, STATES, Transform};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::local_gp::{LocalGp, LocalGpParameters, LocalModel};
use estimators::regimes::{Regime, Regimes};
use estimators::savitzky_golay::coefficients;
use estimators::wave_generator::{FrictionRule, WaveGeneratorParameters};
use identification::gaussian_process::log_marginal_likelihood;
use nalgebra::{DMatrix, DVector};
use serde_json::{Value, json};
use std::error::Error;
use std::io::{Read, Write, stdin, stdout};

type Answer = Result<Value, Box<dyn Error>>;

fn main() -> Result<(), Box<dyn Error>> {
    let mut text = String::new();
    stdin().read_to_string(&mut text)?;
    let request: Value = serde_json::from_str(&text)?;
    let answer = if let Some(filters) = request.get("savgol") {
        savgol(filters)?
    } else if let Some(gp) = request.get("gp") {
        gaussian_process(gp)?
    } else {
        kalman(request.get("kalman").ok_or("savgol, gp or kalman")?)?
    };
    writeln!(stdout(), "{answer}")?;
    Ok(())
}

fn number(of: &Value, key: &str) -> Result<f64, Box<dyn Error>> {
    of[key]
        .as_f64()
        .ok_or_else(|| format!("{key}: a number").into())
}

fn row(of: &Value) -> Result<Vec<f64>, Box<dyn Error>> {
    Ok(serde_json::from_value(of.clone())?)
}

fn rows(of: &Value) -> Result<Vec<Vec<f64>>, Box<dyn Error>> {
    Ok(serde_json::from_value(of.clone())?)
}

fn savgol(filters: &Value) -> Answer {
    let of = |f: Vec<f64>| coefficients(f[0] as usize, f[1] as usize, f[2] as usize, f[3]);
    let all: Vec<Vec<f64>> = rows(filters)?.into_iter().map(of).collect();
    Ok(json!({ "coefficients": all }))
}

fn gaussian_process(gp: &Value) -> Answer {
    let (points, residuals) = (rows(&gp["points"])?, row(&gp["residuals"])?);
    let widths = row(&gp["widths"])?;
    let (signal, noise) = (
        number(gp, "signal_variance")?,
        number(gp, "noise_variance")?,
    );
    let d = widths.len();
    let x = DMatrix::from_fn(points.len(), d, |i, c| points[i][c]);
    let y = DVector::from_vec(residuals.clone());
    let likelihood = log_marginal_likelihood(&x, &y, &widths, signal, noise);
    let (value, gradient) = likelihood.ok_or("cannot be factored")?;
    let all = [
        FeatureSet::Load,
        FeatureSet::Position,
        FeatureSet::Published,
        FeatureSet::Phase,
    ];
    let features = all.into_iter().find(|f| f.len() == d);
    let scaled =
        |point: &Vec<f64>| -> Vec<f64> { point.iter().zip(&widths).map(|(x, w)| x / w).collect() };
    let regime = Regime {
        gain: 1.0,
        sigma: 1.0,
    };
    let model = LocalModel {
        centre: vec![0.0; d],
        noise: vec![noise; residuals.len()],
        points: points.iter().flat_map(scaled).collect(),
        residuals,
    };
    let gp_exact = LocalGp::new(&LocalGpParameters {
        features: features.ok_or("3, 4, 6 or 9 inputs")?,
        inputs: widths.iter().map(|w| (0.0, *w)).collect(),
        signal_variance: signal,
        noise_variance: noise,
        models: vec![model],
        directions: usize::MAX,
        tolerance: 0.0,
        regimes: Regimes {
            speed: 1.0,
            time_constant: 1.0,
            sample_period: 1.0,
            rest: regime,
            moving: regime,
        },
        gear_ratio: 1.0,
    })?;
    let predicted: Vec<[f64; 2]> = rows(&gp["queries"])?
        .iter()
        .map(|query| {
            let mut x = [0.0; MAX_FEATURES];
            x[..d].copy_from_slice(query);
            let p = gp_exact.predict(&x);
            [p.mean, p.variance]
        })
        .collect();
    Ok(json!({
        "log_marginal_likelihood": value,
        "gradient": gradient,
        "predicted": predicted,
    }))
}

fn kalman(request: &Value) -> Answer {
    let j = &request["joint"];
    let joint = JointEstimatorParameters {
        gear_ratio: number(j, "gear_ratio")?,
        torque_limit: number(j, "torque_limit")?,
        sample_period: number(j, "sample_period")?,
        low_pass_pole: 0.0,
        link_resolution: 0.0,
        motor_resolution: 0.0,
        torsion_sigma: 0.0,
        current_sigma: 0.0,
        compliance: ComplianceParameters {
            k_fs0: number(j, "k_fs0")?,
            c_fs: number(j, "c_fs")?,
            k_wg0: number(j, "k_wg0")?,
            c_wg: number(j, "c_wg")?,
        },
        wave_generator: WaveGeneratorParameters {
            torque_constant: number(j, "torque_constant")?,
            friction: number(j, "friction")?,
            viscous_friction: number(j, "viscous_friction")?,
            epsilon: 0.5,
            rule: FrictionRule::Physical,
        },
        kinematic_error: KinematicErrorParameters {
            a0: 0.0,
            w_link: 1.0,
            link: vec![(0.0, number(j, "error_link")?)],
            w_motor: 1.0,
            motor: vec![(number(j, "error_motor")?, 0.0)],
        },
    };
    let parameters = KalmanParameters {
        joint,
        gear: None,
        tracking: estimators::tracking::TrackingParameters::default(),
        meshing: 0.0,
        rotor_inertia: number(j, "rotor_inertia")?,
        sign_smoothing: number(j, "sign_smoothing")?,
        process: serde_json::from_value(request["process"].clone())?,
        measurement: serde_json::from_value(request["measurement"].clone())?,
    };
    let mut answer = serde_json::Map::new();
    for (name, transform) in [
        ("linear", Transform::Linear),
        ("unscented", Transform::Unscented),
    ] {
        let mut filter = KalmanEstimator::<STATES>::new(parameters.clone(), transform);
        let mut out = Vec::new();
        for s in rows(&request["samples"])? {
            let estimate = filter.update(&JointSample {
                q: s[0],
                theta: s[1],
                dq: s[2],
                omega: s[3],
                current: s[4],
                feed_forward: None,
                flags: 0,
            });
            let x = filter.state().ok_or("the filter lost its state")?;
            let innovation = filter.normalized_innovation();
            out.push([x[0], x[1], x[2], estimate.sigma, innovation]);
        }
        answer.insert(name.to_owned(), json!(out));
    }
    Ok(Value::Object(answer))
}
