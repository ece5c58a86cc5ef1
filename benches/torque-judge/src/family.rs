//! Judgement over the family: joints times trainings times scenarios.

use crate::course::{self, Training};
use crate::fit::fit;
use crate::real::TARED;
use crate::score::Score;
use crate::simulate::simulate;
use crate::specimen::Specimen;
use estimators::hysteresis::ENCODER_PARAMETERS;
use identification::log::LogRow;
use joint_file::JointFile;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// One joint after one training in one scenario.
#[derive(Debug, Clone)]
pub struct Case {
    /// The joint's number.
    pub number: u64,
    /// Its structure.
    pub structure: String,
    /// Name of the training.
    pub training: &'static str,
    /// Name of the scenario.
    pub scenario: &'static str,
    /// Errors of all estimators.
    pub score: Score,
}

/// One constant of a fit beside the truth.
#[derive(Debug, Clone)]
pub struct Constant {
    /// The joint's number.
    pub number: u64,
    /// Name of the training.
    pub training: &'static str,
    /// The constant.
    pub name: &'static str,
    /// Its error over its standard deviation.
    pub ratio: f64,
}

/// Result of a family's judgement.
#[derive(Debug, Clone, Default)]
pub struct Judged {
    /// All cases.
    pub cases: Vec<Case>,
    /// Constants of the fits whose truth is one number.
    pub constants: Vec<Constant>,
    /// Fits that were refused, with the reason.
    pub refused: Vec<String>,
    /// Reports of the fits, by joint and training.
    pub reports: Vec<String>,
}

/// Constants that the family's laws have in the sense of the fits: torque constant, offset and inertia of the
/// motor, skew of the encoders. Stiffness and friction are curves here.
fn constants(joint: &Specimen, file: &JointFile) -> Vec<(&'static str, f64)> {
    let (sheet, sensors) = (&joint.sheet, &joint.sensors);
    let ratio = sheet.gear_ratio;
    let mut list = Vec::new();
    let spread = |directions: &[Vec<f64>], from: &dyn Fn(usize) -> usize| -> f64 {
        let part = |d: &Vec<f64>| d.get(from(d.len())).copied().unwrap_or(0.0).powi(2);
        directions.iter().map(part).sum::<f64>().sqrt().max(1e-12)
    };
    if let Some(current) = &file.current {
        let of = |k: usize| spread(&current.uncertainty, &|_| k);
        let gain = ratio * sheet.torque_constant * joint.torque_constant / sensors.current_gain;
        let inertia = ratio * ratio * sheet.rotor_inertia;
        list.extend([
            ("torque constant", (current.k_1 - gain) / of(0)),
            (
                "offset of the current",
                (current.offset - sensors.current_offset) * current.k_1 / of(1),
            ),
            ("inertia", (current.inertia - inertia) / of(4)),
        ]);
    }
    if let (Some(gear), Some(encoders)) = (&file.hysteresis, &file.encoders) {
        let sigma = spread(&gear.uncertainty, &|n| n.saturating_sub(ENCODER_PARAMETERS));
        list.push(("skew", (encoders.skew - sensors.skew) / sigma));
    }
    list
}

/// An encoder zero of the log's own: torsion counts from its first sample.
fn from_first_sample<'a>(rows: impl Iterator<Item = &'a mut LogRow>, ratio: f64) {
    let mut zero = None;
    for row in rows {
        let zero = *zero.get_or_insert(row.theta - ratio * row.q);
        row.theta -= zero;
    }
}

fn one(number: u64, training: (Training, &'static str), judged: &Mutex<Judged>) {
    let (kind, name) = training;
    let joint = Specimen::new(number);
    let joint = match kind {
        Training::Noisy => joint.noisy(),
        Training::Coarse => joint.coarse(),
        _ => joint,
    };
    let rows = |run: course::Run| -> Vec<LogRow> {
        simulate(&joint, &run)
            .into_iter()
            .map(|(row, _)| row)
            .collect()
    };
    let unturned = kind.is_unturned();
    let mut train = rows(course::training(kind, number));
    let turn = (!unturned).then(|| rows(course::turn()));
    let ratio = joint.sheet.gear_ratio;
    if unturned {
        from_first_sample(train.iter_mut(), ratio);
    }
    let fitted = fit(&joint.file(), turn.as_deref(), &train);
    let mut cases = Vec::new();
    let mut outcome = Judged::default();
    match fitted {
        Ok((file, notes)) => {
            let report = notes.join("\n  ");
            outcome.reports.push(format!(
                "{number} {name} ({}):\n  {report}",
                joint.describe()
            ));
            let constants = constants(&joint, &file).into_iter();
            outcome
                .constants
                .extend(constants.map(|(constant, ratio)| Constant {
                    number,
                    training: name,
                    name: constant,
                    ratio,
                }));
            let mut runs = if kind == Training::Outside {
                course::outside(number)
            } else {
                course::scenarios(number)
            };
            if unturned {
                runs.extend(course::other_sign(number));
            }
            for run in runs {
                let mut judged = simulate(&joint, &run);
                if unturned {
                    from_first_sample(judged.iter_mut().map(|(row, _)| row), ratio);
                }
                let tared = if unturned { TARED } else { 0 };
                match Score::after(&file, &judged, run.from, tared) {
                    Ok(score) => cases.push(Case {
                        number,
                        structure: joint.describe(),
                        training: name,
                        scenario: run.name,
                        score,
                    }),
                    Err(e) => outcome.refused.push(format!("{number} {name}: {e}")),
                }
            }
        }
        Err(e) => outcome.refused.push(format!("{number} {name}: {e}")),
    }
    if let Ok(mut judged) = judged.lock() {
        judged.cases.extend(cases);
        judged.constants.extend(outcome.constants);
        judged.refused.extend(outcome.refused);
        judged.reports.extend(outcome.reports);
    }
}

/// A joint and a training, by number and name.
pub type Fit = (u64, (Training, &'static str));

/// The fits of the results page, the most important first: every joint once, by turns after the training
/// `full` and after one of the others; then every joint once more, the other way round.
#[must_use]
pub fn plan(numbers: &[u64]) -> Vec<Fit> {
    let [full, others @ ..] = Training::ALL;
    let pass = |odd: usize| {
        numbers.iter().enumerate().map(move |(k, number)| {
            let training = if k % 2 == odd {
                full
            } else {
                others[(k / 2) % others.len()]
            };
            (*number, training)
        })
    };
    pass(0).chain(pass(1)).collect()
}

/// Runs the fits, on so many threads; after `until` none begins. `progress` takes the number of fits done.
#[must_use]
pub fn judge(
    fits: &[Fit],
    threads: usize,
    until: Option<Instant>,
    progress: &(dyn Fn(usize) + Sync),
) -> Judged {
    let judged = Mutex::new(Judged::default());
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            scope.spawn(|| {
                while until.is_none_or(|until| Instant::now() < until)
                    && let Some((number, training)) =
                        fits.get(next.fetch_add(1, Ordering::Relaxed)).copied()
                {
                    one(number, training, &judged);
                    progress(next.load(Ordering::Relaxed).min(fits.len()));
                }
            });
        }
    });
    let mut judged = judged.into_inner().unwrap_or_default();
    judged
        .cases
        .sort_by_key(|c| (c.number, c.training, c.scenario));
    judged
}
