//! Every fit in its order: each builds on those before it.
//!
//! ```text
//! TURN  -> kinematic error
//! TRAIN -> motor friction -> Z's compliance, skew -> gear with slipping springs
//!       -> deformation model -> noise of the Kalman filters -> network -> local Gaussian processes
//!       -> fusion
//! ```

mod ranges;
mod registry;
mod steps;

pub use registry::Step;

use crate::excitation::{Excitation, Quantity};
use crate::feed_forward;
use crate::inputs::LogKind;
use crate::learned::Progress;
use crate::log::LogRow;
use crate::record::{Record, ReferenceErrors};
use crate::torsion_gain;
use joint_file::{JointFile, KinematicErrorTable, TorsionGainTable, TrainedTable};
use problem::Problem;

/// A fitted joint, and a report of each step.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// The joint with every table.
    pub joint: JointFile,
    /// One line per step.
    pub report: Vec<String>,
    reference: ReferenceErrors,
    harmonics: Harmonics,
    /// Kinematic error by an unloaded turn, before loaded logs have corrected it.
    turn: Option<KinematicErrorTable>,
}

/// Harmonics of the kinematic error that loaded motion is fitted with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Harmonics {
    /// Those of the gear's fit alone: the others come from an unloaded turn.
    OfTheGear,
    /// Higher ones too.
    Higher,
}

/// What a fit without an unloaded turn leaves open.
const WITHOUT_TURN: &str = "without an unloaded turn it is that of the joint file, with the harmonics that the loaded logs show at the angles they cover; \
     whether the encoders' zeros stay is not determined: the torque is valid once the torsion's zero has followed the current for 50 samples, \
     and right to that torque until a tare at a known torque (`torquectl estimate --tare`, `torquectl tare --torque`)";

/// Fits everything and reports on its `progress`. Without an unloaded `turn` the kinematic error stays as the
/// joint has it, but for the harmonics that loaded motion shows, and the torsion's zero is unknown until a
/// tare.
///
/// # Errors
/// The first step that its data do not allow; without a turn, of those that the fused torque needs.
pub fn fit(
    joint: &JointFile,
    turn: Option<&[LogRow]>,
    train: &[LogRow],
    progress: Progress<'_>,
) -> Result<Fitted, Problem> {
    let mut fitted = Fitted::new(joint);
    let mut done = 0.0;
    for step in &Step::ALL {
        let rows = match (step.log, turn) {
            (LogKind::NoLoad, None) => {
                fitted.note(format!("{}: not fitted: {WITHOUT_TURN}", step.name));
                continue;
            }
            (LogKind::NoLoad, Some(turn)) => turn,
            _ => train,
        };
        if !step.applies_to(rows) {
            continue;
        }
        let mut inner = |part: f64, what: &str| progress(done + step.share * part, what);
        inner(0.0, step.name);
        match fitted.step(step, rows, &mut inner) {
            Err(e) if step.may_fail(turn.is_some()) => {
                fitted.note(format!("{}: not fitted: {e}", step.name));
            }
            done => done?,
        }
        done += step.share;
    }
    progress(1.0, "done");
    Ok(fitted)
}

/// Whether every row has a feed-forward.
fn feeds_forward(rows: &[LogRow]) -> bool {
    rows.iter().all(|row| row.feed_forward.is_finite())
}

/// Fits one thing; the results it builds on must be in the joint already. A fusion that is there is
/// fitted again, as it depends on every source.
///
/// # Errors
/// Data that do not allow it, or a table that it needs.
pub fn fit_one(
    joint: &JointFile,
    step: &Step,
    rows: &[LogRow],
    progress: Progress<'_>,
) -> Result<Fitted, Problem> {
    let mut fitted = Fitted::new(joint);
    fitted.step(step, rows, progress)?;
    if fitted.joint.fusion.is_some() && rows.iter().all(|row| row.tau_sensor.is_finite()) {
        fitted.step(&Step::FUSION, rows, progress)?;
    }
    Ok(fitted)
}

/// Knowledge of a training log, and of the encoders, beside the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadedKnowledge {
    /// Errors of the reference as a whole.
    pub reference: ReferenceErrors,
    /// The encoders' zeros are the same after each start, so that the log's hold for good.
    pub zeros_stay: bool,
}

/// Fits what the loop runs, the gear with slipping springs and the current, from loaded motion alone:
/// without an unloaded turn, a torque sensor or learned models. The joint's own tables are its priors.
///
/// # Errors
/// The first step that its data do not allow.
pub fn fit_loaded(
    joint: &JointFile,
    train: &[LogRow],
    known: LoadedKnowledge,
    progress: Progress<'_>,
) -> Result<Fitted, Problem> {
    // Each, and the share of the time that is over when it begins.
    const STEPS: [(Step, f64); 3] = [
        (Step::CURRENT, 0.0),
        (Step::HYSTERESIS, 0.05),
        (Step::FUSION, 0.9),
    ];
    let mut fitted = Fitted {
        reference: known.reference,
        harmonics: Harmonics::Higher,
        ..Fitted::new(joint)
    };
    for (step, done) in &STEPS {
        progress(*done, step.name);
        if step.name == Step::FUSION.name {
            let encoders = fitted.joint.encoders.get_or_insert_default();
            encoders.zero_unknown = !known.zeros_stay;
        }
        fitted.step(step, train, &mut |_, _| ())?;
    }
    progress(1.0, "done");
    Ok(fitted)
}

