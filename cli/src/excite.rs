//! `torquectl excite`: planned motions that show a robot's constants, checked as a whole before the
//! first of them, and recorded.
//!
//! The motions themselves and their checks are those of the crate excitation.

mod report;

use crate::motion::{Target, bar, by_joint, catch_signals, target};
use crate::output::{finish_or_refuse, read_input};
use crate::record::Recording;
use crate::requests::{Failure, PATIENCE, command, connect, end};
use excitation::{Part, PlanFile, Prepared, SPACING_S, SelfCheck, supposed};
use problem::{Problem, Problems};
pub(crate) use report::{figure, text};
use robot_config::Robot;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use torqued_client::{Client, Timing};

/// Period at which a recording is asked after.
const ASK: Duration = Duration::from_secs(1);

const HELP: &str = "\
The whole plan is checked before the robot moves: position, velocity, acceleration, torque (inverse
dynamics with the base held where it is), lead of the set-points, and the robot's distance to itself.
The robot goes to the plan's pose, follows the plan from points that are sent ahead, and holds in the
end. Ctrl-C brings it to rest. docs/excitation.md describes plans.

Examples:
  torquectl excite config/leg/excite.toml --dry-run
  torquectl excite config/leg/excite.toml --dry-run --from knee=20 --plot plan.svg
  torquectl excite config/leg/excite.toml --record run.mcap
  torquectl excite config/humanoid/excite-arms.toml --robot humanoid --record arms.mcap --json

Exit codes:
  0  done: followed to its end, or planned
  1  stopped on its way; torqued could not be reached, or did not follow
  2  bad input: arguments, plan or configuration, or a plan that the robot must not follow";

/// Move a robot as planned, so that its constants show, and record it.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct ExciteArguments {
    /// The plan
    #[arg(value_name = "PLAN.toml")]
    plan: PathBuf,
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Move nothing: plan and check
    #[arg(long, conflicts_with_all = ["robot", "record"])]
    dry_run: bool,
    /// Where joints are that the plan does not place, in degrees or mm [default: 0, or the nearest limit]
    #[arg(long, value_name = "JOINT=POSITION", requires = "dry_run", value_parser = target, num_args = 1..)]
    from: Vec<Target>,
    /// Draw the plan: positions, velocities and torques
    #[arg(long, visible_alias = "preview", value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Let the daemon record it
    #[arg(long, value_name = "RUN.mcap")]
    record: Option<PathBuf>,
    /// Replace the recording if it is there
    #[arg(long, requires = "record")]
    force: bool,
    /// Do not check the robot's distance to itself
    #[arg(long)]
    no_self_distance: bool,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &ExciteArguments) -> ExitCode {
    if arguments.dry_run {
        finish_or_refuse(dry_run(arguments))
    } else {
        match moved(arguments) {
            Ok(result) => end(result),
            Err(problems) => finish_or_refuse(Err(problems)),
        }
    }
}

/// The text of the robot's URDF, where its collision geometry is asked for.
///
/// # Errors
/// It cannot be read.
pub(crate) fn urdf_of(robot: &Robot, no_self_distance: bool) -> Result<Option<String>, Problem> {
    if no_self_distance {
        return Ok(None);
    }
    read_input(Path::new(&robot.parameters.urdf_path)).map(Some)
}

/// Moves the robot to the plan's pose and along the plan, recorded where `record` names a file and
/// whether it may be replaced; it holds in the end. Ends early, at rest, once `stop` is set: `false`
/// then. Gives the daemon's last words on the recording too.
///
/// # Errors
/// As [`torqued_client::Commander::follow`].
pub(crate) fn follow(
    client: &mut Client,
    prepared: &Prepared,
    record: Option<(&Path, bool)>,
    stop: &AtomicBool,
) -> Result<(bool, Option<String>), Failure> {
    // The daemon refuses it too, but only once the robot stands at the pose.
    if let Some((path, false)) = record
        && path.exists()
    {
        let problem = Problem::new("it is there already", "a new file, or --force");
        return Err(Failure::Argument(problem.at(path.display().to_string(), 0)));
    }
    let mut commander = command(client)?;
    let bar = bar();
    let duration = prepared.motion.duration();
    bar.set_length((1e3 * duration) as u64);
    bar.set_message("to the plan's pose");
    let arrived = commander.go_to(
        |reference| {
            for (joint, q) in reference.joints.iter_mut().zip(&prepared.pose) {
                joint.q_d = *q;
            }
        },
        |_| !stop.load(Ordering::Relaxed),
    )?;
    if !arrived {
        bar.finish_and_clear();
        return Ok((false, None));
    }
    // It begins with the first rest, while another thread renews the lease: a request takes its time.
    let (mut recording, mut refused) = (None, None);
    let timing = Timing {
        duration: Duration::from_secs_f64(duration),
        spacing: Duration::from_secs_f64(SPACING_S),
    };
    let mut asked = Instant::now();
    let mut lost = None;
    let followed = commander.follow(
        timing,
        |t, joints| {
            for (joint, planned) in joints.iter_mut().zip(prepared.motion.at(t)) {
                (joint.q_d, joint.dq_d, joint.ddq_d) = (planned.q, planned.dq, planned.ddq);
            }
        },
        |progress| {
            let time = progress.time.as_secs_f64();
            bar.set_position((1e3 * time) as u64);
            let title = prepared.motion.title((time / SPACING_S) as usize);
            bar.set_message(format!("{time:.0} of {duration:.0} s, {title}"));
            if let (Some((path, force)), None) = (record, &recording) {
                match Recording::begin(client, path, None, 0.0, Default::default(), force) {
                    Ok(begun) => recording = Some(begun),
                    Err(failure) => refused = Some(failure),
                }
            }
            // A recording that is not asked after ends; one that has ended is of no use.
            if let (Some(recording), true) = (&recording, asked.elapsed() > ASK) {
                asked = Instant::now();
                lost = match recording.state(client) {
                    Ok(answer) if answer.progress < 1.0 => None,
                    Ok(answer) => Some(answer.text.to_string()),
                    Err(error) => Some(error.to_string()),
                };
            }
            let goes_on = lost.is_none() && refused.is_none();
            goes_on && !stop.load(Ordering::Relaxed)
        },
    );
    bar.finish_and_clear();
    let closed = commander.close();
    if let Some(failure) = refused {
        return Err(failure);
    }
    if let Some(why) = lost {
        let what = format!("the recording has ended: {why}; the robot was brought to rest");
        return Err(Failure::Stopped(what));
    }
    let written = recording.map(|recording| recording.end(client)).transpose();
    let followed = followed?;
    closed?;
    Ok((followed, written?))
}

