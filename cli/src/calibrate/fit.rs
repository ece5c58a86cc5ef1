//! The joint file of every joint from recorded runs.

use super::runs::{InContact, RecordedRun, model_sigma};
use super::stretch::Stretch;
use crate::reference::torques::Torques;
use crate::report::{self, Traces};
use crate::spool::{Column, Spool, each_row};
use identification::all::{Fitted, LoadedKnowledge, fit_loaded};
use identification::inputs::{LogKind, inspect_rows};
use identification::joined::{Shift, Zeros, joined};
use identification::log::LogRow;
use identification::record::ReferenceErrors;
use joint_file::{JointFile, JointTable};
use problem::Problem;
use robot_config::{JointParameters, Robot};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::io;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use torqued_client::robot_state::JointKind;

/// Torsion of a usual gear at its rated torque, rad (Z Table I: 1.9e-3; catalogues: 1.3e-3 to 2.4e-3).
const RATED_TORSION: f64 = 1.8e-3;
/// The last part of each run, by which a fit to the rest is judged.
const HELD_OUT: f64 = 0.25;
/// Radius along which a prismatic joint's way is taken for an arc, m: with it forces, ways and stiffnesses of screws are
/// as large as those of gears, as are the thresholds of the configuration.
const RADIUS: f64 = 0.1;
/// Motion without which a joint is not calibrated, rad: one turn of the motor behind a ratio of 100, over which
/// harmonics of the motor show.
const LEAST_MOTION: f64 = 0.063;
/// Difference of zeros between runs that is named: standard deviations, and rated torques.
const SLIPPED_SIGMAS: f64 = 4.0;
const SLIPPED_TORQUE: f64 = 0.1;

/// Rows of joints that are fitted at the same time, at most, where that is more than one joint: a fit takes about 200
/// bytes for each.
const IN_MEMORY: usize = 500_000;

/// A joint's rows of a run: t, theta, q, current and reference torque.
struct Log([Column; 5]);

impl Log {
    /// Columns.
    const Q: usize = 2;
    const TORQUE: usize = 4;

    fn new(spool: &Arc<Spool>) -> Self {
        Self(std::array::from_fn(|_| Column::new(spool)))
    }

    fn push(&mut self, row: &LogRow) -> Result<(), Problem> {
        let values = [row.t, row.theta, row.q, row.current, row.tau_sensor];
        let mut both = self.0.iter_mut().zip(values);
        both.try_for_each(|(column, value)| column.push(value))
    }

    fn of(spool: &Arc<Spool>, rows: &[LogRow]) -> Result<Self, Problem> {
        let mut log = Self::new(spool);
        rows.iter().try_for_each(|row| log.push(row))?;
        Ok(log)
    }

    fn len(&self) -> usize {
        self.0[0].len()
    }

    fn rows(&self) -> Result<Vec<LogRow>, Problem> {
        let mut rows = Vec::with_capacity(self.len());
        each_row(&self.0.each_ref(), |_, row| {
            rows.push(LogRow {
                t: row[0],
                theta: row[1],
                q: row[2],
                current: row[3],
                tau_sensor: row[4],
                feed_forward: f64::NAN,
            });
            Ok(())
        })?;
        Ok(rows)
    }
}

/// A joint's rows of every run, and how well the reference is known.
struct JointLogs {
    runs: Vec<Log>,
    /// Least decile of the reference's sigma, N·m.
    floor: f64,
    /// Share of the torque by which the masses may have it wrong: less where F/T sensors weigh them.
    gain: f64,
}

/// Outcome for a joint.
pub(crate) struct JointResult {
    pub(crate) name: String,
    pub(crate) kind: JointKind,
    pub(crate) outcome: Result<Calibrated, String>,
    /// Coverage of its runs: covered ranges, undetermined constants, oddities.
    pub(crate) inputs: Vec<String>,
}

/// A calibrated joint.
pub(crate) struct Calibrated {
    pub(crate) fitted: Fitted,
    pub(crate) held_out: HeldOut,
    /// Constants that stay at their priors.
    pub(crate) undetermined: Vec<String>,
    /// Its part of the page.
    pub(crate) html: String,
}

/// A fit without the last part of each run, judged on it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct HeldOut {
    /// RMS of fused torque less reference, N·m; of a prismatic joint N.
    pub(crate) rms: f64,
    /// The same over the published sigma.
    pub(crate) rms_of_sigma: f64,
    /// Largest reference of all runs, N·m; of a prismatic joint N.
    pub(crate) largest: f64,
}

