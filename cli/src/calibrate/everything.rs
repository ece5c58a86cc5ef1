//! `torquectl calibrate RUN.mcap... -o DIR`: everything of a robot that its recordings show.

use super::adopt::text_hash;
use super::drives::{self, DriveResult};
use super::fit::{self, Calibrated, JointResult, References};
use super::identity::Identity;
use super::runs::{self, RecordedRun};
use super::sensors::{self, Sensor, SensorResult};
use super::shown;
use super::store::{
    Calibration, DriveEntry, JointEntry, KeyEntry, Manifest, RunEntry, SensorEntry, UrdfEntry,
};
use crate::BAD_INPUT;
use crate::output::finish;
use crate::reference::robot::Payload;
use clap::{Args, ValueEnum};
use dynamics::{Inertia, urdf_with_inertias};
use identification::drive::Value;
use indicatif::{ProgressBar, ProgressStyle};
use jiff::Timestamp;
use problem::{Allowed, Problem, Problems};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use torqued_client::robot_state::JointKind;

/// Exit code where some parts could not be calibrated.
const INCOMPLETE: u8 = 1;
/// Name of the corrected URDF.
const URDF: &str = "robot.urdf";
/// Standard deviations of half a 95 % interval.
const HALF_WIDTH: f64 = 1.96;

pub(super) const HELP: &str = "\
The recordings are the daemon's own (torquectl record, torqued run --record); they carry the robot's
configuration, and all must be of one robot. What they show is calibrated, in this order:
  ft      F/T sensors: offset, misalignment, mass and centre of mass beyond, where nothing touches that
  joints  encoders, gear, friction, current, fusion of every joint; no torque sensor is needed: reference
          torques come from F/T sensors, IMU and the rigid-body model by centred filters, or from gravity
          and the model alone, and are no better than the masses: known payloads are to be named
  drives  stiffness, damping, dead zone, rotor inertia, friction of every kind of drive whose joints have
          made fast motions (torquectl identify drive shows one in detail)

What to record (docs/bring-up.md): slow motion of every joint both ways over the range that it works in,
some faster motion, and the loads that matter later: for legs in a harness and standing. Two minutes each.
What the recordings do not determine is named and stays at the configuration's value, with its width. A
quarter of each recording is held out from a first fit, which is judged on it.
Columns of the recordings lie meanwhile in a file without a name in the folder TMPDIR, or /var/tmp.

The folder DIR holds a joint file for each joint, the URDF with the inertias found, and calibration.toml:
dates and hashes of the recordings, robot, figures, and every key that a commit would set. It is written at
the end, as a whole. `torquectl calibrate commit` adopts it.

Examples:
  torquectl calibrate hanging.mcap standing.mcap -o calibrated --report calibrated.html
  torquectl calibrate sweeps.mcap --payload flange=3.5,0,0,0.08 -o calibrated --json
  torquectl calibrate poses.mcap --only ft --untouched -o sensors
  torquectl calibrate payload run.mcap --link flange
  torquectl calibrate status config/leg/robot.toml
  torquectl calibrate diff config/leg/robot.toml calibrated
  torquectl calibrate commit config/leg/robot.toml calibrated
  torquectl calibrate rollback config/leg/robot.toml
  torquectl calibrate inertia --help

Exit codes:
  0  everything that was asked for is calibrated
  1  written, but some joints or sensors could not be calibrated: they are named
  2  bad input: not recordings of one robot, a folder that is there already or cannot be written";

/// A part of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    Ft,
    Joints,
    Drives,
}

/// Inputs and outputs of a calibration from recordings.
#[derive(Args)]
pub(crate) struct RunsArguments {
    /// The recorded runs
    #[arg(required = true, value_name = "RUN.mcap")]
    runs: Vec<PathBuf>,
    /// The folder to write
    #[arg(short, long, required = true, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only these parts
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Part::Ft, Part::Joints, Part::Drives])]
    only: Vec<Part>,
    /// The configuration that is to be calibrated; its joints and sensors must be those of the recordings
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Known payload: LINK=kg[,x,y,z], centre of mass in the link's frame, m
    #[arg(long)]
    payload: Vec<Payload>,
    /// Nothing touched what is beyond the F/T sensors, whatever the contact sets of the recordings say
    #[arg(long)]
    untouched: bool,
    /// Standard deviation of the model's masses, per cent [default: the configuration's model_sigma_per_cent, or
    /// 1 where that is 0]
    #[arg(long, value_name = "PER_CENT", value_parser = per_cent)]
    model_sigma: Option<f64>,
    /// Window of the centred filters, ms
    #[arg(long, default_value_t = 20.0)]
    window_ms: f64,
    /// Write a page of figures of everything
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

