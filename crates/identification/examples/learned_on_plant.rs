//! The learned estimators on the plant's test bench, beside the models that they learn from.
//!
//! `cargo run --release -p identification --example learned_on_plant [SECONDS]`: seconds of
//! training (half in motion, half at rest). Prints RMS in per cent of RMS torque.

#[allow(dead_code, reason = "shared with tests")]
#[path = "../tests/common/bench.rs"]
mod bench;

use estimators::features::FeatureSet;
use estimators::joint::AnyEstimator;
use estimators::joint::JointTorqueEstimator;
use estimators::local_gp::{LocalGp, LocalGpEstimator};
use estimators::network::NetworkEstimator;
use identification::all;
use identification::evaluate::Score;
use identification::gaussian_process::{self, GpOptions};
use identification::log::LogRow;
use identification::network::{self, NetworkOptions};
use identification::record::Record;
use joint_file::JointFile;
use std::error::Error;
use std::io::{Write, stdout};

type Named = (String, AnyEstimator);

#[allow(clippy::disallowed_methods, reason = "a report looks at the clock")]
fn main() -> Result<(), Box<dyn Error>> {
    let seconds: f64 = std::env::args().nth(1).map_or(Ok(120.0), |s| s.parse())?;
    let mut out = stdout();
    let train = bench::training(seconds, 0.5);
    let start = std::time::Instant::now();
    let fitted = all::fit(
        &bench::joint(),
        Some(&bench::turn()),
        &train,
        &mut |_, _| (),
    )?;
    writeln!(
        out,
        "models fitted in {:.1} s",
        start.elapsed().as_secs_f64()
    )?;
    for line in &fitted.report {
        writeln!(out, "  {line}")?;
    }
    let joint = fitted.joint;
    let record = Record::new(&joint, &train)?;
    let mut estimators: Vec<Named> = Vec::new();
    for features in [FeatureSet::Phase, FeatureSet::Published] {
        let start = std::time::Instant::now();
        let options = NetworkOptions {
            features,
            ..NetworkOptions::new(joint.torque_limit())
        };
        let trained = network::train(&record, &options, &mut |_, _| ())?;
        writeln!(
            out,
            "network {features:?}: {:.3} N·m held out, {:?}, {:.1} s",
            trained.held_out_rms,
            trained.parameters.regimes,
            start.elapsed().as_secs_f64()
        )?;
        let estimator = NetworkEstimator::new(trained.parameters)?;
        estimators.push((format!("network {features:?}"), Box::new(estimator)));
    }
    for features in [FeatureSet::Phase, FeatureSet::Position] {
        for base in ["compliance", "hysteresis"] {
            let start = std::time::Instant::now();
            let options = GpOptions {
                features,
                ..GpOptions::new(base, joint.joint.rated_torque)
            };
            let mut model = source(&joint, base)?;
            let trained =
                gaussian_process::train(&record, &options, model.as_mut(), &mut |_, _| ())?;
            let p = &trained.parameters;
            let points: Vec<usize> = p.models.iter().map(|m| m.residuals.len()).collect();
            writeln!(
                out,
                "GP {features:?} on {base}: {:?} N·m held out, widths {:.2?}, signal {:.4}, noise \
                 {:.4}, points {points:?}, {:?}, {:.1} s",
                trained.held_out_rms,
                p.inputs.iter().map(|i| i.1).collect::<Vec<_>>(),
                p.signal_variance.sqrt(),
                p.noise_variance.sqrt(),
                p.regimes,
                start.elapsed().as_secs_f64()
            )?;
            let gp = LocalGp::new(p)?;
            let estimator =
                LocalGpEstimator::new(source(&joint, base)?, gp.clone(), joint.torque_limit());
            let (mean, used) = time_and_use(&gp, &record, features);
            writeln!(out, "  {mean:.0} ns per prediction, {used:.1} models near")?;
            estimators.push((format!("GP {features:?} on {base}"), Box::new(estimator)));
        }
    }
    let sources = joint.sources()?.into_iter();
    estimators.extend(sources.map(|source| (source.name, source.estimator)));
    let scenarios = bench::scenarios();
    write!(out, "{:<28}", "RMS, % of RMS torque")?;
    for (name, _) in &scenarios {
        write!(out, "{name:>18}")?;
    }
    writeln!(out)?;
    for (name, estimator) in &mut estimators {
        write!(out, "{name:<28}")?;
        for (_, rows) in &scenarios {
            let (percent, sigma) = figures(&joint, estimator.as_mut(), rows)?;
            write!(out, "{percent:>9.2} ({sigma:>4.2})")?;
        }
        writeln!(out)?;
    }
    writeln!(
        out,
        "in brackets: RMS of error over sigma, 1 if sigma is honest"
    )?;
    Ok(())
}

/// Mean time of a prediction over the training's own samples, ns, and models that took part.
#[allow(clippy::disallowed_methods, reason = "a report looks at the clock")]
fn time_and_use(gp: &LocalGp, record: &Record, features: FeatureSet) -> (f64, f64) {
    let sample = |i: usize| &record.samples[i];
    let inputs: Vec<_> = (0..record.samples.len())
        .step_by(37)
        .map(|i| features.of(sample(i), sample(i).current, record.gear_ratio))
        .collect();
    let mut best = f64::MAX;
    let mut used = 0;
    for _ in 0..20 {
        let start = std::time::Instant::now();
        used = inputs.iter().map(|x| gp.predict(x).used).sum();
        best = best.min(start.elapsed().as_secs_f64());
    }
    let count = inputs.len() as f64;
    (1e9 * best / count, used as f64 / count)
}

fn source(joint: &JointFile, name: &str) -> Result<AnyEstimator, Box<dyn Error>> {
    Ok(joint
        .model(name)?
        .ok_or_else(|| format!("no source {name}"))?)
}

/// RMS in per cent of RMS torque; RMS of the error in units of sigma.
fn figures(
    joint: &JointFile,
    estimator: &mut dyn JointTorqueEstimator,
    rows: &[LogRow],
) -> Result<(f64, f64), Box<dyn Error>> {
    estimator.reset();
    let mut front_end = joint.front_end()?;
    let mut score = Score::new(joint.sample_period());
    let (mut square, mut count) = (0.0, 0.0);
    for row in rows {
        let sample = row.sample(&mut front_end);
        let e = estimator.update(&sample);
        if row.t > 1.5 {
            score.add(e.tau, row.tau_sensor);
            square += ((e.tau - row.tau_sensor) / e.sigma.max(1e-6)).powi(2);
            count += 1.0;
        }
    }
    let figures = score.figures().ok_or("no samples")?;
    Ok((figures.rms_percent, f64::sqrt(square / count)))
}