/// The joint as its configuration describes it: every prior of the fits.
pub(crate) fn data_sheet(joint: &JointParameters, period: f64) -> JointFile {
    let e = &joint.estimator;
    let radius = (joint.kind == JointKind::Prismatic).then_some(RADIUS);
    let r = radius.unwrap_or(1.0);
    let stiffness = e.compliance.k_fs0 * r * r;
    JointFile::new(JointTable {
        radius,
        w_link: radius.and_then(|r| {
            let periods = r * joint.estimator.kinematic_error.w_link;
            (periods > 0.0).then_some(periods)
        }),
        name: joint.name.clone(),
        gear_ratio: joint.encoders.gear_ratio * r,
        torque_constant: e.wave_generator.torque_constant,
        rotor_inertia: joint.rotor_inertia,
        rated_torque: RATED_TORSION * stiffness,
        link_counts_per_turn: TAU * r / e.link_resolution,
        motor_counts_per_turn: TAU / e.motor_resolution,
        sample_rate: 1.0 / period,
        torque_limit: Some(joint.limits.torque * r),
        max_velocity: joint.encoders.max_velocity / r,
        stiffness: Some(stiffness),
    })
}

impl JointLogs {
    /// Rows of all runs.
    fn len(&self) -> usize {
        self.runs.iter().map(Log::len).sum()
    }
}

/// References of all joints in all runs.
pub(crate) struct References {
    /// By joint.
    logs: Vec<JointLogs>,
}

