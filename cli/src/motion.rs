//! `torquectl move`: a robot to a pose, on the way that the loop plans; or a picture of that way.

use crate::requests::{Failure, PATIENCE, connect, end};
use charts::{COLOURS, Figure, Line, Panel};
use control::{MotionLimits, PlannedMotion, PointToPoint};
use indicatif::{ProgressBar, ProgressStyle};
use problem::{Problem, Problems, listed};
use robot_config::JointParameters;
use serde_json::{Value, json};
use signal_hook::consts::{SIGINT, SIGTERM};
use std::fmt::Write as _;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use torqued_client::Commander;

const HELP: &str = "\
All joints arrive at once, within the limits of velocity, acceleration and jerk that [control] of the
configuration sets. Joints that are not named stay. The robot must be enabled; in the end it holds.
Ctrl-C brings it to rest.

Examples:
  torquectl move knee=60 ankle_pitch=-30
  torquectl move knee=60 --speed 20 --robot leg
  torquectl move knee=60 --preview config/leg/robot.toml --from knee=20 --plot way.svg
  torquectl move knee=60 --preview config/leg/robot.toml -o way.csv --json

Exit codes:
  0  the robot is there
  1  it was stopped on its way, torqued could not be reached, or did not follow
  2  bad input: arguments, a joint that the robot does not have, or configuration";

/// Move joints of an enabled robot to angles, and hold there.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct MoveArguments {
    /// Joints and the angles that they go to, in degrees
    #[arg(value_name = "JOINT=DEGREES", required = true, value_parser = target)]
    targets: Vec<Target>,
    /// Greatest speed of each joint, degrees/s [default: that of the configuration]
    #[arg(long, value_name = "SPEED", value_parser = speed)]
    speed: Option<f64>,
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Move nothing: plan the way with the limits of this configuration
    #[arg(long, value_name = "CONFIG", conflicts_with = "robot")]
    preview: Option<PathBuf>,
    /// Where joints are in the preview, in degrees [default: 0, or the nearest limit]
    #[arg(long, value_name = "JOINT=DEGREES", requires = "preview", value_parser = target, num_args = 1..)]
    from: Vec<Target>,
    /// Write the preview as CSV: t in s, q, dq and ddq of each joint in rad, rad/s, rad/s²
    #[arg(short, long, value_name = "FILE.csv", requires = "preview")]
    output: Option<PathBuf>,
    /// Draw the preview
    #[arg(long, value_name = "FILE.svg", requires = "preview")]
    plot: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// A joint's angle, rad.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Target {
    joint: String,
    angle: f64,
}

pub(crate) fn target(text: &str) -> Result<Target, Problem> {
    let parsed = text.rsplit_once('=').and_then(|(joint, angle)| {
        let angle: f64 = angle.trim().trim_end_matches("deg").parse().ok()?;
        let joint = joint.trim().to_owned();
        (angle.is_finite() && !joint.is_empty()).then_some((joint, angle.to_radians()))
    });
    let allowed = "a joint, = and an angle in degrees, as knee=60";
    let parsed = parsed.ok_or_else(|| Problem::new(format!("{text:?} is no target"), allowed));
    parsed.map(|(joint, angle)| Target { joint, angle })
}

fn speed(text: &str) -> Result<f64, Problem> {
    let speed = text
        .parse()
        .ok()
        .filter(|x: &f64| x.is_finite() && *x > 0.0);
    let speed = speed.ok_or_else(|| Problem::new("not a speed", "above 0 degrees/s"));
    speed.map(f64::to_radians)
}

pub(crate) fn run(arguments: &MoveArguments) -> ExitCode {
    match &arguments.preview {
        Some(config) => crate::output::finish_or_refuse(preview(config, arguments)),
        None => end(go(arguments)),
    }
}

