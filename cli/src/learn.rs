//! `torquectl learn`: feed-forward torques for mode low-gain tracking, from recorded motion.

mod picture;

use crate::calibrate::runs::robot;
use crate::motion::bar;
use crate::output::finish_or_refuse;
use crate::recorded;
use identification::gaussian_process::{GatherMotion, MotionLog, motion_options, train_motion};
use joint_file::TrainedLocalGp;
use problem::{Problem, Problems, listed};
use recording::Ending;
use robot_config::Robot;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use terminal::TextTable;

const HELP: &str = "\
What is learned is the torque beside that of the robot's model by which a joint made its motion: payloads,
errors of model, gear and friction. Record a motion like the one that is to be tracked, in mode inverse
dynamics, position, torque-feedback motion or low-gain tracking; some 30 s that repeat it a few times are
enough. Beyond recorded motions the learned torque fades to none.

For each joint a file JOINT.feed-forward.toml is written; the key feed_forward of the joint in robot.toml
names it. Printed: how far the model was off, and what is left, root mean square on parts of the recording that
the training did not see. A joint whose rest is no less keeps the model alone.

Examples:
  torquectl learn run.mcap -o learned
  torquectl learn monday.mcap tuesday.mcap -o learned --joint knee --joint hip_pitch
  torquectl learn run.mcap -o learned --plot learned.svg
  torquectl learn run.mcap -o learned --json

Exit codes:
  0  learned
  2  bad input: arguments, or recordings of other robots or without such motion";

