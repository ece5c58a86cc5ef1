//! `torquectl calibrate inertia`: inertial parameters and friction from angle and torque alone.

mod log;
mod page;
mod report;

use crate::output::{finish, finish_or_refuse, read_input};
use clap::Args;
use dynamics::{Base, Model, urdf_with_inertias};
use identification::inertia::{Calibration, Robot, calibrate, consistent};
use indicatif::{ProgressBar, ProgressStyle};
use problem::{Problem, Problems};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Identify inertial parameters and friction of an arm from logs of its joints
#[derive(Args)]
#[command(after_long_help = FORMAT)]
pub(crate) struct InertiaArguments {
    /// The robot (URDF); its root link stands still
    #[arg(long)]
    urdf: PathBuf,
    /// Logs (CSV: t,q1..,dq1..,tau1..)
    #[arg(long, required = true, num_args = 1..)]
    log: Vec<PathBuf>,
    /// Further logs that the result shall predict: they teach nothing
    #[arg(long, num_args = 1.., value_name = "LOG")]
    judge: Vec<PathBuf>,
    /// Joints of the columns 1, 2, .. where the URDF has more or its order is not clear
    #[arg(long, value_delimiter = ',', value_name = "NAME,NAME..")]
    joints: Vec<String>,
    /// Torques of the logs are those that the load exerts: take all with the opposite sign
    #[arg(long)]
    negate_torque: bool,
    /// Torques come from motor currents: the rotors' inertia is a part of them
    #[arg(long)]
    motor_torque: bool,
    /// Gravity in the root link's axes, m/s² (an arm on a wall or ceiling)
    #[arg(
        long,
        value_delimiter = ',',
        allow_hyphen_values = true,
        value_name = "X,Y,Z",
        default_value = "0,0,-9.81"
    )]
    gravity: Vec<f64>,
    /// Take columns and write results that contradict the URDF (a payload that it lacks, a joint that was held)
    #[arg(long)]
    accept: bool,
    /// Folder for the corrected URDF, friction.csv and inertia.json; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write a page of figures (HTML, needs no network)
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Print the results as JSON
    #[arg(long)]
    json: bool,
}

const FORMAT: &str = "\
A log is CSV with a header (delimiter , ; or tab). Columns, in SI units; others are not read:
  t                  stamps, s; irregular, doubled and missing rows are allowed
  q1, q2, ..         joint angles, rad (m), in the URDF's direction and from its zero; or q_NAME
  tau1, tau2, ..     joint torques, N·m (N), e.g. motor current x torque constant x gear ratio
  dq1, dq2, ..       velocities (optional: q is differentiated); ddq1, ddq2, .. accelerations
Numbers count the joints from the root outwards; names are those of the URDF. Move every joint, fast
and slow, in both directions, for 30 s or more, with nothing touching the arm.

Quarters of the logs are held out in turn; everything printed about accuracy is of those. The
corrected URDF differs in <inertial> only, and every link of it can exist. Where no motion determines
a parameter, the URDF's own value stays. docs/calibration-inertia.md explains method and report.

Examples:
  torquectl calibrate inertia --urdf ur10e.urdf --log motion.csv -o calibrated
  torquectl calibrate inertia --urdf panda.urdf --log a.csv b.csv \\
      --joints panda_joint1,panda_joint2,panda_joint3,panda_joint4,panda_joint5,panda_joint6,panda_joint7 \\
      -o calibrated --report panda.html";

pub(crate) fn run(arguments: &InertiaArguments) -> ExitCode {
    match identify(arguments) {
        Ok((text, refused)) if refused.is_empty() => finish(&text),
        Ok((text, refused)) => {
            finish(&text);
            finish_or_refuse(Err(Problems(refused)))
        }
        Err(problems) => finish_or_refuse(Err(problems)),
    }
}

