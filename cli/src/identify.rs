//! `torquectl identify drive`: a joint's drive and motor from its own motion, recorded before or made now.

pub(crate) mod found;
mod moving;
mod page;

use crate::calibrate::runs::robot;
use crate::motion::{Target, target};
use crate::output::{apart, finish_or_refuse};
use crate::recorded;
use crate::requests::end;
use clap::{Args, Subcommand, ValueEnum};
use found::{Found, Motor};
use identification::drive::recorded::{DriveSample, Gather, knowledge, motor_rows};
use identification::drive::{DriveKnowledge, DriveLog, identify};
use identification::motor::{self, Method};
use problem::{Problem, Problems, listed};
use recording::Ending;
use robot_config::JointParameters;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Identify parts of a robot from its own motion
#[derive(Args)]
pub(crate) struct IdentifyArguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Drive(DriveArguments),
}

const EXAMPLES: &str = "\
With --config the joint of the running robot is moved, 23 s in all: a slow swing of 2 degrees or 3.5 mm, and sweeps up
to 25 Hz with a fifth of its velocity limit and at most 30 % of the acceleration that its torque limit
gives, checked as torquectl excite checks a plan before anything moves, and recorded. Ctrl-C brings it to
rest. Without it, recordings of such a motion are read (docs/drive-identification.md).

Values come with 95 % intervals beside those of the configuration that was in use; robot.toml itself is
never changed: -o writes the keys to change. What the motion does not determine is said, and left as
configured.

Models of D 3, of command against torque and velocity, beside the drive's own parameters:
  least-squares  D7          asymmetric  D8 by Newton's method, and D9 as a quadratic program
  piecewise      D 3.2.2     two-stage   D 3.3.1: at rest, then in motion

Examples:
  torquectl identify drive --joint knee --config config/leg/robot.toml --dry-run --plot knee.svg
  torquectl identify drive --joint knee --config config/leg/robot.toml --pose hip_pitch=-20 knee=40
  torquectl identify drive run.mcap --joint knee
  torquectl identify drive run.mcap --joint knee --model asymmetric -o knee.toml
  torquectl identify drive monday.mcap tuesday.mcap --joint knee --json --report knee.html

Exit codes:
  0  identified
  1  stopped on its way; torqued could not be reached, or did not follow
  2  bad input: arguments, a motion that the robot must not follow, or a recording in which the joint
     did not move under command";

