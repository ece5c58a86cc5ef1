//! Fits as a user runs them: every step whose result the fused torque uses.

use crate::course::{self, Training};
use crate::simulate::simulate;
use crate::specimen::Specimen;
use estimators::joint::JointTorqueEstimator;
use identification::all::{self, Step};
use identification::log::LogRow;
use joint_file::JointFile;
use problem::Problem;

/// The steps that are judged. The learned estimators take two thirds of the time of `fit all` and
/// need more data than most trainings here have.
const STEPS: [Step; 7] = [
    Step::CURRENT,
    Step::FEED_FORWARD,
    Step::COMPLIANCE,
    Step::HYSTERESIS,
    Step::DEFORMATION,
    Step::KALMAN,
    Step::FUSION,
];

/// A joint fitted step by step, as `torquectl fit STEP` does; steps that the data do not allow are
/// left out and named.
///
/// # Errors
/// No step was possible.
pub fn fit(
    file: &JointFile,
    turn: Option<&[LogRow]>,
    training: &[LogRow],
) -> Result<(JointFile, Vec<String>), Problem> {
    let (mut file, mut notes) = (file.clone(), Vec::new());
    let mut take =
        |step: &Step, rows: &[LogRow]| match all::fit_one(&file, step, rows, &mut |_, _| ()) {
            Ok(fitted) => {
                file = fitted.joint;
                notes.extend(fitted.report);
            }
            Err(problem) => notes.push(format!("{step:?}: {problem}")),
        };
    if let Some(turn) = turn {
        take(&Step::KINEMATIC_ERROR, turn);
    }
    let steps = STEPS.iter().filter(|step| step.applies_to(training));
    steps.for_each(|step| take(step, training));
    if file.fusion.is_some() {
        Ok((file, notes))
    } else {
        Err(Problem::new(notes.join("; "), ""))
    }
}

/// Samples whose fit and estimates are timed: the training's 120 s and as many as are missing again.
const TIMED: usize = 150_000;

/// Processor's time of `fit all` on [`TIMED`] samples, s, and of the fused torque per sample as the loop
/// computes it, s.
///
/// # Errors
/// A fit that fails.
pub fn times(number: u64) -> Result<[f64; 2], Problem> {
    let joint = Specimen::new(number);
    let rows = |run: course::Run| -> Vec<LogRow> {
        let rows = simulate(&joint, &run).into_iter();
        rows.map(|(row, _)| row).collect()
    };
    let turn = rows(course::turn());
    let mut run = course::training(Training::Full, number);
    run.seconds = TIMED as f64 / joint.sheet.sample_rate;
    let training = rows(run);
    let before = processor_time();
    let file = all::fit(&joint.file(), Some(&turn), &training, &mut |_, _| ())?.joint;
    let fitted = processor_time();
    let (mut set, mut front_end) = (file.fused_estimators()?, file.front_end()?);
    let samples: Vec<_> = (training.iter())
        .map(|row| row.sample(&mut front_end))
        .collect();
    let start = processor_time();
    let mut sum = 0.0;
    for sample in &samples {
        sum += set.update(sample).tau;
    }
    std::hint::black_box(sum);
    let per_sample = (processor_time() - start) / samples.len() as f64;
    Ok([fitted - before, per_sample])
}

/// Time that this thread has had of a processor, s: other work on the machine does not count.
fn processor_time() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let first = text.split_whitespace().next();
    1e-9 * first.and_then(|ns| ns.parse().ok()).unwrap_or(f64::NAN)
}
