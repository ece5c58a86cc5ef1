//! `torquectl move`: a robot to a pose, on the way that the loop plans; or a picture of that way.

mod preview;

use crate::requests::{Failure, PATIENCE, beyond_limits, command, connect, end};
use indicatif::{ProgressBar, ProgressStyle};
use problem::{Problem, listed};
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::f64::consts::PI;
use std::io::{self, IsTerminal};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use torqued_client::Client;
use torqued_client::robot_state::{CycleRecord, JointKind, measured_flags};

const HELP: &str = "\
All joints arrive at once, within the limits of velocity, acceleration and jerk that [control] of the
configuration sets. Joints that are not named stay. The robot must be enabled; in the end it holds.
Ctrl-C brings it to rest.

Examples:
  torquectl move knee=60 ankle_pitch=-30
  torquectl move knee=60 --speed 20 --robot leg
  torquectl move lift=250mm gripper=20mm
  torquectl move knee=60 --preview config/leg/robot.toml --from knee=20 --plot way.svg
  torquectl move knee=60 --preview config/leg/robot.toml -o way.csv --json

Exit codes:
  0  the robot is there
  1  it was stopped on its way, a joint is not where it should be in the end, torqued could not be reached, or
     did not follow
  2  bad input: arguments, a joint that the robot does not have, or configuration";

/// Distance from its target within which a joint is there, rad, of prismatic ones a tenth in m: twice what a hold may
/// give way by under a load.
const THERE: f64 = 1.0 * PI / 180.0;
/// Time that a joint has for it after the plan's end.
const SETTLES: Duration = Duration::from_millis(500);

/// Move joints of an enabled robot to positions, and hold there.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct MoveArguments {
    /// Joints and the positions that they go to, in degrees, of prismatic joints in mm
    #[arg(value_name = "JOINT=POSITION", required = true, value_parser = target)]
    targets: Vec<Target>,
    /// Greatest speed of each joint, degrees/s or mm/s [default: that of the configuration]
    #[arg(long, value_name = "SPEED", value_parser = speed)]
    speed: Option<f64>,
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Move nothing: plan the way with the limits of this configuration
    #[arg(long, value_name = "CONFIG", conflicts_with = "robot")]
    preview: Option<PathBuf>,
    /// Where joints are in the preview, in degrees or mm [default: 0, or the nearest limit]
    #[arg(long, value_name = "JOINT=POSITION", requires = "preview", value_parser = target, num_args = 1..)]
    from: Vec<Target>,
    /// Write the preview as CSV: t in s, q, dq and ddq of each joint in rad, rad/s, rad/s², or in m
    #[arg(short, long, value_name = "FILE.csv", requires = "preview")]
    output: Option<PathBuf>,
    /// Draw the preview
    #[arg(long, value_name = "FILE.svg", requires = "preview")]
    plot: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Greatest speed of a joint, rad/s or m/s; 0 for that of the configuration.
fn in_si(speed: Option<f64>, kind: JointKind) -> f64 {
    speed.map_or(0.0, |speed| kind.si(speed))
}

/// A joint's position as the user writes it: in degrees or mm.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Target {
    joint: String,
    shown: f64,
    /// The unit, where the user wrote one.
    unit: Option<&'static str>,
}

pub(crate) fn target(text: &str) -> Result<Target, Problem> {
    let parsed = text.rsplit_once('=').and_then(|(joint, position)| {
        let position = position.trim();
        let with = |unit: &'static str| Some((position.strip_suffix(unit)?, Some(unit)));
        let (number, unit) = with("deg")
            .or_else(|| with("mm"))
            .unwrap_or((position, None));
        let shown: f64 = number.trim().parse().ok()?;
        let joint = joint.trim().to_owned();
        (shown.is_finite() && !joint.is_empty()).then_some(Target { joint, shown, unit })
    });
    let allowed = "a joint, = and an angle in degrees or of a prismatic joint a way in mm, as knee=60 or lift=250mm";
    parsed.ok_or_else(|| Problem::new(format!("{text:?} is no target"), allowed))
}

/// In degrees/s or mm/s.
fn speed(text: &str) -> Result<f64, Problem> {
    let speed = text
        .parse()
        .ok()
        .filter(|x: &f64| x.is_finite() && *x > 0.0);
    speed.ok_or_else(bad_speed)
}

