//! Inertial parameters and friction of a robot from logs of its joints: angle and torque alone.
//!
//! Logs come in, repaired and put on an even grid ([`signals`]); every sample becomes a row of the
//! joint-torque regressor with columns of friction beside it ([`rows`]); parameters are estimated by
//! weighted least squares ([`equations`]) with the URDF's values as prior, friction terms, smoothing
//! and the prior's weight chosen on held-out blocks ([`select`]); link inertias that a body can have are
//! found by a convex fit ([`consistent`]); base parameters say what the motion determines
//! ([`base`]). Every figure reported is of quarters that the fit has not seen ([`judge`]).

pub mod alternatives;
pub mod base;
pub mod checks;
pub mod consistent;
pub mod contradictions;
pub mod equations;
pub mod friction;
pub mod gains;
pub mod held;
pub mod judge;
pub mod mend;
pub mod noise;
pub mod payload;
pub mod robot;
pub mod rows;
pub mod select;
pub mod signals;
pub mod timing;

use base::{Base, BaseParameter};
use consistent::Prior;
use dynamics::Inertia;
use equations::Grams;
use friction::{Friction, Term};
use judge::Judged;
pub use robot::{JointColumns, Robot, RobotLog};

use problem::{Problem, Problems};
use rows::{BLOCKS, Rows, Sampling};
use select::Fit;
use signals::{Recording, Smoothing, Source, half_width};

/// The low-pass filter passes this multiple of the motion's own frequency, within [`BAND`].
const BAND_TIMES_MOTION: f64 = 8.0;
/// Lowest and highest cut-off of the low-pass filter, Hz: below, a robot's slowest changes of
/// direction are lost; above, gears and links are no longer rigid.
const BAND: (f64, f64) = (5.0, 20.0);
/// Cut-offs of the kinematic smoothing that are tried, as multiples of the low-pass filter's.
const SMOOTHINGS: [f64; 5] = [0.8, 1.25, 2.0, 3.2, 5.0];
/// Highest cut-off, as a share of the log's rate.
const HIGHEST_SHARE: f64 = 0.3;

/// A joint's friction as identified.
#[derive(Debug, Clone)]
pub struct JointFriction {
    /// Terms and coefficients.
    pub terms: Vec<(Term, f64)>,
    /// v of the terms' formulas, rad/s or m/s.
    pub speed: f64,
    /// Standard deviation of the torque on motions not seen.
    pub sigma: f64,
}

/// Everything that is found.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// Inertias of the moving bodies, in the order of the model's, each about its body's frame.
    pub inertias: Vec<Inertia>,
    /// Per measured joint.
    pub friction: Vec<JointFriction>,
    /// Per measured joint, on held-out quarters.
    pub judged: Vec<Judged>,
    /// Per measured joint, on the other logs, by what all of the first ones teach.
    pub judged_on_others: Vec<Judged>,
    /// Base parameters, and what they consist of.
    pub base: Base,
    /// Their values.
    pub base_parameters: Vec<BaseParameter>,
    /// Condition number of the base regressor, columns scaled to unit length.
    pub condition: f64,
    /// lambda: weight of the URDF's inertias.
    pub lambda: f64,
    /// How the motion was smoothed.
    pub smoothing: Smoothing,
    /// How rows were made of it.
    pub sampling: Sampling,
    /// How joints moved.
    pub motion: checks::Motion,
    /// Time of the logs, s, and rate, Hz.
    pub duration: f64,
    /// See `duration`.
    pub rate: f64,
    /// Rows per joint.
    pub rows: usize,
    /// The URDF has no masses: the prior is a guess.
    pub guessed_prior: bool,
    /// The URDF predicts held-out quarters better: its inertias are kept.
    pub urdf_kept: bool,
    /// Results that contradict the URDF: nothing is written from them unless the user accepts it.
    pub contradictions: Vec<String>,
    /// Joints whose torque is poorly explained.
    pub verdicts: Vec<String>,
    /// Remarks for the user.
    pub notes: Vec<String>,
}

