//! `torquectl enable`, `disable`, `stop` and `acknowledge`: an operator's requests.

use crate::requests::{Failure, PATIENCE, connect, end};
use crate::{without_shared_memory, words};
use problem::Problem;
use serde_json::json;
use std::process::ExitCode;
use torqued_client::robot_state::{Event, Request, request};
use torqued_client::{Client, Error};

const EXIT_CODES: &str = "
Exit codes:
  0  done
  1  torqued refused and gave a reason, a time limit ended the wait, or torqued could not be reached
  2  bad input: arguments";

const ENABLE_HELP: &str = "\
Every joint must be plausible and within its position limits, and no fault may be latched. Each
joint is then held where it stands; a client may command once it has asked for hold.

Examples:
  torquectl enable
  torquectl enable --robot leg --json
";

const DISABLE_HELP: &str = "\
The drives no longer hold the robot: support it first. To bring a moving robot to rest, stop it.

Examples:
  torquectl stop && torquectl disable
";

const STOP_HELP: &str = "\
This is no emergency stop: it needs torqued, the buses and the drives. Where shared memory cannot be
used, torqued is asked by a signal: kill -USR1 PID or `systemctl reload torqued@ROBOT` do so too.

Examples:
  torquectl stop
";

const ACKNOWLEDGE_HELP: &str = "\
Without FAULT the latched fault is shown, then acknowledged. Programs name the fault, so that they
acknowledge none that they have not seen. The robot does not move: the next step is `torquectl enable`.

Examples:
  torquectl acknowledge
  torquectl acknowledge joint_stale
  torquectl acknowledge 104 --json
";

/// Switch the drives on and hold every joint where it stands.
#[derive(clap::Args)]
#[command(after_help = format!("{ENABLE_HELP}{EXIT_CODES}"))]
pub(crate) struct EnableArguments {
    #[command(flatten)]
    common: Common,
}

/// End all commands and switch the drives off, at once.
#[derive(clap::Args)]
#[command(after_help = format!("{DISABLE_HELP}{EXIT_CODES}"))]
pub(crate) struct DisableArguments {
    #[command(flatten)]
    common: Common,
}

/// Bring the robot to rest, then hold it; no client is followed before it has asked for hold.
#[derive(clap::Args)]
#[command(after_help = format!("{STOP_HELP}{EXIT_CODES}"))]
pub(crate) struct StopArguments {
    #[command(flatten)]
    common: Common,
}

/// Acknowledge the latched fault, whose cause has been mended.
#[derive(clap::Args)]
#[command(after_help = format!("{ACKNOWLEDGE_HELP}{EXIT_CODES}"))]
pub(crate) struct AcknowledgeArguments {
    /// Number or name of the fault; without it, the fault that is latched
    #[arg(value_name = "FAULT", value_parser = fault)]
    fault: Option<u32>,
    #[command(flatten)]
    common: Common,
}

#[derive(clap::Args)]
struct Common {
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn enable(arguments: &EnableArguments) -> ExitCode {
    end(ask("enable", request::ENABLE, &arguments.common))
}

pub(crate) fn disable(arguments: &DisableArguments) -> ExitCode {
    end(ask("disable", request::DISABLE, &arguments.common))
}

pub(crate) fn stop(arguments: &StopArguments) -> ExitCode {
    let common = &arguments.common;
    end(match ask("stop", request::STOP, common) {
        Err(Failure::Daemon(why)) => {
            without_shared_memory::stop(why, common.robot.as_ref(), common.json)
        }
        other => other,
    })
}

pub(crate) fn acknowledge(arguments: &AcknowledgeArguments) -> ExitCode {
    end(acknowledged(arguments))
}

fn ask(name: &str, kind: u32, arguments: &Common) -> Result<String, Failure> {
    let mut client = connect(arguments.robot.as_ref())?;
    let asked = Request {
        kind,
        ..Request::default()
    };
    Ok(send(&mut client, name, asked, arguments.json)?)
}

fn acknowledged(arguments: &AcknowledgeArguments) -> Result<String, Failure> {
    let mut client = connect(arguments.common.robot.as_ref())?;
    let fault = match arguments.fault {
        Some(fault) => fault,
        None => {
            let cycle = client.next_record(PATIENCE)?.cycle;
            if cycle.fault != 0 && !arguments.common.json {
                eprintln!("{}", words::fault(client.description(), &cycle));
            }
            cycle.fault
        }
    };
    let asked = Request {
        kind: request::ACKNOWLEDGE,
        fault,
        ..Request::default()
    };
    Ok(send(
        &mut client,
        "acknowledge",
        asked,
        arguments.common.json,
    )?)
}

/// Sends the request; shows what it waits for whenever that changes.
fn send(client: &mut Client, name: &str, asked: Request, json: bool) -> Result<String, Error> {
    let mut shown = String::new();
    let answer = client.send_request(asked, |working| {
        let waits = working.text.as_str();
        if !waits.is_empty() && waits != shown {
            eprintln!("waiting: {waits}");
            waits.clone_into(&mut shown);
        }
    })?;
    if !json {
        return Ok(format!("{}\n", answer.text));
    }
    // Those before the answer are skipped.
    client.latest()?;
    let cycle = client.next_record(PATIENCE)?.cycle;
    let object = json!({
        "robot": client.robot(),
        "request": name,
        "text": answer.text.as_str(),
        "state": words::state(cycle.state),
        "fault": cycle.fault,
    });
    Ok(format!("{object}\n"))
}

/// A fault's number, from its number or name.
fn fault(text: &str) -> Result<u32, Problem> {
    let named = |event: &&Event| event.name() == text || event.number().to_string() == text;
    let known = Event::ALL.iter().find(named);
    known.map(|event| event.number()).ok_or_else(|| {
        let faults = Event::ALL.iter().filter(|event| event.reaction().latches());
        let faults: Vec<String> = faults
            .map(|event| format!("{} {}", event.number(), event.name()))
            .collect();
        Problem::new(
            format!("there is no fault {text:?}"),
            format!(
                "the number or the name of one of {}, or of an event that [safety.reactions] makes a \
                 fault",
                faults.join(", ")
            ),
        )
    })
}