/// The targets by joint, in the robot's order; none for joints that are not named.
pub(crate) fn by_joint(names: &[&str], targets: &[Target]) -> Result<Vec<Option<f64>>, Problem> {
    let mut angles = vec![None; names.len()];
    for target in targets {
        let joint = names.iter().position(|name| *name == target.joint);
        let Some(angle) = joint.and_then(|joint| angles.get_mut(joint)) else {
            let what = format!("the robot has no joint {:?}", target.joint);
            return Err(Problem::new(what, listed(names.iter().copied())));
        };
        if angle.replace(target.angle).is_some() {
            let what = format!("joint {:?} is named twice", target.joint);
            return Err(Problem::new(what, "one angle for each joint"));
        }
    }
    Ok(angles)
}

fn go(arguments: &MoveArguments) -> Result<String, Failure> {
    let stop = catch_signals().map_err(Failure::Argument)?;
    let mut client = connect(arguments.robot.as_ref())?;
    let description = client.description();
    let joints = description.joint_names.iter().map(|name| name.as_str());
    let names: Vec<&str> = joints.take(description.joint_count as usize).collect();
    let angles = by_joint(&names, &arguments.targets).map_err(Failure::Argument)?;
    let mut commander = Commander::connect(&mut client)?;
    commander.hold_until_ready(PATIENCE)?;
    let bar = bar();
    let mut whole = 0.0f64;
    let change = |reference: &mut torqued_client::robot_state::Reference| {
        for (joint, angle) in reference.joints.iter_mut().zip(angles) {
            joint.q_d = angle.unwrap_or(joint.q_d);
            joint.dq_d = arguments.speed.unwrap_or(0.0);
        }
    };
    let arrived = commander.go_to(change, |left| {
        whole = whole.max(left.as_secs_f64());
        bar.set_length((1e3 * whole) as u64);
        bar.set_position((1e3 * (whole - left.as_secs_f64())) as u64);
        bar.set_message(format!("{:.1} s left", left.as_secs_f64()));
        !stop.load(Ordering::Relaxed)
    });
    bar.finish_and_clear();
    let arrived = arrived?;
    commander.close()?;
    if !arrived {
        let why = "stopped on its way";
        return Err(Failure::Stopped(why.to_owned()));
    }
    Ok(match arguments.json {
        true => format!(
            "{}\n",
            json!({ "robot": client.robot(), "duration_s": whole })
        ),
        false => format!("there after {whole:.2} s; the robot holds\n"),
    })
}

/// Set once the user or the system wants an end.
pub(crate) fn catch_signals() -> Result<Arc<AtomicBool>, Problem> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        let registered = signal_hook::flag::register(signal, Arc::clone(&stop));
        registered.map_err(|e| Problem::new(format!("signals cannot be caught: {e}"), ""))?;
    }
    Ok(stop)
}

/// For work whose end is not known.
pub(crate) fn spinner() -> ProgressBar {
    match io::stderr().is_terminal() {
        true => ProgressBar::new_spinner(),
        false => ProgressBar::hidden(),
    }
}

pub(crate) fn bar() -> ProgressBar {
    let bar = match io::stderr().is_terminal() {
        true => ProgressBar::new(1),
        false => ProgressBar::hidden(),
    };
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {msg}") {
        bar.set_style(style);
    }
    bar
}

/// A joint of the preview.
struct Way<'a> {
    joint: &'a JointParameters,
    from: f64,
    to: f64,
    limits: MotionLimits,
}