/// The plan, and the robot that it is for.
fn read(path: &Path) -> Result<(PlanFile, Robot), Problems> {
    let text = read_input(path)?;
    let name = path.display().to_string();
    let plan = PlanFile::parse(&text, &name)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let config = folder.join(&plan.config).display().to_string();
    let robot = robot_config::load(&config, &|path: &str| terminal::read_text(path))?;
    plan.check(&robot, &text, &name)?;
    Ok((plan, robot))
}

/// Where the plan begins: its pose, other joints as they are.
fn start(plan: &PlanFile, robot: &Robot, here: &[f64]) -> Vec<f64> {
    let joints = robot.parameters.joints.iter().zip(here);
    let place = joints.map(|(joint, here)| {
        let angle = plan.pose.get(&joint.name);
        angle.map_or(*here, |angle| joint.kind.si(*angle))
    });
    place.collect()
}

fn prepared(
    arguments: &ExciteArguments,
    plan: &PlanFile,
    robot: Robot,
    here: &[f64],
) -> Result<Prepared, Problems> {
    let parts: Vec<Part> = plan
        .parts
        .iter()
        .map(|part| part.get_ref().clone())
        .collect();
    let pose = start(plan, &robot, here);
    let urdf = urdf_of(&robot, arguments.no_self_distance)?;
    let check = match &urdf {
        Some(urdf) => SelfCheck::Done {
            urdf,
            given: plan.self_distance.as_ref(),
        },
        None => SelfCheck::LeftOut,
    };
    let bar = crate::motion::spinner();
    let prepared = excitation::prepare(robot, &parts, here, pose, check, &mut |text| {
        bar.set_message(text.to_owned());
    });
    bar.finish_and_clear();
    let prepared = prepared?;
    if let Some(path) = &arguments.plot {
        figure(&prepared).write(path)?;
    }
    Ok(prepared)
}

/// The running robot of a configuration, and where its joints are, rad. `file` is named where another
/// robot runs.
///
/// # Errors
/// No daemon, or that of another robot.
pub(crate) fn running(
    name: Option<&String>,
    robot: &Robot,
    file: &Path,
) -> Result<(Client, Vec<f64>), Failure> {
    let mut client = connect(name)?;
    if client.robot() != robot.parameters.name {
        let what = format!("this is of robot {:?}", robot.parameters.name);
        let problem = Problem::new(what, client.robot()).at(file.display().to_string(), 0);
        return Err(Failure::Argument(problem));
    }
    let record = client.next_record(PATIENCE)?;
    let joints = record.cycle.measured.joints.iter();
    let joints = joints.take(robot.parameters.joints.len());
    let here = joints.map(|joint| joint.q).collect();
    Ok((client, here))
}

fn dry_run(arguments: &ExciteArguments) -> Result<String, Problems> {
    let (plan, robot) = read(&arguments.plan)?;
    let joints = &robot.parameters.joints;
    let names = joints.iter().map(|joint| (joint.name.as_str(), joint.kind));
    let names: Vec<_> = names.collect();
    let from = by_joint(&names, &arguments.from)?;
    let pose = joints.iter().map(|joint| {
        plan.pose
            .get(&joint.name)
            .map(|angle| joint.kind.si(*angle))
    });
    let here = supposed(&robot, &from, &pose.collect::<Vec<_>>());
    let prepared = prepared(arguments, &plan, robot, &here)?;
    Ok(text(
        &prepared,
        arguments.no_self_distance,
        arguments.json,
        None,
    ))
}

fn moved(arguments: &ExciteArguments) -> Result<Result<String, Failure>, Problems> {
    let (plan, robot) = read(&arguments.plan)?;
    let stop = catch_signals()?;
    let (mut client, here) = match running(arguments.robot.as_ref(), &robot, &arguments.plan) {
        Ok(running) => running,
        Err(failure) => return Ok(Err(failure)),
    };
    let prepared = prepared(arguments, &plan, robot, &here)?;
    let record = arguments
        .record
        .as_deref()
        .map(|path| (path, arguments.force));
    let followed = follow(&mut client, &prepared, record, &stop);
    Ok(followed.and_then(|(done, recording)| {
        let text = text(
            &prepared,
            arguments.no_self_distance,
            arguments.json,
            Some((done, recording.as_deref())),
        );
        if done {
            Ok(text)
        } else {
            Err(Failure::Stopped(format!(
                "{text}stopped on its way; the robot holds"
            )))
        }
    }))
}
