//! Judgement on the real arm: trained on one log, judged on another, and by contiguous halves.
//!
//! Every method is tared: the reference of the first 50 samples is known to it. The plain methods are the ones
//! that a user would try: the current as it is, and regressions on current or torsion with speed
//! and direction, fitted to the training log.

use crate::arm::{JointLog, PERIOD_S, joint_file, read};
use crate::fit::fit;
use crate::score::TARE_SIGMA;
use estimators::joint::JointTorqueEstimator;
use identification::least_squares::Batch;
use identification::log::LogRow;
use problem::Problem;
use std::path::Path;

/// Samples at the start of a judged log whose torque is known.
pub const TARED: usize = 50;
/// Least error that counts as a difference, of the rated torque.
const FLOOR: f64 = 0.01;
/// Least standard deviation of the reference, of the rated torque, for a case to be informative.
const INFORMATIVE: f64 = 0.02;

/// One method on one case.
#[derive(Debug, Clone)]
pub struct Method {
    /// Its name.
    pub name: &'static str,
    /// RMS error, N·m.
    pub rms: f64,
    /// RMS of error over sigma; NaN if the method has no sigma.
    pub ratio: f64,
}

/// One training log and one judged log of one joint.
#[derive(Debug, Clone)]
pub struct RealCase {
    /// Joint, from 1.
    pub joint: usize,
    /// Training and judged log.
    pub logs: String,
    /// Whether the reference varies enough to judge anything but the tare.
    pub informative: bool,
    /// Rated torque, N·m.
    pub rated: f64,
    /// All methods.
    pub methods: Vec<Method>,
    /// Report of the fit.
    pub report: Vec<String>,
}

impl RealCase {
    /// RMS error of a method, N·m.
    #[must_use]
    pub fn rms(&self, name: &str) -> f64 {
        let found = self.methods.iter().find(|m| m.name == name);
        found.map_or(f64::NAN, |m| m.rms)
    }

    /// RMS of error over sigma of a method; NaN if it has no sigma.
    #[must_use]
    pub fn ratio(&self, name: &str) -> f64 {
        let found = self.methods.iter().find(|m| m.name == name);
        found.map_or(f64::NAN, |m| m.ratio)
    }

    /// Error of the fused torque over the least of the plain methods without feed-forward, both at least 1 %
    /// of the rated torque.
    #[must_use]
    pub fn over_best(&self) -> f64 {
        let plain = ["raw current", "current regression", "torsion regression"];
        let floor = FLOOR * self.rated;
        let best = plain
            .iter()
            .map(|n| self.rms(n))
            .fold(f64::INFINITY, f64::min);
        self.rms(FUSED).max(floor) / best.max(floor)
    }

    /// Error of the fused torque with the feed-forward over that of the regression that has it, both at least
    /// 1 % of the rated torque.
    #[must_use]
    pub fn with_feed_forward(&self) -> f64 {
        let floor = FLOOR * self.rated;
        let [fused, regression] =
            [WITH_FEED_FORWARD, REGRESSION].map(|name| self.rms(name).max(floor));
        fused / regression
    }
}

/// The fused torque, and that with the feed-forward as a source.
pub const FUSED: &str = "fused";
/// The plain regression on torsion and feed-forward.
pub const REGRESSION: &str = "regression with feed-forward";
/// The feed-forward alone.
pub const FEED_FORWARD: &str = "feed-forward";
/// The fused torque with it.
pub const WITH_FEED_FORWARD: &str = "fused with feed-forward";

/// Columns of a regression.
type Columns = fn(&LogRow, f64, f64) -> Vec<f64>;

fn speed(log: &JointLog, i: usize) -> f64 {
    let half = 3;
    let rows = &log.rows;
    let (a, b) = (i.saturating_sub(half), (i + half).min(rows.len() - 1));
    (rows[b].q - rows[a].q) / ((b - a) as f64 * PERIOD_S)
}

fn regression(train: &JointLog, judged: &JointLog, columns: Columns) -> Option<Vec<f64>> {
    let row =
        |log: &JointLog, i: usize| columns(&log.rows[i], speed(log, i), log.rows[i].feed_forward);
    let mut batch = Batch::new(row(train, 0).len());
    for i in 0..train.rows.len() {
        batch.add(&row(train, i), train.rows[i].tau_sensor);
    }
    let x = batch.solve(1e-6)?.x;
    let value = |i: usize| {
        row(judged, i)
            .iter()
            .zip(x.iter())
            .map(|(a, x)| a * x)
            .sum()
    };
    Some((0..judged.rows.len()).map(value).collect())
}

