//! `torquectl passive`: joints that a hand can move.

use crate::motion::{bar, catch_signals};
use crate::requests::{Failure, PATIENCE, command, connect, end};
use problem::{Problem, listed};
use serde_json::json;
use std::fmt::Write as _;
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::thread::sleep;
use std::time::{Duration, Instant};
use torqued_client::Client;

const HELP: &str = "\
The joints that are named carry their own weight and give way to a hand; all others hold. A joint that
bears a contact is not let go, and no joint gets faster than torque_velocity_limit_rad_per_s. What hangs on
the robot must be in its model, or it sinks. The robot must be enabled; in the end it holds where it was left.
Ctrl-C ends it.

Examples:
  torquectl passive knee hip_pitch                 until Ctrl-C
  torquectl passive --all --seconds 30
  torquectl passive knee --seconds 10 --json       where the joints were left

Exit codes:
  0  done; the robot holds
  1  torqued could not be reached, or did not follow: the joint bears a contact, for example
  2  bad input: arguments, or a joint that the robot does not have";

/// Let joints of an enabled robot be moved by hand, and show where they were left
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct PassiveArguments {
    /// Joints that are let go
    #[arg(value_name = "JOINT", required_unless_present = "all")]
    joints: Vec<String>,
    /// Let all joints go
    #[arg(long, conflicts_with = "joints")]
    all: bool,
    /// Time until the end, s [default: until Ctrl-C]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    seconds: Option<f64>,
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Interval of references.
const INTERVAL: Duration = Duration::from_millis(4);

fn seconds(text: &str) -> Result<f64, Problem> {
    let seconds = text.parse().ok().filter(|x| (1e-3..1e6).contains(x));
    seconds.ok_or_else(|| Problem::new("not a time", "above 0 s, below 1e6 s"))
}

pub(crate) fn run(arguments: &PassiveArguments) -> ExitCode {
    end(go(arguments))
}

fn joint_names(client: &Client) -> Vec<String> {
    let description = client.description();
    let names = description
        .joint_names
        .iter()
        .map(|name| name.as_str().to_owned());
    names.take(description.joint_count as usize).collect()
}

fn go(arguments: &PassiveArguments) -> Result<String, Failure> {
    let stop = catch_signals().map_err(Failure::Argument)?;
    let mut client = connect(arguments.robot.as_ref())?;
    let names = joint_names(&client);
    let mut let_go = Vec::new();
    for name in &arguments.joints {
        let joint = names.iter().position(|own| own == name);
        let_go.push(joint.ok_or_else(|| {
            let what = format!("robot {:?} has no joint {name:?}", client.robot());
            let allowed = listed(names.iter().map(String::as_str));
            Failure::Argument(Problem::new(what, allowed))
        })?);
    }
    if arguments.all {
        let_go = (0..names.len()).collect();
    }
    let mut commander = command(&mut client)?;
    let begin = commander.reference().joints;
    let bar = bar();
    bar.set_length(
        arguments
            .seconds
            .map_or(0, |seconds| (1e3 * seconds) as u64),
    );
    let since = Instant::now();
    let lasts = || {
        arguments
            .seconds
            .is_none_or(|s| since.elapsed().as_secs_f64() < s)
    };
    while !stop.load(Ordering::Relaxed) && lasts() {
        commander.let_go(&let_go)?;
        sleep(INTERVAL);
        bar.set_position(since.elapsed().as_millis() as u64);
        bar.set_message(match arguments.seconds {
            Some(seconds) => format!("{:.1} s left", seconds - since.elapsed().as_secs_f64()),
            None => "until Ctrl-C".to_owned(),
        });
    }
    bar.finish_and_clear();
    commander.close()?;
    let left = client.next_record(PATIENCE)?.cycle.measured.joints;
    let description = client.description();
    let kind = |j: usize| description.joint_kind(j);
    if arguments.json {
        let joints = let_go.iter().map(|&j| {
            let (from, to) = (begin[j].q_d, left[j].q);
            json!({ "joint": names[j], "from_rad": from, "to_rad": to })
        });
        let joints: Vec<_> = joints.collect();
        let object = json!({ "robot": client.robot(), "joints": joints });
        return Ok(format!("{object}\n"));
    }
    let mut text = String::new();
    for &j in &let_go {
        let (from, to) = (kind(j).shown(begin[j].q_d), kind(j).shown(left[j].q));
        let unit = kind(j).units("deg");
        let _ = writeln!(text, "{}: {from:.2} -> {to:.2} {unit}", names[j]);
    }
    text += "the robot holds\n";
    Ok(text)
}