impl References {
    /// Computes them with centred filters of a window, s.
    ///
    /// # Errors
    /// Contacts from which no torque follows; a window that does not fit.
    pub(crate) fn new(
        runs: &[RecordedRun],
        window: f64,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Self, Problem> {
        let joints = runs.first().map_or(0, |run| run.header.joints.len());
        let spool = Spool::new()?;
        let mut sigmas: Vec<Column> = (0..joints).map(|_| Column::new(&spool)).collect();
        let mut logs: Vec<JointLogs> = (0..joints)
            .map(|_| JointLogs {
                runs: runs.iter().map(|_| Log::new(&spool)).collect(),
                floor: 0.0,
                gain: 0.0,
            })
            .collect();
        let all = runs.iter().map(|run| run.stretches.len()).sum::<usize>();
        let mut done = 0;
        for (k, run) in runs.iter().enumerate() {
            for stretch in &run.stretches {
                let contact = InContact {
                    robot: &run.robot,
                    contact_set: stretch.contact_set,
                };
                let torques = Torques::new(&contact, &stretch.signals, window)?;
                for (j, (log, sigmas)) in logs.iter_mut().zip(&mut sigmas).enumerate() {
                    let kind = run.robot.parameters.joints[j].kind;
                    let log = &mut log.runs[k];
                    take(stretch, &torques, (j, kind), log, sigmas)?;
                }
                done += 1;
                progress(done as f64 / all.max(1) as f64);
            }
        }
        let most = runs.first().map_or(0.0, |run| model_sigma(&run.robot));
        for (log, sigmas) in logs.iter_mut().zip(&sigmas) {
            let mut sigmas = sigmas.read()?;
            log.gain = gain(log, &sigmas)?.min(most);
            let place = sigmas.len() / 10;
            if place < sigmas.len() {
                log.floor = *sigmas.select_nth_unstable_by(place, f64::total_cmp).1;
            }
        }
        Ok(Self { logs })
    }
}

/// Takes a joint's rows of a stretch, and the sigmas of their references.
fn take(
    stretch: &Stretch,
    torques: &Torques,
    (joint, kind): (usize, JointKind),
    log: &mut Log,
    sigmas: &mut Column,
) -> Result<(), Problem> {
    let r = match kind {
        JointKind::Prismatic => RADIUS,
        JointKind::Revolute => 1.0,
    };
    let (signals, drive) = (&stretch.signals, &stretch.drives[joint]);
    let [torque, sigma] = torques.of(joint)?;
    let columns = [
        &signals.t,
        &drive.theta,
        &signals.angles[joint],
        &drive.current,
        &drive.used,
    ];
    let rows = torques.rows();
    each_row(&columns, |i, row| {
        let &[t, theta, q, current, used] = row else {
            return Ok(());
        };
        if !rows.contains(&i) || used == 0.0 {
            return Ok(());
        }
        sigmas.push(sigma[i] * r)?;
        log.push(&LogRow {
            t,
            theta,
            q: q / r,
            current,
            tau_sensor: torque[i] * r,
            feed_forward: f64::NAN,
        })
    })
}

/// Growth of a reference's sigma with its torque, 1: the regression of one's square on the other's. What the
/// filters removed goes with the motion instead.
fn gain(log: &JointLogs, sigmas: &[f64]) -> Result<f64, Problem> {
    let torques = log.runs.iter().map(|run| run.0[Log::TORQUE].read());
    let torques = torques.collect::<Result<Vec<_>, _>>()?;
    let torques = torques.iter().flatten().map(|tau| tau.powi(2));
    let pairs = || {
        torques
            .clone()
            .zip(sigmas.iter().map(|sigma| sigma * sigma))
    };
    let count = sigmas.len().max(1) as f64;
    let mean = pairs().fold([0.0; 2], |[a, b], (x, y)| [a + x / count, b + y / count]);
    let sums = pairs().fold([0.0; 2], |[xx, xy], (x, y)| {
        let x = x - mean[0];
        [xx + x * x, xy + x * (y - mean[1])]
    });
    Ok((sums[1] / sums[0].max(f64::MIN_POSITIVE)).max(0.0).sqrt())
}

/// Fits all joints of a robot, several at a time; `progress`: the share that is done, and what.
pub(crate) fn all(
    robot: &Robot,
    references: &References,
    names: &[String],
    progress: &(dyn Fn(f64, &str) + Sync),
) -> Vec<JointResult> {
    let joints = &robot.parameters.joints;
    let longest = references
        .logs
        .iter()
        .map(JointLogs::len)
        .max()
        .unwrap_or(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = threads.min(IN_MEMORY / longest.max(1)).max(1);
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let results: Mutex<Vec<(usize, JointResult)>> = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..threads.min(joints.len()) {
            scope.spawn(|| {
                loop {
                    let j = next.fetch_add(1, Ordering::Relaxed);
                    let (Some(joint), Some(logs)) = (joints.get(j), references.logs.get(j)) else {
                        return;
                    };
                    let result = one(robot, joint, logs, names);
                    let count = 1 + done.fetch_add(1, Ordering::Relaxed);
                    progress(count as f64 / joints.len() as f64, &joint.name);
                    if let Ok(mut results) = results.lock() {
                        results.push((j, result));
                    }
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_default();
    results.sort_by_key(|(j, _)| *j);
    results.into_iter().map(|(_, result)| result).collect()
}

fn one(robot: &Robot, joint: &JointParameters, logs: &JointLogs, names: &[String]) -> JointResult {
    let sheet = data_sheet(joint, robot.parameters.timing.sample_period);
    let mut inputs = Vec::new();
    let units = sheet.joint.radius.map(|radius| {
        format!("prismatic: angles here are its ways over {radius} m, torques its forces times {radius} m")
    });
    inputs.extend(units.clone());
    let outcome = match joint.has_link_encoder {
        true => calibrated(&sheet, logs, names, &mut inputs),
        // Its recorded torsion is the one that the configuration explains.
        false => Err(vec![
            "has no link-side encoder: no torsion is measured".to_owned(),
        ]),
    };
    JointResult {
        name: joint.name.clone(),
        kind: joint.kind,
        outcome: outcome.map_err(|mut problems| {
            problems.extend(units);
            problems.join("; ")
        }),
        inputs,
    }
}

fn calibrated(
    sheet: &JointFile,
    logs: &JointLogs,
    names: &[String],
    inputs: &mut Vec<String>,
) -> Result<Calibrated, Vec<String>> {
    let one = |p: Problem| vec![p.to_string()];
    // What is fitted to waits on the disk: of a long run a memory holds few copies.
    let spool = Spool::new().map_err(one)?;
    let (mut undetermined, mut used): (Option<Vec<String>>, Vec<Log>) = (None, Vec::new());
    let mut refused = Vec::new();
    for (name, log) in names.iter().zip(&logs.runs) {
        let rows = log.rows().map_err(one)?;
        match inspect_rows(sheet, rows, LogKind::Recorded) {
            Ok(inspection) => {
                let lines = inspection.lines();
                inputs.extend(lines.into_iter().map(|line| format!("{name}: {line}")));
                let open = inspection.excitation.iter().flat_map(|e| &e.constants);
                let open: Vec<String> = open
                    .filter(|c| !c.determined())
                    .map(|c| c.quantity.name().to_owned())
                    .collect();
                undetermined = Some(match undetermined {
                    None => open,
                    Some(before) => before.into_iter().filter(|c| open.contains(c)).collect(),
                });
                used.push(Log::of(&spool, &inspection.mended).map_err(one)?);
            }
            Err(problems) => {
                refused.extend(problems.0.iter().map(|p| format!("{name}: {p}")));
            }
        }
    }
    if used.is_empty() {
        return Err(refused);
    }
    inputs.extend(refused.into_iter().map(|why| format!("not used: {why}")));
    let way = |angle: f64| match sheet.joint.radius {
        Some(radius) => format!("{:.3} mm", 1e3 * radius * angle),
        None => format!("{angle:.5} rad"),
    };
    let [low, high] = range(&used, Log::Q).map_err(one)?;
    if high - low < LEAST_MOTION {
        return Err(vec![format!(
            "never moves (it spans {}): zero and kinematic error are not determined; allowed: motion over at least {}",
            way(high - low),
            way(LEAST_MOTION)
        )]);
    }
    let (_, shifts) = whole(sheet, &used).map_err(one)?;
    let n = sheet.joint.gear_ratio;
    for (shift, sigma) in &shifts {
        let torque = (shift / n).abs() * sheet.joint.stiffness.unwrap_or(0.0);
        let slipped = torque > SLIPPED_TORQUE * sheet.joint.rated_torque;
        if slipped && shift.abs() > SLIPPED_SIGMAS * sigma {
            return Err(vec![format!(
                "the encoders' zeros differ between runs by {} of the link: an encoder has slipped or was set anew; \
                 allowed: runs with one zero",
                way(shift / n)
            )]);
        }
    }
    let known = LoadedKnowledge {
        reference: ReferenceErrors {
            gain: logs.gain,
            offset: logs.floor,
        },
        zeros_stay: true,
    };
    let held_out = held_out(sheet, &used, known).map_err(one)?;
    let (rows, _) = whole(sheet, &used).map_err(one)?;
    let fitted = fit_loaded(sheet, &rows, known, &mut |_, _| ()).map_err(one)?;
    readable(&fitted, &sheet.joint.name).map_err(one)?;
    let traces = Traces::run(&fitted.joint, &rows).map_err(one)?;
    let html = report::summary(&traces).map_err(one)?;
    Ok(Calibrated {
        fitted,
        held_out,
        undetermined: undetermined.unwrap_or_default(),
        html,
    })
}

/// The rows of all runs one after another, and the shifts between their zeros.
fn whole(sheet: &JointFile, runs: &[Log]) -> Result<(Vec<LogRow>, Vec<Shift>), Problem> {
    let logs = runs.iter().map(Log::rows).collect::<Result<_, _>>()?;
    joined(sheet, logs, Zeros::Common)
}

/// Smallest and largest number in a column of runs.
fn range(runs: &[Log], column: usize) -> Result<[f64; 2], Problem> {
    let mut range = [f64::MAX, f64::MIN];
    for run in runs {
        let values = run.0[column].read()?;
        range = (values.iter()).fold(range, |[a, b], x| [a.min(*x), b.max(*x)]);
    }
    Ok(range)
}

/// Refuses a joint file that the daemon would refuse.
fn readable(fitted: &Fitted, name: &str) -> Result<(), Problem> {
    let files: BTreeMap<String, String> = fitted.files(name)?.into_iter().collect();
    let missing = || io::Error::new(io::ErrorKind::NotFound, "not written");
    let own = format!("{name}.toml");
    let text = files.get(&own).ok_or_else(missing);
    let text = text.map_err(|e| Problem::unreadable(&own, &e))?;
    let read = |path: &str| files.get(path).cloned().ok_or_else(missing);
    let parsed = JointFile::parse(text, &own, &read);
    let why = |p: Problem| {
        Problem::new(
            format!("the fit has no usable result: {p}"),
            "other recordings",
        )
    };
    parsed.map(|_| ()).map_err(why)
}

/// Fits without the last part of each run and judges on it.
fn held_out(sheet: &JointFile, runs: &[Log], known: LoadedKnowledge) -> Result<HeldOut, Problem> {
    let [low, high] = range(runs, Log::TORQUE)?;
    let largest = low.abs().max(high.abs());
    let part = |judged: bool| {
        let logs = runs.iter().map(|run| {
            let mut rows = run.rows()?;
            let kept = ((1.0 - HELD_OUT) * rows.len() as f64) as usize;
            let rest = rows.split_off(kept);
            Ok(if judged { rest } else { rows })
        });
        let logs = logs.collect::<Result<_, Problem>>()?;
        Ok::<_, Problem>(joined(sheet, logs, Zeros::Common)?.0)
    };
    let joint = fit_loaded(sheet, &part(false)?, known, &mut |_, _| ())?.joint;
    let judged = part(true)?;
    let figures = Traces::run(&joint, &judged)?.fused();
    let r = sheet.joint.radius.unwrap_or(1.0);
    Ok(figures.map_or(HeldOut::default(), |figures| HeldOut {
        rms: figures.rms / r,
        rms_of_sigma: figures.normalised,
        largest: largest / r,
    }))
}