/// Root mean square error after the tare, of the samples behind it.
fn tared(values: &[f64], judged: &JointLog) -> f64 {
    let errors: Vec<f64> = (values.iter().zip(&judged.rows))
        .map(|(v, row)| v - row.tau_sensor)
        .collect();
    let zero = errors.iter().take(TARED).sum::<f64>() / TARED as f64;
    let rest = errors.iter().skip(TARED);
    let square: f64 = rest.map(|e| (e - zero).powi(2)).sum();
    (square / (errors.len() - TARED) as f64).sqrt()
}

const RATIO: [f64; crate::arm::JOINTS] = crate::arm::RATIOS;

fn plain(joint: usize, train: &JointLog, judged: &JointLog) -> Vec<Method> {
    let raw: Vec<f64> = judged.rows.iter().map(|row| row.current).collect();
    let mut methods = vec![Method {
        name: "raw current",
        rms: tared(&raw, judged),
        ratio: f64::NAN,
    }];
    fn direction(v: f64) -> f64 {
        (v / 0.02).tanh()
    }
    let torsion: Columns = match RATIO[joint] as u32 {
        121 => |r, v, _| vec![1e3 * (r.theta / 121.0 - r.q), v, direction(v), 1.0],
        _ => |r, v, _| vec![1e3 * (r.theta / 101.0 - r.q), v, direction(v), 1.0],
    };
    let with: Columns = match RATIO[joint] as u32 {
        121 => |r, v, ff| vec![1e3 * (r.theta / 121.0 - r.q), v, direction(v), 1.0, ff],
        _ => |r, v, ff| vec![1e3 * (r.theta / 101.0 - r.q), v, direction(v), 1.0, ff],
    };
    let current: Columns = |r, v, _| vec![r.current, v, direction(v), 1.0];
    let regressions = [
        ("current regression", current),
        ("torsion regression", torsion),
        (REGRESSION, with),
    ];
    for (name, columns) in regressions {
        let rms = regression(train, judged, columns).map_or(f64::NAN, |v| tared(&v, judged));
        methods.push(Method {
            name,
            rms,
            ratio: f64::NAN,
        });
    }
    methods
}