/// Identifies a robot from logs, and predicts `others` by it. `progress`: part done, from 0 to 1,
/// and what is done.
///
/// # Errors
/// Every reason why the logs cannot be of this robot in SI units, or do not determine anything.
pub fn calibrate(
    robot: &Robot<'_>,
    logs: &[RobotLog],
    others: &[RobotLog],
    mut progress: impl FnMut(f64, &str),
) -> Result<Calibration, Problems> {
    progress(0.0, "stamps and units");
    logs.iter().chain(others).try_for_each(checks::columns)?;
    let mended = mended(robot, logs)?;
    let logs: Vec<RobotLog> = mended.iter().map(|m| m.log.clone()).collect();
    let others: Vec<RobotLog> = self::mended(robot, others)?
        .into_iter()
        .map(|m| m.log)
        .collect();
    let (logs, others) = (&logs[..], &others[..]);
    let names: Vec<&str> = logs.iter().map(|log| log.name.as_str()).collect();
    let placed = |p: Problem| p.or_at(&names.join(", "), 0);
    let all_placed = |p: Problems| Problems(p.0.into_iter().map(placed).collect());
    let recording = Recording::new(logs, &robot.measured).map_err(placed)?;
    checks::stamps(&recording).map_err(placed)?;
    let motion = checks::motion(robot, &recording).map_err(all_placed)?;
    let friction: Vec<Friction> = motion
        .speed
        .iter()
        .zip(&motion.moves)
        .map(|(v, m)| Friction::new(*v, *m, robot.motor_torque))
        .collect();
    let band = (BAND_TIMES_MOTION * motion.frequency).clamp(BAND.0, BAND.1);
    let cut_off = band.min(0.2 * recording.rate);
    let (smoothings, middle) = smoothings(cut_off, &recording);
    let widest = smoothings
        .iter()
        .map(|s| half_width(s.cut_off, recording.rate))
        .fold(0.0, f64::max);
    let sampling = Sampling::new(cut_off, &recording, widest);
    let mut candidates = Vec::new();
    for (k, smoothing) in smoothings.iter().enumerate() {
        progress(
            0.05 + 0.35 * k as f64 / smoothings.len() as f64,
            "regressors",
        );
        candidates.push(Rows::new(
            robot, &recording, &friction, &sampling, *smoothing,
        ));
    }
    let prior = Prior::new(robot);
    let base = Base::new(robot);
    enough(&candidates[middle], &base).map_err(placed)?;
    let mut notes: Vec<String> = mended.iter().flat_map(|m| m.notes.clone()).collect();
    notes.extend(recording.notes.clone());
    let fitting = alternatives::fitting(robot, &candidates[middle], &prior, &friction);
    let mut refused = contradictions::efforts(robot, &candidates[middle]);
    refused.extend(contradiction(robot, &prior, &fitting, &mended));
    refused.extend(gains::bounds(robot, &candidates[middle], &friction));
    if !prior.guessed && fitting.contradicts() && fitting.other.is_none() {
        refused.extend(gains::factors(robot, &candidates[middle], &friction));
    }
    if fitting.other.is_none() {
        refused.extend(timing::judge(
            robot,
            &candidates[middle],
            &sampling,
            &prior,
            &friction,
        ));
    }
    if robot.accept {
        let accepted = refused.drain(..);
        notes.extend(accepted.map(|p| format!("accepted: {}", p.reason)));
    }
    let masses = !prior.guessed;
    match checks::torques(robot, &candidates[middle], &friction, masses, &fitting) {
        Ok(remarks) => notes.extend(remarks),
        Err(problems) => refused.extend(problems.0),
    }
    if !refused.is_empty() {
        return Err(all_placed(Problems(refused)));
    }
    let unsolved = || {
        placed(Problem::new(
            "the equations have no finite solution",
            "finite numbers of a sensible size",
        ))
    };
    let judged = judge::held_out(&mut candidates, middle, &prior, &friction, |quarter| {
        progress(0.4 + 0.12 * quarter as f64, "held-out quarters");
    });
    let judged = judged.ok_or_else(unsolved)?;
    checks::explained(explained(&judged, &motion.moves)).map_err(placed)?;
    progress(0.9, "all blocks");
    let all: Vec<usize> = (0..BLOCKS).collect();
    let mut fit =
        Fit::new(&mut candidates, middle, &all, &prior, &friction).ok_or_else(unsolved)?;
    let rows = &candidates[fit.candidate];
    let grams = Grams::new(rows, &fit.weights);
    let normals = base::parts_of(&grams, BLOCKS, &fit.weights.sigma);
    let solutions: Option<Vec<_>> = normals
        .iter()
        .map(|normal| fit.base_of(normal, &prior))
        .collect();
    let base_parameters = base.parameters(&prior, &solutions.ok_or_else(unsolved)?);
    let urdf_kept = urdf_better(&judged);
    if !urdf_kept && !prior.guessed {
        let normal = grams.normal(&all, &fit.weights.sigma);
        let held = held::hold(robot, &prior, &normal, &fit.choice, &fit.consistent);
        notes.extend(held.links.iter().map(|link| {
            format!("link `{link}`: these logs do not determine its mass; the URDF's stays")
        }));
        fit.consistent = held.x;
    }
    let solution = if urdf_kept {
        &fit.urdf
    } else {
        &fit.consistent
    };
    let predicted = judge::Predictions {
        urdf: &fit.urdf,
        base: &fit.base,
        identified: solution,
        plain: &judge::plain(&candidates[middle], &all, &friction).ok_or_else(unsolved)?,
        sigma: &fit.sigma,
    };
    let judged_on_others = match others {
        [] => Vec::new(),
        others => {
            let recording = Recording::new(others, &robot.measured).map_err(placed)?;
            checks::stamps(&recording).map_err(placed)?;
            checks::motion(robot, &recording).map_err(all_placed)?;
            let rows = |smoothing: Smoothing| {
                let mut rows = Rows::new(robot, &recording, &friction, &sampling, smoothing);
                rows.set_load(solution);
                rows
            };
            predicted.judge(&rows(smoothings[fit.candidate]), &rows(smoothings[middle]))
        }
    };
    let terms = |joint: usize| JointFriction {
        terms: fit.terms(rows, joint, solution),
        speed: friction[joint].speed,
        sigma: fit.sigma[joint],
    };
    notes.extend(prior.mended.iter().map(|link| {
        format!("link \"{link}\": no body can have the URDF's inertia: the prior is the nearest that one can")
    }));
    progress(1.0, "done");
    let inertias = held::inertias(robot, solution);
    let mut contradictions = if urdf_kept || prior.guessed {
        Vec::new()
    } else {
        let far = contradictions::links(robot, &inertias);
        far.into_iter().map(|(_, reason)| reason).collect()
    };
    let terms: Vec<JointFriction> = (0..robot.measured.len()).map(terms).collect();
    contradictions.extend(payload::changes(
        robot, rows, &sampling, &prior, &fit, &grams,
    ));
    contradictions.extend(gains::driving(robot, &terms, &judged, &motion));
    Ok(Calibration {
        verdicts: contradictions::joints(robot, &judged, &motion),
        contradictions,
        inertias,
        friction: terms,
        condition: base.condition(&normals[0], &fit.choice.keep),
        lambda: fit.choice.lambda,
        smoothing: smoothings[fit.candidate],
        rows: rows.len(),
        duration: recording.duration(),
        rate: recording.rate,
        guessed_prior: prior.guessed,
        judged,
        judged_on_others,
        base,
        base_parameters,
        sampling,
        motion,
        urdf_kept,
        notes,
    })
}

