//! Calibrates a joint from its calibration runs and judges every estimator in every scenario.

use crate::joint::BenchJoint;
use crate::run::run;
use crate::scenario::{self, Scenario};
use estimators::joint::JointTorqueEstimator;
use identification::all::{self, Fitted};
use identification::evaluate::{Figures, Score};
use identification::log::LogRow;

/// Errors of every estimator in one scenario.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The scenario's name.
    pub name: &'static str,
    /// Description.
    pub about: &'static str,
    /// Estimators, `fused` last, and their figures against the true torque.
    pub figures: Vec<(String, Figures)>,
    /// For the picture: t, true torque, and the estimates in the order of `figures`.
    pub trace: Vec<(f64, f64, Vec<f64>)>,
}

impl Outcome {
    /// Figures of one estimator; none if it is not there.
    #[must_use]
    pub fn of(&self, name: &str) -> Option<&Figures> {
        let found = self.figures.iter().find(|(n, _)| n == name);
        found.map(|(_, figures)| figures)
    }

    /// RMS in per cent of RMS torque; NaN if there is no such estimator.
    #[must_use]
    pub fn percent(&self, name: &str) -> f64 {
        self.of(name).map_or(f64::NAN, |f| f.rms_percent)
    }

    /// RMS error of the fused torque over that of its best source.
    #[must_use]
    pub fn fused_over_best(&self) -> f64 {
        let sources = self.figures.iter().filter(|(n, _)| n != FUSED);
        let best = sources.map(|(_, f)| f.rms).fold(f64::INFINITY, f64::min);
        self.of(FUSED).map_or(f64::NAN, |f| f.rms / best)
    }
}

/// Name of the fused torque.
pub const FUSED: &str = "fused";
/// Samples between two of a trace.
const TRACE_INTERVAL: usize = 10;

/// Fits the joint to its calibration runs alone.
///
/// # Errors
/// Data that the fit refuses.
pub fn calibrate(joint: &BenchJoint) -> Result<Fitted, String> {
    let rows =
        |s: Scenario| -> Vec<LogRow> { run(joint, &s).into_iter().map(|(row, _)| row).collect() };
    let (turn, train) = (rows(scenario::turn(joint)), rows(scenario::train(joint)));
    all::fit(&joint.file, Some(&turn), &train, &mut |_, _| ()).map_err(|e| e.to_string())
}

/// Runs the scenarios and judges the estimators against the true torque.
///
/// # Errors
/// Estimators that cannot be built.
pub fn judge(
    joint: &BenchJoint,
    fitted: &Fitted,
    scenarios: &[Scenario],
) -> Result<Vec<Outcome>, String> {
    scenarios
        .iter()
        .map(|scenario| outcome(joint, fitted, scenario))
        .collect()
}

fn outcome(joint: &BenchJoint, fitted: &Fitted, scenario: &Scenario) -> Result<Outcome, String> {
    let file = &fitted.joint;
    let mut set = file.estimators().map_err(|e| e.to_string())?;
    let mut front_end = file.front_end().map_err(|e| e.to_string())?;
    let mut names: Vec<String> = set.names().to_vec();
    names.push(FUSED.to_owned());
    let mut scores = vec![Score::new(file.sample_period()); names.len()];
    let mut trace = Vec::new();
    for (i, (row, tau)) in run(joint, scenario).iter().enumerate() {
        let sample = row.sample(&mut front_end);
        let fused = set.update(&sample);
        if row.t < scenario.judged_from {
            continue;
        }
        let all = || set.estimates().iter().chain([&fused]);
        for (score, e) in scores.iter_mut().zip(all()) {
            score.add(e.tau, *tau);
        }
        if i.is_multiple_of(TRACE_INTERVAL) {
            trace.push((row.t, *tau, all().map(|e| e.tau).collect()));
        }
    }
    let figures = names
        .into_iter()
        .zip(&scores)
        .filter_map(|(name, score)| Some((name, score.figures()?)))
        .collect();
    Ok(Outcome {
        name: scenario.name,
        about: scenario.about,
        figures,
        trace,
    })
}