/// The fused torque and its sources, tared by the tool's own tare; sources without a name are left out.
fn estimated(
    file: &joint_file::JointFile,
    judged: &JointLog,
    names: [&'static str; 4],
) -> Result<Vec<Method>, Problem> {
    let mut set = file.estimators()?;
    let mut front_end = file.front_end()?;
    let mut last = None;
    let place = |name: &str| set.names().iter().position(|n| n == name);
    let places = [place("hysteresis"), place("current"), place("feed_forward")];
    let mut sums = [(0.0, 0.0); 4];
    for (i, row) in judged.rows.iter().enumerate() {
        front_end.bridge(last.replace(row.t), row.t);
        let fused = set.update(&row.sample(&mut front_end));
        if i < TARED {
            set.tare_to(row.tau_sensor, TARE_SIGMA * file.joint.rated_torque);
            continue;
        }
        let sources = places.map(|p| p.and_then(|p| set.estimates().get(p)));
        let all = [Some(&fused), sources[0], sources[1], sources[2]];
        for (sum, e) in sums.iter_mut().zip(all) {
            let error = e.map_or(f64::NAN, |e| e.tau - row.tau_sensor);
            sum.0 += error * error;
            sum.1 += e.map_or(f64::NAN, |e| (error / e.sigma.max(1e-9)).powi(2));
        }
    }
    let count = judged.rows.len().saturating_sub(TARED) as f64;
    let methods = names
        .into_iter()
        .zip(sums)
        .filter(|(name, _)| !name.is_empty())
        .map(|(name, (square, relative))| Method {
            name,
            rms: (square / count).sqrt(),
            ratio: (relative / count).sqrt(),
        });
    Ok(methods.collect())
}

fn case(
    joint: usize,
    logs: String,
    train: &JointLog,
    judged: &JointLog,
) -> Result<RealCase, Problem> {
    let file = joint_file(joint)?;
    let mut methods = plain(joint, train, judged);
    let mut report = Vec::new();
    let without = train.without_feed_forward();
    for (train, name) in [(&without, FUSED), (train, WITH_FEED_FORWARD)] {
        match fit(&file, None, &train.rows) {
            Ok((fitted, notes)) => {
                report.extend(notes);
                let sources = match name {
                    FUSED => [name, "torsion", "current", ""],
                    _ => [name, "", "", FEED_FORWARD],
                };
                methods.extend(estimated(&fitted, judged, sources)?);
            }
            Err(e) => report.push(e.to_string()),
        }
    }
    let tau = judged.rows.iter().map(|row| row.tau_sensor);
    let mean = tau.clone().sum::<f64>() / judged.rows.len() as f64;
    let variance = tau.map(|tau| (tau - mean).powi(2)).sum::<f64>() / judged.rows.len() as f64;
    let rated = file.joint.rated_torque;
    Ok(RealCase {
        joint: joint + 1,
        logs,
        informative: variance.sqrt() > INFORMATIVE * rated,
        rated,
        methods,
        report,
    })
}

/// The logs of a folder, with their names.
fn logs(folder: &Path) -> Result<Vec<(String, Vec<JointLog>)>, Problem> {
    let of = |e: std::io::Error| Problem::unreadable(folder.display(), &e);
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .map_err(of)?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter_map(|name| Some(name.strip_suffix(".csv")?.to_owned()))
        .collect();
    names.sort();
    let log = |name: String| Ok((name.clone(), read(&folder.join(format!("{name}.csv")))?));
    names.into_iter().map(log).collect()
}

/// Judges the logs `sweep.csv` and `jog_joints.csv` (and any others) of a folder: every directed pair on
/// joints 1, 2, 3, 5, and the halves of the sweep on joints 2, 3, 5.
///
/// # Errors
/// Logs that cannot be read.
pub fn judge(folder: &Path, progress: &dyn Fn(&str)) -> Result<Vec<RealCase>, Problem> {
    let logs = logs(folder)?;
    let mut cases = Vec::new();
    for (a, train) in &logs {
        for (b, judged) in logs.iter().filter(|(b, _)| b != a) {
            for joint in [0, 1, 2, 4] {
                let what = format!("{a} to {b}");
                progress(&format!("{what}, joint {}", joint + 1));
                cases.push(case(joint, what, &train[joint], &judged[joint])?);
            }
        }
        if a != "sweep" {
            continue;
        }
        for joint in [1, 2, 4] {
            let all = train[joint].rows.len();
            let halves = [
                train[joint].part(0, all / 2),
                train[joint].part(all / 2, all),
            ];
            for (k, what) in ["first half to second", "second half to first"]
                .iter()
                .enumerate()
            {
                progress(&format!("{what}, joint {}", joint + 1));
                cases.push(case(joint, (*what).to_owned(), &halves[k], &halves[1 - k])?);
            }
        }
    }
    Ok(cases)
}

/// Splits that [`judge`] leaves out: of each log every half judged after the other and every third after each of
/// the others, all joints; pairs of logs on joints 4 and 6. Each with the name of its kind.
///
/// # Errors
/// Logs that cannot be read.
pub fn splits(
    folder: &Path,
    progress: &dyn Fn(&str),
) -> Result<Vec<(&'static str, RealCase)>, Problem> {
    let logs = logs(folder)?;
    let mut cases = Vec::new();
    for (a, train) in &logs {
        for (parts, kind) in [(2, "halves"), (3, "thirds")] {
            for (joint, log) in train.iter().enumerate() {
                // The halves of these joints of the sweep are a part of `judge`.
                if parts == 2 && a == "sweep" && [1, 2, 4].contains(&joint) {
                    continue;
                }
                let all = log.rows.len();
                let part = |k: usize| log.part(k * all / parts, (k + 1) * all / parts);
                let pairs = (0..parts).flat_map(|x| (0..parts).map(move |y| (x, y)));
                for (x, y) in pairs.filter(|(x, y)| x != y) {
                    let what = format!("{a}, {kind}: {} to {}", x + 1, y + 1);
                    progress(&format!("{what}, joint {}", joint + 1));
                    cases.push((kind, case(joint, what, &part(x), &part(y))?));
                }
            }
        }
        for (b, judged) in logs.iter().filter(|(b, _)| b != a) {
            for joint in [3, 5] {
                let what = format!("{a} to {b}");
                let one = case(joint, what, &train[joint], &judged[joint])?;
                cases.push(("joints 4 and 6, log to log", one));
            }
        }
    }
    Ok(cases)
}