/// Identify stiffness, damping, dead zone, inertia, friction and delay of a joint's drive
#[derive(Args)]
#[command(after_help = EXAMPLES)]
struct DriveArguments {
    /// Recordings of the joint in motion, instead of moving it
    #[arg(required_unless_present = "config", value_name = "RUN.mcap")]
    runs: Vec<PathBuf>,
    /// Move the joint of the running robot with this configuration
    #[arg(long, value_name = "CONFIG", conflicts_with = "runs")]
    config: Option<PathBuf>,
    /// Where joints are during the motion, in degrees or mm [default: where they are, or as far from a limit
    /// as the motion needs]
    #[arg(long, value_name = "JOINT=POSITION", requires = "config", value_parser = target, num_args = 1..)]
    pose: Vec<Target>,
    /// The recording that is made [default: drive-JOINT.mcap]
    #[arg(long, value_name = "RUN.mcap", requires = "config")]
    record: Option<PathBuf>,
    /// Replace the recording if it is there
    #[arg(long, requires = "config")]
    force: bool,
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME", requires = "config")]
    robot: Option<String>,
    /// Move nothing: plan and check
    #[arg(long, requires = "config", conflicts_with_all = ["robot", "record", "model", "report", "output"])]
    dry_run: bool,
    /// Where joints are before the motion, in degrees or mm [default: 0, or the nearest limit]
    #[arg(long, value_name = "JOINT=POSITION", requires = "dry_run", value_parser = target, num_args = 1..)]
    from: Vec<Target>,
    /// Draw the motion: positions, velocities and torques
    #[arg(long, requires = "config", value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Do not check the robot's distance to itself
    #[arg(long, requires = "config")]
    no_self_distance: bool,
    /// The joint
    #[arg(long, value_name = "NAME")]
    joint: String,
    /// Identify the motor by a model of D 3, too
    #[arg(long, value_enum)]
    model: Option<Model>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Write a page with figures
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Write the keys of robot.toml to change
    #[arg(short, long, value_name = "FILE.toml")]
    output: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Model {
    LeastSquares,
    Piecewise,
    Asymmetric,
    TwoStage,
}

/// Rows of D's models at most.
const MOTOR_ROWS: usize = 4000;

pub(crate) fn run(arguments: &IdentifyArguments) -> ExitCode {
    match &arguments.what {
        What::Drive(arguments) => match &arguments.config {
            Some(config) if arguments.dry_run => {
                finish_or_refuse(moving::dry_run(arguments, config))
            }
            Some(config) => match moving::record(arguments, config) {
                Ok(Ok((run, followed))) => {
                    eprint!("{followed}");
                    finish_or_refuse(drive(arguments, &[run]))
                }
                Ok(Err(failure)) => end(Err(failure)),
                Err(problems) => finish_or_refuse(Err(problems)),
            },
            None => finish_or_refuse(drive(arguments, &arguments.runs)),
        },
    }
}

fn drive(arguments: &DriveArguments, runs: &[PathBuf]) -> Result<String, Problems> {
    let outputs = [&arguments.output, &arguments.report, &arguments.plot];
    for output in outputs.into_iter().flatten() {
        apart(output, runs)?;
    }
    let mut read: Option<Recorded> = None;
    let mut remarks = Vec::new();
    for path in runs {
        let (next, remark) = Recorded::read(path, &arguments.joint)?;
        remarks.extend(remark);
        match &mut read {
            Some(first) if first.known == next.known && first.log.period == next.log.period => {
                first.log.stretches.extend(next.log.stretches);
            }
            Some(_) => {
                let reason =
                    "its configuration of the drive differs from that of the first recording";
                let problem = Problem::new(reason, "recordings with one configuration");
                return Err(problem.at(path.display().to_string(), 0).into());
            }
            None => read = Some(next),
        }
    }
    let Some(Recorded { known, joint, log }) = read else {
        return Err(Problem::new("no recording", "RUN.mcap").into());
    };
    let file = runs[0].display().to_string();
    let mut drive = identify(&known, &log).map_err(|Problems(problems)| {
        let of_joint = |p: Problem| p.of(&arguments.joint).or_at(&file, 0);
        Problems(problems.into_iter().map(of_joint).collect())
    })?;
    drive.notes.splice(0..0, remarks);
    let motor = arguments
        .model
        .map(|model| fit(model, &log, &known))
        .transpose()?;
    let files = runs.iter().map(|p| p.display().to_string()).collect();
    let found = Found {
        joint: &joint,
        known: &known,
        drive: &drive,
        motor,
        files,
    };
    if let Some(path) = &arguments.output {
        terminal::write_file(path, &found.toml())?;
    }
    if let Some(path) = &arguments.report {
        terminal::write_file(path, &page::html(&found, &log)?)?;
    }
    Ok(if arguments.json {
        format!("{:#}\n", found.json())
    } else {
        found.text()
    })
}

fn fit(model: Model, log: &DriveLog, known: &DriveKnowledge) -> Result<Motor, Problem> {
    let rows = motor_rows(log, known, MOTOR_ROWS);
    Ok(match model {
        Model::LeastSquares => {
            Motor::Linear(motor::fit(&rows, Method::LeastSquares)?, "least squares")
        }
        Model::TwoStage => Motor::Linear(motor::fit(&rows, Method::TwoStage)?, "two stages"),
        Model::Asymmetric => Motor::Asymmetric {
            newton: motor::fit(&rows, Method::Asymmetric)?,
            program: motor::fit(&rows, Method::QuadraticProgram)?,
        },
        Model::Piecewise => {
            let linear = motor::fit(&rows, Method::LeastSquares)?;
            Motor::Piecewise(linear, motor::piecewise(&rows, linear.x[1])?)
        }
    })
}

/// A joint's log from a recording, and what its configuration states.
struct Recorded {
    known: DriveKnowledge,
    joint: JointParameters,
    log: DriveLog,
}

impl Recorded {
    fn read(path: &Path, name: &str) -> Result<(Self, Option<String>), Problems> {
        let mut run = recorded::open_with_inputs(path)?;
        let header = run.header().clone();
        let robot = robot(&header, &[], None)?;
        let joints = &robot.parameters.joints;
        let Some(index) = joints.iter().position(|joint| joint.name == name) else {
            let names = listed(joints.iter().map(|joint| joint.name.as_str()));
            let problem = Problem::new(format!("--joint: the robot has no joint {name:?}"), names);
            return Err(problem.into());
        };
        let mut gather = Gather::new(&joints[index], header.period_s);
        let mut begin = None;
        let ending = recorded::read_all(path, &mut run, |_, message| {
            let sync = message.at.sync.0;
            let t = recorded::ms_between(*begin.get_or_insert(sync), sync) * 1e-3;
            let since_sync = recorded::ms_between(sync, message.at.now.0) * 1e-3;
            if let Some(sample) = DriveSample::of(&message.record.cycle, index, since_sync) {
                gather.take(t, &sample);
            }
            Ok(())
        })?;
        let remark = (ending != Ending::Complete)
            .then(|| recorded::describe_ending(&ending).trim_end().to_owned());
        let this = Self {
            known: knowledge(&joints[index]),
            joint: joints[index].clone(),
            log: gather.end(),
        };
        Ok((this, remark))
    }
}
