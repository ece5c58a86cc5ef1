//! What `torquectl` can still do where shared memory cannot be used: stop the robot, show its state.

use crate::requests::Failure;
use problem::Problem;
use serde_json::json;
use std::thread::sleep;
use std::time::{Duration, Instant};
use torqued_client::{Error, Location, RunningDaemon, running_daemons};

/// Period in which the daemon shows its state, and more.
const LOOK: Duration = Duration::from_millis(50);
/// Longest wait for rest: that of any configuration, and the daemon's grace.
const LIMIT: Duration = Duration::from_secs(65);
/// First words of the daemon's state in which the robot still moves, or may.
const MOVING: [&str; 4] = ["starting", "enabling", "active", "stopping"];

/// Stops the robot by a signal to its daemon, after the usual way has failed.
pub(crate) fn stop(why: Error, robot: Option<&String>, as_json: bool) -> Result<String, Failure> {
    // The daemon has answered, or the operator has to choose.
    if matches!(&why, Error::Refused { .. })
        || matches!(&why, Error::WhichRobot { running, .. } if running.len() > 1)
    {
        return Err(why.into());
    }
    let Some(daemon) = daemon(robot)? else {
        return Err(why.into());
    };
    eprintln!(
        "{why}\nthe daemon, process {}, is asked by a signal instead",
        daemon.pid
    );
    daemon.stop_and_hold().map_err(|e| {
        Failure::Stopped(format!(
            "process {} cannot be signalled: {e}; `systemctl stop torqued@{}`, or the emergency stop",
            daemon.pid, daemon.robot
        ))
    })?;
    let state = at_rest(&daemon)?;
    let text = format!("robot {:?} was stopped by a signal: {state}", daemon.robot);
    if !as_json {
        return Ok(format!("{text}\n"));
    }
    let object = json!({
        "robot": daemon.robot,
        "request": "stop",
        "text": text,
        "state": state.split([' ', ':']).next(),
        "by": "signal",
    });
    Ok(format!("{object}\n"))
}

/// Adds what can be known of the robot to the failure of the usual way.
pub(crate) fn state(why: Error, robot: Option<&String>) -> Failure {
    let found = daemon(robot).ok().flatten();
    match found.and_then(|daemon| Some((daemon.state()?, daemon))) {
        Some((state, daemon)) => Failure::Stopped(format!(
            "{why}\nrobot {:?} is run by process {}, which says: {state}\n`torquectl stop` reaches it \
             by a signal",
            daemon.robot, daemon.pid
        )),
        None => Failure::Daemon(why),
    }
}

/// The daemon of that robot, or the only one; none if none runs.
fn daemon(robot: Option<&String>) -> Result<Option<RunningDaemon>, Failure> {
    // A directory that cannot be read has the same answer as one without a daemon.
    let mut all = running_daemons(&Location::default_path()).unwrap_or_default();
    if let Some(robot) = robot {
        all.retain(|daemon| daemon.robot == *robot);
    }
    if all.len() > 1 {
        let names: Vec<&str> = all.iter().map(|daemon| daemon.robot.as_str()).collect();
        return Err(Failure::Argument(Problem::new(
            "several robots run, and --robot names none",
            names.join(", "),
        )));
    }
    Ok(all.pop())
}

/// Waits until the robot no longer moves, and gives its state.
fn at_rest(daemon: &RunningDaemon) -> Result<String, Failure> {
    let until = Instant::now() + LIMIT;
    // The state before the stop may still be shown.
    sleep(2 * LOOK);
    loop {
        sleep(LOOK);
        let Some(state) = daemon.state() else {
            return Err(Failure::Stopped(format!(
                "process {} has ended meanwhile: see that the robot is at rest",
                daemon.pid
            )));
        };
        let moves = MOVING.iter().any(|name| state.starts_with(name));
        if !moves {
            return Ok(state);
        }
        if Instant::now() > until {
            return Err(Failure::Stopped(format!(
                "robot {:?} is not at rest after {} s: {state}",
                daemon.robot,
                LIMIT.as_secs()
            )));
        }
    }
}