fn preview(config: &Path, arguments: &MoveArguments) -> Result<String, Problems> {
    let read = |path: &str| std::fs::read_to_string(path);
    let robot = robot_config::load(&config.display().to_string(), &read)?;
    let parameters = &robot.parameters;
    let names: Vec<&str> = parameters.joints.iter().map(|j| j.name.as_str()).collect();
    let (from, to) = (
        by_joint(&names, &arguments.from)?,
        by_joint(&names, &arguments.targets)?,
    );
    let joints = parameters.joints.iter().zip(parameters.motion_limits());
    let ways: Vec<Way> = joints
        .zip(from.into_iter().zip(to))
        .map(|((joint, limits), (from, to))| {
            let limits = limits.no_faster(arguments.speed.unwrap_or(0.0));
            let range = joint.limits.position_min..=joint.limits.position_max;
            let from = from.unwrap_or_else(|| 0.0f64.clamp(*range.start(), *range.end()));
            let to = to.unwrap_or(from);
            match range.contains(&to) {
                true => Ok(Way {
                    joint,
                    from,
                    to,
                    limits,
                }),
                false => Err(Problem::new(
                    format!("{}={} is beyond its limits", joint.name, to.to_degrees()),
                    format!(
                        "{:.1} to {:.1}",
                        range.start().to_degrees(),
                        range.end().to_degrees()
                    ),
                )),
            }
        })
        .collect::<Result<_, _>>()?;
    let (duration, samples) = plan(&ways, parameters.timing.sample_period)?;
    if let Some(path) = &arguments.output {
        let text = csv(&ways, parameters.timing.sample_period, &samples);
        let written = std::fs::write(path, text);
        written.map_err(|e| Problem::new(format!("{}: {e}", path.display()), ""))?;
    }
    if let Some(path) = &arguments.plot {
        figure(&ways, parameters.timing.sample_period, &samples).write(path)?;
    }
    if !arguments.json {
        return Ok(format!("{duration:.3} s\n"));
    }
    let joint = |way: &Way| {
        json!({
            "joint": way.joint.name, "from_rad": way.from, "to_rad": way.to,
            "velocity_rad_per_s": way.limits.velocity,
            "acceleration_rad_per_s2": way.limits.acceleration,
            "jerk_rad_per_s3": way.limits.jerk,
        })
    };
    let joints = Value::from(ways.iter().map(joint).collect::<Vec<_>>());
    Ok(format!(
        "{:#}\n",
        json!({ "duration_s": duration, "joints": joints })
    ))
}

/// Duration, s, and the joints in every period.
fn plan(ways: &[Way], period: f64) -> Result<(f64, Vec<Vec<PlannedMotion>>), Problem> {
    let mut motion = PointToPoint::new(ways.len());
    motion.start(ways.iter().map(|way| PlannedMotion {
        q: way.from,
        ..PlannedMotion::default()
    }));
    let mut samples = vec![motion.advance(period).to_vec()];
    if !motion.go_to(ways.iter().map(|way| (way.to, way.limits))) {
        return Err(Problem::new(
            "there is no such motion",
            "a speed that is not so low",
        ));
    }
    let duration = motion.left_s();
    while motion.left_s() > 0.0 {
        samples.push(motion.advance(period).to_vec());
    }
    Ok((duration, samples))
}

fn csv(ways: &[Way], period: f64, samples: &[Vec<PlannedMotion>]) -> String {
    let mut text = "t".to_owned();
    for way in ways {
        let name = &way.joint.name;
        let _ = write!(text, ",{name}.q,{name}.dq,{name}.ddq");
    }
    for (k, joints) in samples.iter().enumerate() {
        let _ = write!(text, "\n{}", k as f64 * period);
        for PlannedMotion { q, dq, ddq } in joints {
            let _ = write!(text, ",{q},{dq},{ddq}");
        }
    }
    text + "\n"
}

fn figure(ways: &[Way], period: f64, samples: &[Vec<PlannedMotion>]) -> Figure {
    let moving = || {
        ways.iter()
            .enumerate()
            .filter(|(_, way)| way.from != way.to)
    };
    let panel = |caption: &str, value: fn(&PlannedMotion) -> f64| Panel {
        caption: caption.to_owned(),
        x_unit: "s".to_owned(),
        lines: moving()
            .zip(COLOURS.iter().cycle())
            .map(|((j, way), colour)| {
                let points = samples.iter().enumerate();
                let points = points.map(|(k, at)| (k as f64 * period, value(&at[j]).to_degrees()));
                Line::new(&way.joint.name, *colour, points.collect())
            })
            .collect(),
        ..Panel::default()
    };
    Figure {
        title: "Planned motion".to_owned(),
        columns: 1,
        panel_size: (700, 200),
        panels: vec![
            panel("position, degrees", |m| m.q),
            panel("velocity, degrees/s", |m| m.dq),
            panel("acceleration, degrees/s²", |m| m.ddq),
        ],
    }
}