/// The report, and why nothing is written where the result contradicts the URDF.
fn identify(arguments: &InertiaArguments) -> Result<(String, Vec<Problem>), Problems> {
    let file = arguments.urdf.display().to_string();
    let text = read_input(&arguments.urdf)?;
    let mut model = Model::from_urdf(&text, &file, Base::Fixed)?;
    let gravity: [f64; 3] = arguments
        .gravity
        .clone()
        .try_into()
        .map_err(|given: Vec<f64>| {
            Problem::new(format!("--gravity: {} numbers", given.len()), "three, m/s²")
        })?;
    model.set_gravity(gravity.into());
    let columns = log::Columns::new(&model, &file, &arguments.joints, &arguments.log)?;
    let read = |paths: &[PathBuf]| {
        let logs = paths
            .iter()
            .map(|path| columns.read(path, arguments.negate_torque));
        logs.collect::<Result<Vec<_>, _>>()
    };
    let (logs, others) = (read(&arguments.log)?, read(&arguments.judge)?);
    let mut robot = Robot::new(&model, columns.measured());
    robot.motor_torque = arguments.motor_torque;
    robot.accept = arguments.accept;
    let bar = bar();
    let found = calibrate(&robot, &logs, &others, |part, what| {
        bar.set_position((1000.0 * part) as u64);
        bar.set_message(what.to_owned());
    });
    bar.finish_and_clear();
    let mut found = found?;
    found.notes.splice(0..0, columns.notes().iter().cloned());
    let refused = contradictions(arguments, &found);
    let mut written = Vec::new();
    if let Some(folder) = arguments.out.as_ref().filter(|_| refused.is_empty()) {
        written = write(folder, arguments, &text, &robot, &found)?;
    }
    if let Some(path) = &arguments.report {
        page::write(path, &robot, &found)?;
        written.push(path.display().to_string());
    }
    let text = if arguments.json {
        format!("{:#}\n", report::json(&robot, &found, &written))
    } else {
        report::text(&robot, &found, &written)
    };
    Ok((text, refused))
}

/// Results that contradict the URDF, unless the user takes them.
fn contradictions(arguments: &InertiaArguments, found: &Calibration) -> Vec<Problem> {
    if arguments.accept {
        return Vec::new();
    }
    let allowed = "links like the URDF's and friction that brakes; --accept where the robot differs so (a payload, another tool); nothing is written";
    let file = arguments.urdf.display().to_string();
    let each = found.contradictions.iter();
    each.map(|reason| Problem::new(reason.clone(), allowed).at(&file, 0))
        .collect()
}

/// Progress on stderr, if that is a terminal.
fn bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} {percent:>3} % {elapsed} {msg}");
    let bar = ProgressBar::new(1000);
    style.map_or(bar.clone(), |style| bar.with_style(style))
}

/// Writes URDF, friction and JSON; returns their names.
fn write(
    folder: &Path,
    arguments: &InertiaArguments,
    text: &str,
    robot: &Robot<'_>,
    found: &Calibration,
) -> Result<Vec<String>, Problem> {
    let file = arguments.urdf.display().to_string();
    let corrected = if found.urdf_kept {
        text.to_owned()
    } else {
        urdf_with_inertias(text, &file, &consistent::of_links(robot, &found.inertias))?
    };
    let name = arguments.urdf.file_name().unwrap_or_default();
    let urdf = folder.join(name);
    let same = |a: &Path, b: &Path| {
        a.canonicalize()
            .is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b))
    };
    if same(&urdf, &arguments.urdf) {
        let reason = format!(
            "-o {}: would replace the URDF that was read",
            folder.display()
        );
        return Err(Problem::new(reason, "another folder"));
    }
    std::fs::create_dir_all(folder).map_err(|e| Problem::unwritable(folder.display(), &e))?;
    let friction = folder.join("friction.csv");
    let json = folder.join("inertia.json");
    let files = [&urdf, &friction, &json].map(|path| path.display().to_string());
    let texts = [
        corrected,
        report::friction(robot, found),
        format!("{:#}\n", report::json(robot, found, &files)),
    ];
    for (path, text) in [&urdf, &friction, &json].into_iter().zip(&texts) {
        terminal::write_file(path, text)?;
    }
    Ok(files.into())
}