pub(crate) fn bad_speed() -> Problem {
    Problem::new("not a speed", "above 0 degrees/s or mm/s")
}

pub(crate) fn run(arguments: &MoveArguments) -> ExitCode {
    match &arguments.preview {
        Some(config) => crate::output::finish_or_refuse(preview::preview(config, arguments)),
        None => end(go(arguments)),
    }
}

/// The targets by joint, rad or m, in the robot's order; none for joints that are not named.
pub(crate) fn by_joint(
    joints: &[(&str, JointKind)],
    targets: &[Target],
) -> Result<Vec<Option<f64>>, Problem> {
    let mut positions = vec![None; joints.len()];
    for target in targets {
        let found = joints.iter().zip(&mut positions);
        let found = found
            .into_iter()
            .find(|((name, _), _)| *name == target.joint);
        let Some(((name, kind), position)) = found else {
            let what = format!("the robot has no joint {:?}", target.joint);
            return Err(Problem::new(
                what,
                listed(joints.iter().map(|(name, _)| *name)),
            ));
        };
        let unit = kind.units("deg");
        if target.unit.is_some_and(|own| *own != *unit) {
            let what = format!("joint {name:?} is {}", kind.name());
            return Err(Problem::new(what, format!("{name}={}{unit}", target.shown)));
        }
        if position.replace(kind.si(target.shown)).is_some() {
            let what = format!("joint {:?} is named twice", target.joint);
            return Err(Problem::new(what, "one position for each joint"));
        }
    }
    Ok(positions)
}

/// A target beyond its joint's position limits, rad or m, is refused.
fn within(
    (name, kind): (&str, JointKind),
    to: f64,
    range: RangeInclusive<f64>,
) -> Result<(), Problem> {
    let shown = |x: &f64| kind.shown(*x);
    if range.contains(&to) {
        Ok(())
    } else {
        Err(Problem::new(
            format!("{name}={} is beyond its limits", shown(&to)),
            format!(
                "{:.1} to {:.1} {}",
                shown(range.start()),
                shown(range.end()),
                kind.units("deg")
            ),
        ))
    }
}

/// Allowed speeds, for one that was refused.
fn too_fast(speed: f64) -> Problem {
    Problem::new(
        format!("--speed {speed}: the robot does not move so"),
        "at most the velocity limit of every joint that is named (`torquectl check CONFIG` shows them), and no \
         speed so low that the way takes minutes",
    )
}

/// A motion that has ended.
pub(crate) struct Moved {
    /// It is at its target; else it was brought to rest on its way.
    pub(crate) arrived: bool,
    robot: String,
    /// Time that the motion was to take, s.
    duration: f64,
}

impl Moved {
    /// A sentence.
    pub(crate) fn words(&self) -> String {
        format!("there after {:.2} s; the robot holds", self.duration)
    }
}

fn go(arguments: &MoveArguments) -> Result<String, Failure> {
    let stop = catch_signals().map_err(Failure::Argument)?;
    let bar = bar();
    let mut whole = 0.0f64;
    let going = |left: Duration| {
        whole = whole.max(left.as_secs_f64());
        bar.set_length((1e3 * whole) as u64);
        bar.set_position((1e3 * (whole - left.as_secs_f64())) as u64);
        bar.set_message(format!("{:.1} s left", left.as_secs_f64()));
        !stop.load(Ordering::Relaxed)
    };
    let robot = arguments.robot.as_ref();
    let moved = move_to(robot, &arguments.targets, arguments.speed, going);
    bar.finish_and_clear();
    let moved = moved?;
    if !moved.arrived {
        let why = "stopped on its way";
        return Err(Failure::Stopped(why.to_owned()));
    }
    Ok(if arguments.json {
        format!(
            "{}\n",
            json!({ "robot": moved.robot, "duration_s": moved.duration })
        )
    } else {
        format!("{}\n", moved.words())
    })
}

