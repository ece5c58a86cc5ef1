//! Drives from recorded runs: every kind of drive, from the joints whose motion shows it.

use crate::identify::found::{Found, Setting};
use crate::recorded;
use crate::spool::{Column, Spool, each_row};
use identification::drive::recorded::{DriveSample, Gather, knowledge};
use identification::drive::{DriveLog, DriveStretch, identify};
use problem::Problem;
use robot_config::{JointParameters, Robot};
use std::path::{Path, PathBuf};

/// Windows in which a motion counts as fast or slow, s.
const WINDOW_S: f64 = 1.0;
/// Mean frequency of a motion that shows a rotor's inertia, Hz.
const FAST_HZ: f64 = 1.5;
/// Least fast motion of a joint, s, and the time about it that is used with it, s.
const LEAST_FAST_S: f64 = 3.0;
const AROUND_S: f64 = 8.0;
/// Least swing of the joint in a window, rad, of prismatic joints the way that counts as much: others
/// that move shake it by less.
const SWING: f64 = 0.005;
/// A share of the configured value below which a difference is not adopted.
const SHARE: f64 = 0.1;

/// Outcome for a kind of drive.
pub(super) struct DriveResult {
    /// Its name in robot.toml.
    pub(super) name: String,
    /// Joints whose motion shows it.
    pub(super) joints: Vec<String>,
    /// Why some or all of its joints show nothing.
    pub(super) why: Vec<String>,
    pub(super) keys: Vec<Key>,
}

/// A key of a kind of drive.
pub(super) struct Key {
    /// Its address in robot.toml.
    pub(super) address: String,
    pub(super) value: f64,
    /// Half of the 95 % interval.
    pub(super) width: f64,
    pub(super) configured: f64,
    /// Joints that contradict one another, in words.
    pub(super) contradiction: Option<String>,
}

impl Key {
    /// The configured value lies outside of the interval, and far enough from the one found.
    pub(super) fn differs(&self) -> bool {
        let away = (self.value - self.configured).abs();
        self.contradiction.is_none() && away > self.width && away > SHARE * self.configured.abs()
    }
}

/// All kinds of drives of a robot; `progress`: the share that is done, and what.
///
/// # Errors
/// A recording that cannot be read.
pub(super) fn all(
    robot: &Robot,
    paths: &[PathBuf],
    progress: &mut dyn FnMut(f64, &str),
) -> Result<Vec<DriveResult>, Problem> {
    let joints = &robot.parameters.joints;
    let mut runs = Vec::new();
    for (k, path) in paths.iter().enumerate() {
        progress(0.3 * k as f64 / paths.len() as f64, "drives");
        runs.push(read(robot, path)?);
    }
    let mut kinds: Vec<DriveResult> = Vec::new();
    for (k, joint) in joints.iter().enumerate() {
        progress(0.3 + 0.7 * k as f64 / joints.len() as f64, &joint.name);
        let place = kinds.iter().position(|kind| kind.name == joint.drive);
        let place = place.unwrap_or_else(|| {
            kinds.push(DriveResult {
                name: joint.drive.clone(),
                joints: Vec::new(),
                why: Vec::new(),
                keys: Vec::new(),
            });
            kinds.len() - 1
        });
        let kind = &mut kinds[place];
        let (log, seconds) = of_joint(&runs, k, joint)?;
        let shown = (seconds >= LEAST_FAST_S).then(|| one(joint, &log));
        match shown {
            Some(Ok(settings)) => {
                kind.joints.push(joint.name.clone());
                settings.iter().for_each(|s| kind.take(s));
            }
            Some(Err(why)) => kind.why.push(format!("{}: {why}", joint.name)),
            None => kind.why.push(format!(
                "{}: less than {LEAST_FAST_S} s of motion above {FAST_HZ} Hz",
                joint.name
            )),
        }
    }
    Ok(kinds)
}

/// A run as drives' logs take it.
struct DriveRun {
    period: f64,
    /// t.
    t: Column,
    /// By joint.
    samples: Vec<[Column; DriveSample::LEN]>,
}

fn read(robot: &Robot, path: &Path) -> Result<DriveRun, Problem> {
    let mut run = recorded::open_with_inputs(path)?;
    let spool = Spool::new()?;
    let column = || Column::new(&spool);
    let joints = robot.parameters.joints.iter();
    let mut kept = DriveRun {
        period: run.header().period_s,
        t: column(),
        samples: joints.map(|_| std::array::from_fn(|_| column())).collect(),
    };
    let mut begin = None;
    recorded::read_all(path, &mut run, |_, message| {
        let sync = message.at.sync.0;
        let t = recorded::ms_between(*begin.get_or_insert(sync), sync) * 1e-3;
        let since_sync = recorded::ms_between(sync, message.at.now.0) * 1e-3;
        kept.t.push(t)?;
        for (j, columns) in kept.samples.iter_mut().enumerate() {
            let sample = DriveSample::of(&message.record.cycle, j, since_sync);
            let values = sample.map_or([0.0; _], |sample| sample.to_array());
            for (column, value) in columns.iter_mut().zip(values) {
                column.push(value)?;
            }
        }
        Ok(())
    })?;
    Ok(kept)
}

