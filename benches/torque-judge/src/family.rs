//! Judgement over the family: joints times trainings times scenarios.

use crate::course::{self, Training};
use crate::fit::fit;
use crate::score::Score;
use crate::simulate::simulate;
use crate::specimen::Specimen;
use identification::log::LogRow;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

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

/// Result of a family's judgement.
#[derive(Debug, Clone, Default)]
pub struct Judged {
    /// All cases.
    pub cases: Vec<Case>,
    /// Fits that were refused, with the reason.
    pub refused: Vec<String>,
    /// Reports of the fits, by joint and training.
    pub reports: Vec<String>,
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
    let (turn, train) = (rows(course::turn()), rows(course::training(kind, number)));
    let fitted = fit(&joint.file(), Some(&turn), &train);
    let mut cases = Vec::new();
    let mut outcome = Judged::default();
    match fitted {
        Ok((file, notes)) => {
            let report = notes.join("\n  ");
            outcome.reports.push(format!(
                "{number} {name} ({}):\n  {report}",
                joint.describe()
            ));
            for run in course::scenarios(number) {
                match Score::of(&file, &simulate(&joint, &run), run.from) {
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
        judged.refused.extend(outcome.refused);
        judged.reports.extend(outcome.reports);
    }
}

/// Judges the joints of the numbers after the trainings, on so many threads; `progress` takes the
/// number of fits done.
#[must_use]
pub fn judge(
    numbers: &[u64],
    trainings: &[(Training, &'static str)],
    threads: usize,
    progress: &(dyn Fn(usize) + Sync),
) -> Judged {
    let judged = Mutex::new(Judged::default());
    let next = AtomicUsize::new(0);
    let count = numbers.len() * trainings.len();
    std::thread::scope(|scope| {
        for _ in 0..threads.max(1) {
            scope.spawn(|| {
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    if k >= count {
                        break;
                    }
                    let training = trainings[k % trainings.len()];
                    one(numbers[k / trainings.len()], training, &judged);
                    progress(k + 1);
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