/// Moves a running robot to the targets and waits; `speed`: the greatest of each joint, degrees/s or mm/s.
/// `going` is shown the time that is left, and says whether the motion is to go on.
pub(crate) fn move_to(
    robot: Option<&String>,
    targets: &[Target],
    speed: Option<f64>,
    mut going: impl FnMut(Duration) -> bool,
) -> Result<Moved, Failure> {
    let mut client = connect(robot)?;
    let description = *client.description();
    let joints = description.joint_names.iter().enumerate();
    let joints = joints.map(|(j, name)| (name.as_str(), description.joint_kind(j)));
    let joints: Vec<_> = joints.take(description.joint_count as usize).collect();
    let positions = by_joint(&joints, targets).map_err(Failure::Argument)?;
    let limits = (description.position_min.iter()).zip(&description.position_max);
    for ((joint, to), (min, max)) in joints.iter().zip(&positions).zip(limits) {
        to.map_or(Ok(()), |to| within(*joint, to, *min..=*max))
            .map_err(Failure::Argument)?;
    }
    // That of a joint that stays need not be one that it could move at.
    let speeds: Vec<f64> = (joints.iter().zip(&positions))
        .map(|((_, kind), to)| to.map_or(0.0, |_| in_si(speed, *kind)))
        .collect();
    let before = client.next_record(PATIENCE)?.cycle.measured;
    let mut commander = command(&mut client)?;
    let mut duration = 0.0f64;
    let change = |reference: &mut torqued_client::robot_state::Reference| {
        let joints = reference.joints.iter_mut().zip(&positions);
        for ((joint, position), speed) in joints.zip(speeds) {
            joint.q_d = position.unwrap_or(joint.q_d);
            joint.dq_d = speed;
        }
    };
    let arrived = commander.go_to(change, |left| {
        duration = duration.max(left.as_secs_f64());
        going(left)
    });
    let arrived = arrived.map_err(|error| match speed {
        Some(speed) => beyond_limits(error, || too_fast(speed)),
        None => Failure::Daemon(error),
    })?;
    commander.close()?;
    if arrived {
        let wanted: Vec<f64> = (positions.iter().zip(&before.joints))
            .map(|(to, before)| to.unwrap_or(before.q))
            .collect();
        confirm(&mut client, &joints, &positions, &wanted)?;
    }
    Ok(Moved {
        arrived,
        robot: client.robot().to_owned(),
        duration,
    })
}

/// Waits until every joint stands where it should, by its own encoders.
fn confirm(
    client: &mut Client,
    joints: &[(&str, JointKind)],
    asked: &[Option<f64>],
    wanted: &[f64],
) -> Result<(), Failure> {
    let settled = Instant::now() + SETTLES;
    loop {
        let record = client.next_record(PATIENCE)?;
        let astray = astray(joints, asked, wanted, &record.cycle);
        if astray.is_empty() {
            return Ok(());
        }
        if Instant::now() >= settled {
            return Err(Failure::Stopped(astray.join("; ")));
        }
    }
}

/// Joints that do not stand where they should, by their own encoders, in words: the end of a plan is not yet the end
/// of a motion.
fn astray(
    joints: &[(&str, JointKind)],
    asked: &[Option<f64>],
    wanted: &[f64],
    cycle: &CycleRecord,
) -> Vec<String> {
    let measured = cycle.measured.joints.iter().zip(wanted);
    let joints = joints.iter().zip(asked).zip(measured);
    let found = joints.filter_map(|(((name, kind), asked), (measured, wanted))| {
        let usable = measured.flags & (measured_flags::NEVER | measured_flags::STALE) == 0;
        let there = (measured.q - wanted).abs() <= kind.threshold(THERE);
        if usable && there {
            return None;
        }
        let unit = kind.units("deg");
        let stands = format!("{:.1} {unit}", kind.shown(measured.q));
        let whence = format!("{:.1}", kind.shown(*wanted));
        Some(match (usable, asked) {
            (false, _) => format!("joint `{name}` sends no samples: nobody knows where it stands"),
            (true, Some(_)) => {
                format!("joint `{name}` stands at {stands}, not at {whence}: it did not follow")
            }
            (true, None) => {
                format!("joint `{name}` moved from {whence} to {stands} though it was not asked to")
            }
        })
    });
    found.collect()
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
    if io::stderr().is_terminal() {
        ProgressBar::new_spinner()
    } else {
        ProgressBar::hidden()
    }
}

pub(crate) fn bar() -> ProgressBar {
    let bar = if io::stderr().is_terminal() {
        ProgressBar::new(1)
    } else {
        ProgressBar::hidden()
    };
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {msg}") {
        bar.set_style(style);
    }
    bar
}
