//! `torquectl calibrate joints`.

use super::fit::{self, Calibrated, JointResult, References};
use super::identity::Identity;
use super::runs::RecordedRun;
use super::store::{Calibration, JointEntry, Manifest, RunEntry};
use crate::BAD_INPUT;
use crate::output::finish;
use crate::reference::robot::Payload;
use crate::report::{self, Section, escaped};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use jiff::Timestamp;
use problem::{Allowed, Problem, Problems};
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use terminal::TextTable;

/// Exit code where some joints could not be calibrated.
const INCOMPLETE: u8 = 1;

const HELP: &str = "\
The recordings are the daemon's own (torquectl record, torqued run --record); they carry the robot's
configuration, and all must be of one robot. No torque sensor is needed: every joint's reference torque
comes from F/T sensors, IMU and the rigid-body model with centred filters, which have no delay, or from
gravity and the model alone. It is no better than the model's masses: known payloads are to be named.

What to record (docs/bring-up.md): slow motion of every joint both ways over the range that it works in,
some faster motion, and the loads that matter later: for legs in a harness and standing. Two minutes each.
What the recordings do not determine is named and stays at the data sheet's value, with its width. A
quarter at each recording's end is held out from a first fit, which is judged on it.

The folder DIR holds a joint file for each joint and calibration.toml: dates and hashes of the recordings,
robot, figures. It is written at the end, as a whole. `torquectl calibrate commit` adopts it.

Examples:
  torquectl calibrate joints hanging.mcap standing.mcap -o calibrated
  torquectl calibrate joints sweeps.mcap -o calibrated --report calibrated.html
  torquectl calibrate joints sweeps.mcap --payload flange=3.5,0,0,0.08 -o calibrated --json

Exit codes:
  0  every joint is calibrated
  1  written, but some joints could not be calibrated: they are named
  2  bad input: not recordings of one robot, a folder that is there already or cannot be written";