/// Logs after inspection.
fn mended(robot: &Robot<'_>, logs: &[RobotLog]) -> Result<Vec<mend::Mended>, Problems> {
    let each = logs.iter().map(|log| mend::mend(robot, log));
    each.collect()
}

/// Columns that contradict the URDF, with the reading under which they do not.
fn contradiction(
    robot: &Robot<'_>,
    prior: &Prior,
    fitting: &alternatives::Fitting,
    mended: &[mend::Mended],
) -> Option<Problem> {
    if prior.guessed || !fitting.contradicts() {
        return None;
    }
    let constant = mended.iter().flat_map(|m| &m.constant);
    let constant: Vec<&str> = constant.map(|k| robot.name(*k)).collect();
    let left = 100.0 * fitting.left;
    if let Some((_, rest, other)) = &fitting.other {
        let reason = format!(
            "the torques contradict the URDF: links like its own leave {left:.0} % of them unexplained, but {:.0} % if {}",
            100.0 * rest,
            other.join(", and ")
        );
        return Some(Problem::new(
            reason,
            "columns by the URDF's joints, zeros and directions, in rad and N·m; --accept takes them as they stand",
        ));
    }
    (!constant.is_empty()).then(|| {
        let reason = format!(
            "the torques contradict the URDF (links like its own leave {left:.0} % unexplained), and q of `{}` is one number in every row: was it not recorded?",
            constant.join("`, `")
        );
        Problem::new(reason, "the angle of every joint; --accept where the joint was held")
    })
}

