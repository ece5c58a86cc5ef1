//! `torquectl state`: what the robot does, what keeps it from doing more, and the next step.

use crate::requests::{Failure, PATIENCE, connect, end};
use crate::{without_shared_memory, words};
use serde_json::{Value, json};
use std::fmt::Write;
use std::process::ExitCode;
use torqued_client::robot_state::{
    CycleRecord, Description, DriveState, Event, RobotState, command_flags,
};

const HELP: &str = "\
States: boot (listens), ready (drives off), enabling, holding, active (a client's mode), stopping,
fault (latched until it is acknowledged).

Examples:
  torquectl state
  torquectl state --json | jq -r .state

Exit codes:
  0  shown, whatever the state
  1  torqued could not be reached
  2  bad input: arguments";

/// Show the state of a running robot, its fault, and the next step.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct StateArguments {
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &StateArguments) -> ExitCode {
    end(state(arguments))
}

fn state(arguments: &StateArguments) -> Result<String, Failure> {
    let robot = arguments.robot.as_ref();
    let client = connect(robot).map_err(|why| without_shared_memory::state(why, robot));
    let mut client = client?;
    client.latest()?;
    let record = client.next_record(PATIENCE)?;
    let (description, cycle) = (client.description(), &record.cycle);
    Ok(if arguments.json {
        format!("{}\n", object(description, cycle))
    } else {
        text(description, cycle)
    })
}

fn text(description: &Description, cycle: &CycleRecord) -> String {
    let mut out = format!(
        "{}: {}, mode {}\n{}\n",
        description.robot,
        words::state(cycle.state),
        words::mode(cycle.mode),
        words::fault(description, cycle),
    );
    for (name, obstacle) in obstacles(description, cycle) {
        let _ = writeln!(out, "joint {name} {obstacle}");
    }
    let _ = writeln!(out, "next: {}", next_step(description, cycle));
    out
}

/// The state for programs.
pub(crate) fn object(description: &Description, cycle: &CycleRecord) -> Value {
    let joints = obstacles(description, cycle);
    let joints: Vec<Value> = joints
        .map(|(name, obstacle)| json!({ "name": name, "obstacle": obstacle }))
        .collect();
    let fault = Event::from_number(cycle.fault).map(|event| {
        json!({
            "number": event.number(),
            "name": event.name(),
            "subject": words::fault_subject(description, cycle),
            "cause": event.cause(),
            "config_key": words::config_key(description, cycle, event),
        })
    });
    let engaged = cycle.commanded.joints.iter();
    let engaged = engaged.filter(|joint| joint.flags & command_flags::ENGAGED != 0);
    json!({
        "robot": description.robot.as_str(),
        "state": words::state(cycle.state),
        "mode": words::mode(cycle.mode),
        "possible_modes": words::possible_modes(cycle),
        "fault": fault,
        "joints": cycle.joint_count,
        "joints_engaged": engaged.count(),
        "obstacles": joints,
        "next": next_step(description, cycle),
    })
}

/// The joints that keep the robot from being enabled, and how.
fn obstacles<'a>(
    description: &'a Description,
    cycle: &'a CycleRecord,
) -> impl Iterator<Item = (&'a str, String)> {
    let joints = cycle.measured.joints.iter().enumerate();
    let joints = joints.take(cycle.joint_count as usize);
    joints.filter_map(|(j, joint)| {
        let [min, max] = [description.position_min[j], description.position_max[j]];
        let outside = !(min..=max).contains(&joint.q);
        let kind = description.joint_kind(j);
        let unit = kind.units("deg");
        let obstacle = match joint.defect() {
            Some(defect) => defect.to_owned(),
            None if cycle.commanded.joints[j].drive_state == DriveState::Fault.number() => {
                format!(
                    "its drive reports a fault of its own, status word {:#x}",
                    joint.status
                )
            }
            None if outside => format!(
                "stands outside its position limits: {:.1} {unit}, allowed {:.1} to {:.1} {unit}",
                kind.shown(joint.q),
                kind.shown(min),
                kind.shown(max)
            ),
            None => return None,
        };
        Some((description.joint_names[j].as_str(), obstacle))
    })
}

/// Next step of the operator.
fn next_step(description: &Description, cycle: &CycleRecord) -> &'static str {
    let blocked = obstacles(description, cycle).next().is_some();
    match RobotState::from_number(cycle.state) {
        Some(RobotState::Boot) if blocked => {
            "see that the joints named above send plausible samples: drives on, bus, encoders"
        }
        Some(RobotState::Boot) => "wait: every joint is to be plausible for some time",
        Some(RobotState::Ready) if blocked => {
            "move the joints named above inside their limits, or mend their drives"
        }
        Some(RobotState::Ready) => "torquectl enable",
        Some(RobotState::Enabling | RobotState::Stopping) => "wait: it has a time limit",
        Some(RobotState::Holding) => "start a client, or torquectl disable",
        Some(RobotState::Active) => "torquectl stop, to end the client's mode",
        Some(RobotState::Fault) => "mend the cause, then torquectl acknowledge",
        None => "use a torquectl of the daemon's version",
    }
}