impl Fitted {
    fn new(joint: &JointFile) -> Self {
        Self {
            joint: joint.clone(),
            report: Vec::new(),
            reference: ReferenceErrors::of_a_sensor(joint.joint.rated_torque),
            harmonics: Harmonics::OfTheGear,
            turn: joint.kinematic_error.clone(),
        }
    }

    /// The files that the fitted joint consists of: names and texts, the joint file `STEM.toml`
    /// first, trained ones beside it.
    ///
    /// # Errors
    /// Numbers that TOML cannot hold.
    pub fn files(&self, stem: &str) -> Result<Vec<(String, String)>, Problem> {
        let mut joint = self.joint.clone();
        let mut files = Vec::new();
        if let Some(network) = &joint.trained.network {
            let file = format!("{stem}.network.toml");
            files.push((file.clone(), network.to_text()?));
            joint.network = Some(TrainedTable { file });
        }
        for (name, gp) in &joint.trained.local_gp {
            let file = format!("{stem}.{name}.toml");
            files.push((file.clone(), gp.to_text()?));
            joint.local_gp.insert(name.clone(), TrainedTable { file });
        }
        files.insert(0, (format!("{stem}.toml"), joint.to_toml()?));
        Ok(files)
    }

    fn step(
        &mut self,
        step: &Step,
        rows: &[LogRow],
        progress: Progress<'_>,
    ) -> Result<(), Problem> {
        let loaded = step.log != LogKind::NoLoad;
        if loaded && !rows.iter().all(|row| row.tau_sensor.is_finite()) {
            return Err(Problem::new(
                "training log: column `tau_sensor` is needed",
                "",
            ));
        }
        let record = Record::new(&self.joint, rows)?;
        if step.needs_stiffness {
            let excitation = Excitation::new(&record, &self.joint);
            if let Some(constant) = excitation.undetermined(Quantity::Compliance) {
                let reason = format!("training log: {}", constant.sentence());
                return Err(Problem::new(
                    reason,
                    "loads that change, and motion under load",
                ));
            }
        }
        (step.fit)(self, record, rows, progress)
    }

    /// Errors of every source, and what the loop takes from their fused torque.
    fn errors_of_sources(&mut self, record: &Record, rows: &[LogRow]) -> Result<(), Problem> {
        if self.joint.feed_forward.is_some() && !feeds_forward(rows) {
            self.joint.feed_forward = None;
            self.note("feed-forward: no longer a source, as the log has none".to_owned());
        }
        self.fusion(record)?;
        self.change_sigma(record)?;
        self.torsion_gain(record)
    }

    /// Part of the torque that the feed-forward explains.
    fn feed_forward(&mut self, record: &Record) -> Result<(), Problem> {
        let smoothing = self.joint.current_parameters().sign_smoothing;
        let rated = self.joint.joint.rated_torque;
        let table = feed_forward::fit(record, rated, smoothing, self.reference)?;
        self.note(format!(
            "feed-forward: {:.3} of it, offset {:.3} N·m, friction in it {:.3} N·m, {:.4} N·m on held-out blocks",
            table.gain, table.offset, table.coulomb, table.sigma
        ));
        self.joint.feed_forward = Some(table);
        Ok(())
    }

    /// How the reference's fast changes go with those of the fused torque.
    fn torsion_gain(&mut self, record: &Record) -> Result<(), Problem> {
        self.joint.torsion_gain = None;
        let mut set = self.joint.fused_estimators()?;
        self.joint.torsion_gain = torsion_gain::fit(record, &mut set);
        self.note(match &self.joint.torsion_gain {
            Some(TorsionGainTable { gain, sigma }) => {
                format!("torsion gain: {gain:.3} +- {sigma:.3}")
            }
            None => "torsion gain: not determined, the loop begins with 1".to_owned(),
        });
        Ok(())
    }

    /// How the other sources change against the feed-forward.
    fn change_sigma(&mut self, record: &Record) -> Result<(), Problem> {
        let ratio = self
            .joint
            .hysteresis
            .as_ref()
            .map_or(1.0, |g| g.held_out_ratio);
        let Some(table) = &mut self.joint.feed_forward else {
            return Ok(());
        };
        table.change_sigma = [feed_forward::UNBOUNDED; 2];
        let mut set = self.joint.estimators()?;
        let change_sigma = feed_forward::change_sigma(record, &mut set, ratio);
        if let Some(table) = &mut self.joint.feed_forward {
            table.change_sigma = change_sigma;
        }
        Ok(())
    }

    fn note(&mut self, line: String) {
        self.report.push(line);
    }
}