/// Ways to smooth that are tried, and the one that first residuals are computed by.
fn smoothings(cut_off: f64, recording: &Recording) -> (Vec<Smoothing>, usize) {
    let mut sources = vec![Source::Angle];
    sources.extend(recording.has_dq.then_some(Source::Velocity));
    sources.extend(recording.has_ddq.then_some(Source::Acceleration));
    let highest = HIGHEST_SHARE * recording.rate;
    let mut cut_offs: Vec<f64> = SMOOTHINGS
        .iter()
        .map(|k| (k * cut_off).min(highest))
        .collect();
    cut_offs.dedup();
    let every = sources.iter().flat_map(|&source| {
        cut_offs
            .iter()
            .map(move |&cut_off| Smoothing { cut_off, source })
    });
    (every.collect(), cut_offs.len().saturating_sub(1).min(2))
}

/// Rows outnumber what they shall determine.
fn enough(rows: &Rows, base: &Base) -> Result<(), Problem> {
    let unknowns = base.independent.len() + friction::ALWAYS * rows.joints;
    if rows.len() * rows.joints >= 4 * unknowns && rows.len() >= 4 * BLOCKS {
        return Ok(());
    }
    let reason = format!(
        "{} rows of {} joints are left for {unknowns} parameters once filtered",
        rows.len(),
        rows.joints
    );
    Err(Problem::new(
        reason,
        "longer logs without gaps: 30 s and more of motion",
    ))
}

/// Share of the torques' squares about their means that is explained, mean of the joints that
/// move: those at rest have little torque to explain, and static friction in it.
fn explained(judged: &[Judged], moves: &[bool]) -> f64 {
    let share = |j: &Judged| {
        let residual = j.residual(judge::Model::Identified);
        (residual / j.deviation().max(1e-12)).powi(2).min(1.0)
    };
    let moving = judged.iter().zip(moves).filter(|(_, moves)| **moves);
    let shares: Vec<f64> = moving.map(|(j, _)| share(j)).collect();
    1.0 - shares.iter().sum::<f64>() / shares.len().max(1) as f64
}

/// True if the URDF predicts held-out quarters better than what was identified, all joints
/// together, each over the URDF's own residual.
fn urdf_better(judged: &[Judged]) -> bool {
    let ratio = |j: &Judged| {
        (j.residual(judge::Model::Identified) / j.residual(judge::Model::Urdf).max(1e-12)).powi(2)
    };
    judged.iter().map(ratio).sum::<f64>() > judged.len() as f64
}