/// Joint files of every joint from recorded runs.
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct JointsArguments {
    /// The recorded runs
    #[arg(required = true, value_name = "RUN.mcap")]
    runs: Vec<PathBuf>,
    /// The folder to write
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// The configuration that is to be calibrated; its joints must be those of the recordings
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Known payload: LINK=kg[,x,y,z], centre of mass in the link's frame, m
    #[arg(long)]
    payload: Vec<Payload>,
    /// Standard deviation of the model's masses, per cent [default: the configuration's model_sigma_per_cent, or
    /// 2]
    #[arg(long, value_name = "PER_CENT", value_parser = per_cent)]
    model_sigma: Option<f64>,
    /// Window of the centred filters, ms
    #[arg(long, default_value_t = 20.0)]
    window_ms: f64,
    /// Write a page of figures of all joints
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

pub(crate) fn run(arguments: &JointsArguments) -> ExitCode {
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

fn calibrate(arguments: &JointsArguments) -> Result<(String, bool), Problems> {
    // Before minutes of work that would be lost to it.
    if arguments.out.exists() {
        let shown = arguments.out.display().to_string();
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
    let identity = one_robot(&runs, arguments.config.as_deref())?;
    for note in runs
        .iter()
        .flat_map(|r| r.notes.iter().map(move |n| (r, n)))
    {
        bar.suspend(|| eprintln!("{}: {}", note.0.file, note.1));
    }
    bar.set_message("reference torques");
    let references = References::new(&runs, 1e-3 * arguments.window_ms, &mut |share| {
        bar.set_position((300.0 * share) as u64);
    })?;
    let names: Vec<String> = runs.iter().map(|run| run.file.clone()).collect();
    let Some(robot) = runs.first().map(|run| run.robot.clone()) else {
        return Err(Problem::new("no recording", "at least one").into());
    };
    let calibrated = fit::all(&robot, &references, &names, &|share, joint| {
        bar.set_position((300.0 + 700.0 * share) as u64);
        bar.set_message(joint.to_owned());
    });
    bar.finish_and_clear();
    if calibrated.iter().all(|joint| joint.outcome.is_err()) {
        return Err(Problems(
            calibrated.iter().map(JointResult::problem).collect(),
        ));
    }
    let calibration = assemble(&runs, &identity, &calibrated)?;
    if let Some(path) = &arguments.report {
        write_page(path, &calibration.manifest, &calibrated)?;
    }
    calibration.write(&arguments.out)?;
    let complete = calibrated.iter().all(|joint| joint.outcome.is_ok());
    let text = match arguments.json {
        true => format!(
            "{}\n",
            object(&calibration.manifest, &calibrated, &arguments.out)
        ),
        false => text(&calibration.manifest, &arguments.out),
    };
    Ok((text, complete))
}

impl JointResult {
    fn problem(&self) -> Problem {
        let why = self.outcome.as_ref().err().cloned().unwrap_or_default();
        Problem::new(why, "").of(&self.name)
    }
}

/// The robot of all runs; of the configuration too, if one is given.
fn one_robot(runs: &[RecordedRun], config: Option<&Path>) -> Result<Identity, Problems> {
    let of_run = |run: &RecordedRun| {
        let file = run.header.files.first();
        let text = file.map_or("", |file| file.text.as_str());
        Identity::new(text, &run.file)
    };
    let (mut first, mut problems): (Option<Identity>, Vec<Problem>) = (None, Vec::new());
    if let Some(config) = config {
        let shown = config.display().to_string();
        let text = std::fs::read_to_string(config).map_err(|e| Problem::unreadable(&shown, &e))?;
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
    joints: &[JointResult],
) -> Result<Calibration, Problem> {
    let mut files = BTreeMap::new();
    let mut entries = Vec::new();
    for joint in joints {
        let mut entry = JointEntry {
            name: joint.name.clone(),
            identity: identity.hash(&joint.name).unwrap_or_default(),
            file: None,
            why: joint.outcome.as_ref().err().cloned(),
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
    Ok(Calibration {
        manifest: Manifest {
            robot: identity.robot.clone(),
            made: format!("{:.0}", Timestamp::now()),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            runs: runs.iter().map(run).collect(),
            joints: entries,
        },
        files,
    })
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

fn text(manifest: &Manifest, out: &Path) -> String {
    let heading = [
        "joint",
        "largest N·m",
        "held out RMS N·m",
        "%",
        "error / sigma",
        "undetermined",
    ];
    let mut cells = vec![heading.map(str::to_owned).to_vec()];
    let mut failed = String::new();
    for joint in &manifest.joints {
        if let Some(why) = &joint.why {
            let _ = writeln!(failed, "{}: not calibrated: {why}", joint.name);
            continue;
        }
        let (rms, largest) = (
            joint.held_out_rms.unwrap_or(0.0),
            joint.largest.unwrap_or(0.0),
        );
        cells.push(vec![
            joint.name.clone(),
            format!("{largest:.2}"),
            format!("{rms:.3}"),
            format!("{:.2}", 100.0 * rms / largest.max(1e-9)),
            format!("{:.2}", joint.held_out_rms_of_sigma.unwrap_or(0.0)),
            joint.undetermined.join(", "),
        ]);
    }
    format!(
        "{}{failed}held out: the last quarter of each recording, by a fit to the rest; % of the largest torque\n\
         written: {}\n",
        TextTable(cells),
        out.display()
    )
}

fn object(manifest: &Manifest, joints: &[JointResult], out: &Path) -> serde_json::Value {
    let joint = |(entry, result): (&JointEntry, &JointResult)| {
        let mut value = json!(entry);
        value["inputs"] = json!(result.inputs);
        let report = result.outcome.as_ref().map(|c| c.fitted.report.clone());
        value["report"] = json!(report.unwrap_or_default());
        value
    };
    let all: Vec<_> = manifest.joints.iter().zip(joints).map(joint).collect();
    json!({
        "robot": manifest.robot,
        "made": manifest.made,
        "runs": manifest.runs,
        "joints": all,
        "written": out.display().to_string(),
    })
}

/// One page of all joints.
fn write_page(path: &Path, manifest: &Manifest, joints: &[JointResult]) -> Result<(), Problem> {
    let title = format!("Calibration of {}, {}", manifest.robot, manifest.made);
    let runs = manifest.runs.iter();
    let runs =
        runs.map(|run| format!("{}: {:.1} s, SHA-256 {}", run.file, run.seconds, run.sha256));
    let mut body = report::lists(&[("Recordings".to_owned(), runs.collect())]);
    let _ = write!(
        body,
        "<h2>Joints</h2>\n<p>Fused torque against its reference on the last quarter of each recording, by a fit \
         to the rest.</p>\n<table><tr><th>joint</th><th>largest, N·m</th><th>RMS error, N·m</th><th>%</th>\
         <th>RMS of error / sigma</th><th>undetermined</th></tr>\n"
    );
    for joint in &manifest.joints {
        let name = escaped(&joint.name);
        let _ = match (&joint.why, joint.held_out_rms, joint.largest) {
            (None, Some(rms), Some(largest)) => writeln!(
                body,
                "<tr><td><a href=\"#{name}\">{name}</a></td><td>{largest:.2}</td><td>{rms:.3}</td><td>{:.2}</td>\
                 <td>{:.2}</td><td>{}</td></tr>",
                100.0 * rms / largest.max(1e-9),
                joint.held_out_rms_of_sigma.unwrap_or(0.0),
                escaped(&joint.undetermined.join(", "))
            ),
            (why, ..) => writeln!(
                body,
                "<tr><td>{name}</td><td colspan=\"5\" class=\"bad\">not calibrated: {}</td></tr>",
                escaped(why.as_deref().unwrap_or(""))
            ),
        };
    }
    body += "</table>\n";
    for joint in joints {
        let _ = writeln!(body, "<hr id=\"{}\">", escaped(&joint.name));
        let fits = joint.outcome.as_ref().map(|c| c.fitted.report.clone());
        let sections: [Section; 2] = [
            (format!("{}: recordings", joint.name), joint.inputs.clone()),
            (format!("{}: fits", joint.name), fits.unwrap_or_default()),
        ];
        body += &report::lists(&sections);
        if let Ok(calibrated) = &joint.outcome {
            body += &calibrated.html;
        }
    }
    std::fs::write(path, report::page(&title, &body))
        .map_err(|e| Problem::unwritable(path.display(), &e))
}
