//! Fits as a user runs them: every step whose result the fused torque uses.

use identification::all::{self, Step};
use identification::log::LogRow;
use joint_file::JointFile;
use problem::Problem;

/// The steps that are judged. The learned estimators take two thirds of the time of `fit all` and
/// need more data than most trainings here have.
const STEPS: [Step; 6] = [
    Step::Current,
    Step::Compliance,
    Step::Hysteresis,
    Step::Deformation,
    Step::Kalman,
    Step::Fusion,
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
    let mut take = |step, rows: &[LogRow]| match all::fit_one(&file, step, rows, &mut |_, _| ()) {
        Ok(fitted) => {
            file = fitted.joint;
            notes.extend(fitted.report);
        }
        Err(problem) => notes.push(format!("{step:?}: {problem}")),
    };
    if let Some(turn) = turn {
        take(Step::KinematicError, turn);
    }
    STEPS.into_iter().for_each(|step| take(step, training));
    match file.fusion.is_some() {
        true => Ok((file, notes)),
        false => Err(Problem::new(notes.join("; "), "")),
    }
}