fn per_cent(text: &str) -> Result<f64, Problem> {
    const ALLOWED: Allowed = Allowed::Within(0.01, 50.0);
    let share = text.parse().ok().filter(|share| ALLOWED.admits(*share));
    share.ok_or_else(|| Problem::new("not a share of the masses", ALLOWED.to_string()))
}

pub(crate) fn run(arguments: &RunsArguments) -> ExitCode {
    match calibrate(arguments) {
        Ok((text, complete)) => match (finish(&text), complete) {
            (ExitCode::SUCCESS, false) => ExitCode::from(INCOMPLETE),
            (code, _) => code,
        },
        Err(problems) => {
            eprintln!("{problems}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// Everything that was found.
pub(super) struct Results {
    pub(super) joints: Vec<JointResult>,
    pub(super) sensors: Vec<SensorResult>,
    pub(super) drives: Vec<DriveResult>,
}

impl Results {
    /// Why nothing at all was found; none if something was.
    fn nothing(&self) -> Option<Problems> {
        let joints = self.joints.iter().all(|joint| joint.outcome.is_err());
        let sensors = self.sensors.iter().all(|sensor| sensor.outcome.is_err());
        let drives = self.drives.iter().all(|drive| drive.keys.is_empty());
        if !(joints && sensors && drives) {
            return None;
        }
        let each = self.joints.iter().map(JointResult::problem);
        let sensors = self.sensors.iter();
        let each = each.chain(sensors.filter_map(|s| s.outcome.as_ref().err().cloned()));
        let why = self.drives.iter().flat_map(|d| d.why.iter());
        let each = each.chain(why.map(|why| Problem::new(why.as_str(), "").of("drive")));
        Some(Problems(each.collect()))
    }

    fn complete(&self) -> bool {
        self.joints.iter().all(|joint| joint.outcome.is_ok())
            && self.sensors.iter().all(|sensor| sensor.outcome.is_ok())
    }
}

fn calibrate(arguments: &RunsArguments) -> Result<(String, bool), Problems> {
    let out = arguments.out.as_deref().unwrap_or(Path::new(""));
    // Before minutes of work that would be lost to it.
    if out.exists() {
        let shown = out.display().to_string();
        let problem = Problem::new("is there already", "a folder that is not there");
        return Err(problem.at(shown, 0).into());
    }
    let bar = bar();
    let mut runs = Vec::new();
    for path in &arguments.runs {
        bar.set_message(format!("reading {}", path.display()));
        let mut run = RecordedRun::read(path, &arguments.payload)?;
        if let Some(share) = arguments.model_sigma {
            run.robot.parameters.whole_body.sigma_model = 1e-2 * share;
        }
        runs.push(run);
        bar.tick();
    }
    let identity = one_robot(
        &runs.iter().collect::<Vec<_>>(),
        arguments.config.as_deref(),
    )?;
    for note in runs
        .iter()
        .flat_map(|r| r.notes.iter().map(move |n| (r, n)))
    {
        bar.suspend(|| eprintln!("{}: {}", note.0.file, note.1));
    }
    let asked = |part: Part| arguments.only.contains(&part);
    let mut results = Results {
        joints: Vec::new(),
        sensors: Vec::new(),
        drives: Vec::new(),
    };
    let mut urdf = None;
    if asked(Part::Ft) {
        bar.set_message("F/T sensors");
        let signs = identity.signs(&runs[0].robot);
        results.sensors = sensors::all(&runs, &signs, arguments.untouched);
        urdf = corrected(&runs[0], &results.sensors)?;
        correct(&mut runs, &results.sensors, urdf.as_deref(), arguments)?;
    }
    if asked(Part::Joints) {
        bar.set_message("reference torques");
        let references = References::new(&runs, 1e-3 * arguments.window_ms, &mut |share| {
            bar.set_position((200.0 * share) as u64);
        })?;
        let names: Vec<String> = runs.iter().map(|run| run.file.clone()).collect();
        results.joints = fit::all(&runs[0].robot, &references, &names, &|share, joint| {
            bar.set_position((200.0 + 600.0 * share) as u64);
            bar.set_message(joint.to_owned());
        });
    }
    if asked(Part::Drives) {
        let mut show = |share: f64, what: &str| {
            bar.set_position((800.0 + 200.0 * share) as u64);
            bar.set_message(what.to_owned());
        };
        results.drives = drives::all(&runs[0].robot, &arguments.runs, &mut show)?;
    }
    bar.finish_and_clear();
    if let Some(problems) = results.nothing() {
        return Err(problems);
    }
    let calibration = assemble(&runs, &identity, &results, urdf)?;
    if let Some(path) = &arguments.report {
        shown::write_page(path, &calibration.manifest, &results.joints)?;
    }
    calibration.write(out)?;
    let manifest = &calibration.manifest;
    let text = if arguments.json {
        format!("{}\n", shown::object(manifest, &results.joints, out))
    } else {
        shown::text(manifest, out)
    };
    Ok((text, results.complete()))
}

/// The URDF with the inertias found; none where there are none, or none that it can have.
fn corrected(run: &RecordedRun, sensors: &[SensorResult]) -> Result<Option<String>, Problems> {
    let found = sensors.iter().filter_map(|s| s.outcome.as_ref().ok());
    let found: Vec<(String, Inertia)> = found
        .filter_map(|s| Some((s.link.clone(), s.inertia?)))
        .collect();
    if found.is_empty() {
        return Ok(None);
    }
    let text = runs::urdf(&run.header, &run.robot);
    let text = urdf_with_inertias(text, &run.robot.parameters.urdf_path, &found)?;
    runs::robot(&run.header, &[], Some(&text))?;
    Ok(Some(text))
}

/// Takes what the F/T sensors showed into the runs that joints are calibrated from.
fn correct(
    runs: &mut [RecordedRun],
    sensors: &[SensorResult],
    urdf: Option<&str>,
    arguments: &RunsArguments,
) -> Result<(), Problems> {
    for run in runs {
        if urdf.is_some() {
            let sigma = run.robot.parameters.whole_body.sigma_model;
            run.robot = runs::robot(&run.header, &arguments.payload, urdf)?;
            run.robot.parameters.whole_body.sigma_model = sigma;
        }
        for (s, sensor) in sensors.iter().enumerate() {
            let Ok(Sensor { published, .. }) = &sensor.outcome else {
                continue;
            };
            for stretch in &mut run.stretches {
                for (k, axis) in stretch.signals.ft[s].iter_mut().enumerate() {
                    let change = stretch.offsets[s][k] - published[k];
                    axis.change(|values| {
                        values.iter_mut().for_each(|x| *x += change);
                        Ok(())
                    })?;
                }
            }
        }
    }
    Ok(())
}

impl JointResult {
    fn problem(&self) -> Problem {
        let why = self.outcome.as_ref().err().cloned().unwrap_or_default();
        Problem::new(why, "").of(&self.name)
    }
}

/// The robot of all runs; of the configuration too, if one is given.
pub(super) fn one_robot(
    runs: &[&RecordedRun],
    config: Option<&Path>,
) -> Result<Identity, Problems> {
    let of_run = |run: &RecordedRun| {
        let file = run.header.files.first();
        let text = file.map_or("", |file| file.text.as_str());
        Identity::new(text, &run.file)
    };
    let (mut first, mut problems): (Option<Identity>, Vec<Problem>) = (None, Vec::new());
    if let Some(config) = config {
        let shown = config.display().to_string();
        let text = terminal::read_text(config).map_err(|e| Problem::unreadable(&shown, &e))?;
        first = Some(Identity::new(&text, &shown)?);
    }
    for run in runs {
        let own = of_run(run)?;
        let Some(first) = &first else {
            first = Some(own);
            continue;
        };
        let found = first.differences(&own);
        if !found.is_empty() {
            let shown = match found.as_slice() {
                all if all.len() <= 3 => all.join("; "),
                all => format!("{}; and {} more", all[..3].join("; "), all.len() - 3),
            };
            let reason = format!("is a recording of another robot: {shown}");
            problems.push(Problem::new(reason, "recordings of one robot").at(run.file.as_str(), 0));
        }
    }
    match (first, problems.is_empty()) {
        (Some(identity), true) => Ok(identity),
        _ => Err(Problems(problems)),
    }
}

fn assemble(
    runs: &[RecordedRun],
    identity: &Identity,
    results: &Results,
    urdf: Option<String>,
) -> Result<Calibration, Problem> {
    let mut files = BTreeMap::new();
    let mut entries = Vec::new();
    for joint in &results.joints {
        let mut entry = JointEntry {
            name: joint.name.clone(),
            identity: identity.hash(&joint.name).unwrap_or_default(),
            file: None,
            why: joint.outcome.as_ref().err().cloned(),
            prismatic: joint.kind == JointKind::Prismatic,
            held_out_rms: None,
            held_out_rms_of_sigma: None,
            largest: None,
            undetermined: Vec::new(),
        };
        if let Ok(Calibrated {
            fitted,
            held_out,
            undetermined,
            ..
        }) = &joint.outcome
        {
            files.extend(fitted.files(&joint.name)?);
            entry.file = Some(format!("{}.toml", joint.name));
            entry.held_out_rms = Some(rounded(held_out.rms));
            entry.held_out_rms_of_sigma = Some(rounded(held_out.rms_of_sigma));
            entry.largest = Some(rounded(held_out.largest));
            entry.undetermined.clone_from(undetermined);
        }
        entries.push(entry);
    }
    let run = |run: &RecordedRun| RunEntry {
        file: run.file.clone(),
        sha256: run.sha256.clone(),
        date: run.date.clone(),
        seconds: rounded(run.seconds),
    };
    let mut settings = BTreeMap::new();
    let sensors = results.sensors.iter();
    let sensors = sensors
        .map(|s| sensor_entry(s, identity, &mut settings))
        .collect();
    let drives = results.drives.iter();
    let drives = drives
        .map(|d| drive_entry(d, identity, &mut settings))
        .collect();
    let first = runs.first();
    let urdf = first.zip(urdf).map(|(run, text)| {
        files.insert(URDF.to_owned(), text);
        UrdfEntry {
            file: URDF.to_owned(),
            of_sha256: text_hash(runs::urdf(&run.header, &run.robot)),
        }
    });
    Ok(Calibration {
        manifest: Manifest {
            robot: identity.robot.clone(),
            made: format!("{:.0}", Timestamp::now()),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            runs: runs.iter().map(run).collect(),
            joints: entries,
            sensors,
            drives,
            settings,
            urdf,
        },
        files,
    })
}

fn interval(value: &Value) -> [f64; 2] {
    [rounded(value.value), rounded(HALF_WIDTH * value.sigma)]
}

fn sensor_entry(
    result: &SensorResult,
    identity: &Identity,
    settings: &mut BTreeMap<String, toml::Value>,
) -> SensorEntry {
    let entry = SensorEntry {
        name: result.name.clone(),
        identity: identity.of_sensor(&result.name).unwrap_or_default(),
        ..SensorEntry::default()
    };
    let sensor = match &result.outcome {
        Ok(sensor) => sensor,
        Err(why) => {
            return SensorEntry {
                why: Some(why.to_string()),
                ..entry
            };
        }
    };
    let load = &sensor.load;
    let offset: Vec<[f64; 2]> = (sensor.offset.iter().zip(&load.offset))
        .map(|(offset, value)| [rounded(*offset), rounded(HALF_WIDTH * value.sigma)])
        .collect();
    if load.offset.iter().any(|value| value.determined) {
        let values = offset.iter().map(|[x, _]| toml::Value::from(*x));
        let address = format!("ft_sensor.{}.offset", result.name);
        settings.insert(address, toml::Value::Array(values.collect()));
    }
    let degrees = |value: &Value| interval(value).map(|x| rounded(x.to_degrees()));
    let rms = |unit: &str| {
        let of = load.rms.iter().find(|(own, _)| *own == unit);
        of.map_or_else(Vec::new, |(_, rms)| rms.map(rounded).to_vec())
    };
    SensorEntry {
        link: sensor.link.clone(),
        offset,
        mass: Some(interval(&load.mass)),
        centre: load.centre.iter().map(interval).collect(),
        misalignment: load.angle.iter().map(degrees).collect(),
        undetermined: load.undetermined.clone(),
        condition: Some(rounded(load.condition)),
        turned: Some(rounded(load.turned.to_degrees())),
        rms_force: rms("N"),
        rms_torque: rms("N·m"),
        better: sensor.inertia.is_some(),
        ..entry
    }
}

fn drive_entry(
    result: &DriveResult,
    identity: &Identity,
    settings: &mut BTreeMap<String, toml::Value>,
) -> DriveEntry {
    let keys = result.keys.iter().map(|key| {
        if key.differs() {
            settings.insert(key.address.clone(), rounded(key.value).into());
        }
        KeyEntry {
            address: key.address.clone(),
            value: [rounded(key.value), rounded(key.width)],
            configured: rounded(key.configured),
            state: match &key.contradiction {
                Some(why) => why.clone(),
                None if key.differs() => "differs".to_owned(),
                None => "agrees".to_owned(),
            },
        }
    });
    DriveEntry {
        name: result.name.clone(),
        identity: identity.of_drive(&result.name).unwrap_or_default(),
        joints: result.joints.clone(),
        why: result.why.clone(),
        keys: keys.collect(),
    }
}

/// Four significant digits, for files that people read.
fn rounded(x: f64) -> f64 {
    format!("{x:.3e}").parse().unwrap_or(x)
}

/// Progress on stderr, if that is a terminal.
fn bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} {percent:>3} % {elapsed} {msg}");
    let bar = ProgressBar::new(1000);
    style.map_or(bar.clone(), |style| bar.with_style(style))
}