/// Learn the torques that a robot's model is missing, for tracking by low gains
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct LearnArguments {
    /// Recordings of the robot in motion
    #[arg(required = true, value_name = "RUN.mcap")]
    runs: Vec<PathBuf>,
    /// The folder of the files
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// These joints [default: all]
    #[arg(long, value_name = "NAME")]
    joint: Vec<String>,
    /// Draw the missing and the learned torque of every joint over the recorded motion
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Share of the model's error that must go, for a file to be written.
const WORTHWHILE: f64 = 0.1;

/// Outcome for a joint.
struct Learned {
    joint: String,
    result: Result<TrainedLocalGp, Problem>,
    file: Option<PathBuf>,
}

pub(crate) fn run(arguments: &LearnArguments) -> ExitCode {
    finish_or_refuse(learn(arguments))
}

fn learn(arguments: &LearnArguments) -> Result<String, Problems> {
    let (robot, logs, notes) = read(&arguments.runs)?;
    let joints = &robot.parameters.joints;
    let names = || listed(joints.iter().map(|joint| joint.name.as_str()));
    for name in &arguments.joint {
        if !joints.iter().any(|joint| joint.name == *name) {
            let what = format!("--joint {name}: the robot has no such joint");
            return Err(Problem::new(what, names()).into());
        }
    }
    let folder = &arguments.output;
    let unwritable = |path: &Path, error: &std::io::Error| {
        let what = format!("cannot be written: {error}");
        Problem::new(what, "a folder that can be written").at(path.display().to_string(), 0)
    };
    std::fs::create_dir_all(folder).map_err(|error| unwritable(folder, &error))?;
    let wanted =
        |name: &str| arguments.joint.is_empty() || arguments.joint.iter().any(|n| n == name);
    let bar = bar();
    bar.set_length(1000 * joints.len() as u64);
    let mut all = Vec::new();
    let mut panels = Vec::new();
    for (j, (joint, log)) in joints.iter().zip(&logs).enumerate() {
        if !wanted(&joint.name) {
            continue;
        }
        let options = motion_options(&joint.name, joint.limits.torque);
        let result = train_motion(
            log,
            robot.parameters.timing.sample_period,
            &options,
            &mut |part, step| {
                bar.set_position((1e3 * (j as f64 + part)) as u64);
                bar.set_message(format!("{}: {step}", joint.name));
            },
        );
        let mut learned = Learned {
            joint: joint.name.clone(),
            result,
            file: None,
        };
        if let Some(text) = learned.text()? {
            let path = folder.join(format!("{}.feed-forward.toml", joint.name));
            terminal::write_file(&path, &text)?;
            learned.file = Some(path);
        }
        if let (Some(_), Ok(trained)) = (&arguments.plot, &learned.result) {
            let period = robot.parameters.timing.sample_period;
            panels.push(picture::panel(joint, log, period, trained)?);
        }
        all.push(learned);
    }
    bar.finish_and_clear();
    if let (Some(path), false) = (&arguments.plot, panels.is_empty()) {
        picture::figure(&robot.parameters.name, panels).write(path)?;
    }
    if all.iter().all(|learned| learned.result.is_err()) {
        let first = all.into_iter().find_map(|learned| learned.result.err());
        let problem = first.unwrap_or_else(|| Problem::new("no joint", names()));
        return Err(problem.into());
    }
    Ok(if arguments.json {
        json(&robot, &all, &notes)
    } else {
        text(&all, &notes)
    })
}

/// The robot of the recordings, what they show of each joint, and remarks.
fn read(paths: &[PathBuf]) -> Result<(Robot, Vec<MotionLog>, Vec<String>), Problems> {
    let mut found: Option<(Robot, Vec<MotionLog>)> = None;
    let mut notes = Vec::new();
    for path in paths {
        let mut run = recorded::open_with_inputs(path)?;
        let robot = robot(run.header(), &[], None)?;
        let mut gather = GatherMotion::new(&robot);
        let ending = recorded::read_all(path, &mut run, |_, message| {
            gather.take(&message.record.cycle);
            Ok(())
        })?;
        if ending != Ending::Complete {
            let why = recorded::describe_ending(&ending);
            notes.push(format!("{}: {}", path.display(), why.trim_end()));
        }
        let logs = gather.logs();
        match &mut found {
            None => found = Some((robot, logs)),
            Some((first, all)) => {
                let same = |a: &Robot, b: &Robot| {
                    let names = |r: &Robot| {
                        let joints = r.parameters.joints.iter();
                        joints.map(|joint| joint.name.clone()).collect::<Vec<_>>()
                    };
                    a.parameters.name == b.parameters.name && names(a) == names(b)
                };
                if !same(first, &robot) {
                    let what = format!("a recording of robot {:?}", robot.parameters.name);
                    let allowed = format!("recordings of robot {:?}", first.parameters.name);
                    return Err(Problem::new(what, allowed)
                        .at(path.display().to_string(), 0)
                        .into());
                }
                for (all, log) in all.iter_mut().zip(logs) {
                    all.inputs.extend(log.inputs);
                    all.missing.extend(log.missing);
                }
            }
        }
    }
    let (robot, logs) = found.ok_or_else(|| Problem::new("no recording", "RUN.mcap"))?;
    Ok((robot, logs, notes))
}

impl Learned {
    /// Root mean square of what the model misses, and of what is left, N·m.
    fn errors(&self) -> Option<(f64, f64)> {
        self.result
            .as_ref()
            .ok()
            .map(|learned| learned.held_out_rms)
    }

    /// The file's text, where what is learned is worth it.
    fn text(&self) -> Result<Option<String>, Problem> {
        let learned = self.result.as_ref().ok().filter(|learned| {
            let (before, after) = learned.held_out_rms;
            after <= (1.0 - WORTHWHILE) * before
        });
        learned.map(TrainedLocalGp::to_text).transpose()
    }
}

fn text(all: &[Learned], notes: &[String]) -> String {
    let head = ["joint", "model off by", "left", "feed_forward"];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    for learned in all {
        let (before, after) = match learned.errors() {
            Some((before, after)) => (format!("{before:.3} N·m"), format!("{after:.3} N·m")),
            None => ("-".to_owned(), "-".to_owned()),
        };
        let file = match (&learned.file, &learned.result) {
            (Some(path), _) => path.display().to_string(),
            (None, Err(why)) => why.reason.clone(),
            (None, Ok(_)) => "none: the model alone is as good".to_owned(),
        };
        rows.push(vec![learned.joint.clone(), before, after, file]);
    }
    let notes: String = notes.iter().map(|note| format!("{note}\n")).collect();
    format!("{}{notes}", TextTable(rows))
}

fn json(robot: &Robot, all: &[Learned], notes: &[String]) -> String {
    let joints = all.iter().map(|learned| {
        let (before, after) = learned.errors().unzip();
        json!({
            "joint": learned.joint,
            "model_off_rms_Nm": before,
            "left_rms_Nm": after,
            "file": learned.file.as_ref().map(|path| path.display().to_string()),
            "why_not": learned.result.as_ref().err().map(|why| why.reason.clone()),
        })
    });
    let joints: Vec<_> = joints.collect();
    let object = json!({ "robot": robot.parameters.name, "joints": joints, "notes": notes });
    format!("{object:#}\n")
}
