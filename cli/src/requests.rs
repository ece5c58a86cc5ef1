//! Connection, requests and failures of commands that need a running torqued.

use crate::output::finish;
use crate::{BAD_INPUT, NO_DAEMON};
use indicatif::{ProgressBar, ProgressStyle};
use problem::Problem;
use std::fmt::Display;
use std::io::{self, IsTerminal};
use std::process::ExitCode;
use std::time::Duration;
use torqued_client::robot_state::{Answer, Event};
use torqued_client::{Client, Commander, Error, Location, run_before_ordinary_programs};

/// Longest wait for a daemon or a record.
pub(crate) const PATIENCE: Duration = Duration::from_secs(2);

/// Failure of a command.
pub(crate) enum Failure {
    /// The daemon could not be reached, or has refused.
    Daemon(Error),
    /// An argument is wrong.
    Argument(Problem),
    /// The user has ended it; what it has done until then.
    Stopped(String),
}

impl From<Error> for Failure {
    fn from(e: Error) -> Self {
        Self::Daemon(e)
    }
}

/// The failure of references that were not followed: `why`, where they asked for more than the robot's limits allow.
pub(crate) fn beyond_limits(error: Error, why: impl FnOnce() -> Problem) -> Failure {
    match &error {
        Error::NotFollowed { status, .. }
            if status.commander.cause == Event::ReferenceLimit.number() =>
        {
            Failure::Argument(why())
        }
        _ => Failure::Daemon(error),
    }
}

/// Prints a command's result or failure.
pub(crate) fn end(result: Result<String, Failure>) -> ExitCode {
    let (why, code): (&dyn Display, u8) = match &result {
        Ok(text) => return finish(text),
        Err(Failure::Daemon(e)) => (e, NO_DAEMON),
        Err(Failure::Argument(problem)) => (problem, BAD_INPUT),
        Err(Failure::Stopped(what)) => (what, NO_DAEMON),
    };
    eprintln!("{why}");
    ExitCode::from(code)
}

/// The daemon that runs the robot, or the only one.
pub(crate) fn connect(robot: Option<&String>) -> Result<Client, Error> {
    let location = Location::find()?;
    let robot = match robot {
        Some(robot) => robot.clone(),
        None => location.only_robot()?,
    };
    Client::connect_at(&location, &robot, PATIENCE)
}

/// The command over the robot, which holds; kept on a busy machine where this process may have real-time priority.
pub(crate) fn command(client: &mut Client) -> Result<Commander, Error> {
    run_before_ordinary_programs();
    let mut commander = Commander::connect(client)?;
    commander.hold_until_ready(PATIENCE)?;
    Ok(commander)
}

/// Names of the robot's contact sets.
pub(crate) fn contact_names(client: &Client) -> Vec<&str> {
    let description = client.description();
    let names = description
        .contact_set_names
        .iter()
        .map(|name| name.as_str());
    names.take(description.contact_set_count as usize).collect()
}

/// Checks that the robot has the contact set.
pub(crate) fn check_contacts(client: &Client, name: &str, more: &str) -> Result<(), Failure> {
    let names = contact_names(client);
    if names.contains(&name) {
        return Ok(());
    }
    Err(Failure::Argument(Problem::new(
        format!("robot {:?} has no contact set {name:?}", client.robot()),
        format!("{}{more}", names.join(", ")),
    )))
}

/// Sends a request, with a progress bar on a terminal.
pub(crate) fn ask(client: &Client, kind: u32, contacts: &str) -> Result<Answer, Error> {
    let bar = if io::stderr().is_terminal() {
        ProgressBar::new(100)
    } else {
        ProgressBar::hidden()
    };
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent} %, keep the robot still") {
        bar.set_style(style);
    }
    let answer = client.request(kind, contacts, |working| {
        bar.set_position((100.0 * working.progress) as u64);
    });
    bar.finish_and_clear();
    answer
}