/// A joint's log of all runs: fast motion and what is about it, and the time of fast motion, s.
fn of_joint(
    runs: &[DriveRun],
    j: usize,
    joint: &JointParameters,
) -> Result<(DriveLog, f64), Problem> {
    let mut all: Option<(DriveLog, f64)> = None;
    for run in runs {
        let mut gather = Gather::new(joint, run.period);
        let columns: Vec<&Column> = [&run.t].into_iter().chain(&run.samples[j]).collect();
        each_row(&columns, |_, row| {
            if let [t, sample @ ..] = row
                && let Ok(sample) = <[f64; DriveSample::LEN]>::try_from(sample)
            {
                gather.take(*t, &DriveSample::from_array(sample));
            }
            Ok(())
        })?;
        let (log, seconds) = fast(joint, gather.end());
        match &mut all {
            Some(all) => {
                all.0.stretches.extend(log.stretches);
                all.1 += seconds;
            }
            None => all = Some((log, seconds)),
        }
    }
    let nothing = || Problem::new("no recording", "recordings of the robot");
    all.ok_or_else(nothing)
}

/// The parts of a log with fast motion and some time about each, and the time of fast motion, s.
fn fast(joint: &JointParameters, log: DriveLog) -> (DriveLog, f64) {
    let window = ((WINDOW_S / log.period) as usize).max(1);
    let around = (AROUND_S / WINDOW_S) as usize;
    let swing = joint.kind.threshold(SWING) * joint.encoders.gear_ratio;
    let mut kept = DriveLog {
        period: log.period,
        stretches: Vec::new(),
    };
    let mut seconds = 0.0;
    for stretch in &log.stretches {
        let windows = stretch.theta.chunks_exact(window);
        let marked: Vec<bool> = windows.map(|x| frequency(x, swing) > FAST_HZ).collect();
        seconds += WINDOW_S * marked.iter().filter(|m| **m).count() as f64;
        let near = |k: usize| {
            let (a, b) = (k.saturating_sub(around), (k + around + 1).min(marked.len()));
            marked[a..b].iter().any(|m| *m)
        };
        let mut k = 0;
        while k < marked.len() {
            let end = (k..marked.len())
                .find(|&k| !near(k))
                .unwrap_or(marked.len());
            if end > k {
                let part = |x: &[f64]| x[k * window..end * window].to_vec();
                kept.stretches.push(DriveStretch {
                    sent: part(&stretch.sent),
                    theta: part(&stretch.theta),
                    q: part(&stretch.q),
                    current: part(&stretch.current),
                    torque: part(&stretch.torque),
                });
            }
            k = end + 1;
        }
    }
    (kept, seconds)
}

/// Mean frequency of a motion by the turns of its velocity, Hz for windows of a second; 0 for a swing too small.
fn frequency(theta: &[f64], swing: f64) -> f64 {
    let (mut low, mut high, mut turns) = (f64::MAX, f64::MIN, 0.0);
    let (mut last, mut up) = (theta.first().copied().unwrap_or(0.0), None);
    for &x in theta {
        (low, high) = (low.min(x), high.max(x));
        // A turn counts once the way back is a twentieth of the least swing.
        if (x - last).abs() > 0.05 * swing {
            let now = x > last;
            if up.is_some_and(|up| up != now) {
                turns += 1.0;
            }
            (up, last) = (Some(now), x);
        }
    }
    if high - low < swing {
        0.0
    } else {
        0.5 * turns / WINDOW_S
    }
}

fn one(joint: &JointParameters, log: &DriveLog) -> Result<Vec<Setting>, String> {
    let known = knowledge(joint);
    let drive = identify(&known, log).map_err(|problems| {
        let each = problems.0.iter().map(ToString::to_string);
        each.collect::<Vec<_>>().join("; ")
    })?;
    let found = Found {
        joint,
        known: &known,
        drive: &drive,
        motor: None,
        files: Vec::new(),
    };
    Ok(found.settings())
}

impl DriveResult {
    /// Takes what one joint shows: joints weigh by their intervals, and contradictions are kept.
    fn take(&mut self, setting: &Setting) {
        let dot = if setting.table.is_empty() { "" } else { "." };
        let address = format!("drive.{}.{}{dot}{}", self.name, setting.table, setting.key);
        let Some(key) = self.keys.iter_mut().find(|key| key.address == address) else {
            self.keys.push(Key {
                address,
                value: setting.value,
                width: setting.width,
                configured: setting.configured,
                contradiction: None,
            });
            return;
        };
        let apart = (key.value - setting.value).abs();
        if apart > key.width.hypot(setting.width) && apart > SHARE * setting.value.abs() {
            key.contradiction = Some(format!(
                "joints of this kind show {} and {}",
                crate::identify::found::digits(key.value),
                crate::identify::found::digits(setting.value)
            ));
        }
        let weights = [key.width, setting.width].map(|w| 1.0 / (w * w).max(1e-300));
        let sum = weights[0] + weights[1];
        key.value = (weights[0] * key.value + weights[1] * setting.value) / sum;
        key.width = sum.sqrt().recip();
    }
}
