//! What the page may ask of the robot, with the command line's refusals.

use crate::motion::{self, Target};
use crate::requests::{Failure, connect};
use crate::without_shared_memory;
use problem::Problem;
use serde::Deserialize;
use std::sync::atomic::{AtomicU64, Ordering};
use torqued_client::robot_state::{Request, request};

/// A page's wish.
#[derive(Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Wish {
    Enable,
    Disable,
    Stop,
    Acknowledge { fault: u32 },
    Move { targets: String, speed: Option<f64> },
}

/// Carries out wishes on one robot.
pub(super) struct Control {
    robot: String,
    /// Stops so far: each ends the motions that were begun before it.
    stops: AtomicU64,
}

impl Control {
    pub(super) fn new(robot: String) -> Self {
        Self {
            robot,
            stops: AtomicU64::new(0),
        }
    }

    /// Carries out a wish, which may take as long as a motion; what was done, or why not.
    pub(super) fn carry_out(&self, wish: Wish) -> Result<String, String> {
        let kind = match wish {
            Wish::Move { targets, speed } => return self.go(&targets, speed).map_err(words),
            Wish::Enable => request::ENABLE,
            Wish::Disable => request::DISABLE,
            Wish::Stop => request::STOP,
            Wish::Acknowledge { .. } => request::ACKNOWLEDGE,
        };
        let fault = match wish {
            Wish::Acknowledge { fault } => fault,
            _ => 0,
        };
        if kind == request::STOP || kind == request::DISABLE {
            self.stops.fetch_add(1, Ordering::Relaxed);
        }
        let asked = Request {
            kind,
            fault,
            ..Request::default()
        };
        let client = connect(Some(&self.robot));
        match client.and_then(|client| client.send_request(asked, |_| ())) {
            Ok(answer) => Ok(answer.text.to_string()),
            // As on the command line, a stop turns to a signal where shared memory fails.
            Err(why) if kind == request::STOP => {
                let stopped = without_shared_memory::stop(why, Some(&self.robot), false);
                stopped
                    .map(|text| text.trim_end().to_owned())
                    .map_err(words)
            }
            Err(why) => Err(why.to_string()),
        }
    }

    fn go(&self, targets: &str, speed: Option<f64>) -> Result<String, Failure> {
        let before = self.stops.load(Ordering::Relaxed);
        let targets = targets.split_whitespace().map(motion::target);
        let targets: Vec<Target> = targets
            .collect::<Result<_, Problem>>()
            .map_err(Failure::Argument)?;
        if targets.is_empty() {
            let problem = Problem::new("no joint is named", "e.g. knee=60 ankle_pitch=-30");
            return Err(Failure::Argument(problem));
        }
        if speed.is_some_and(|speed| !(speed.is_finite() && speed > 0.0)) {
            return Err(Failure::Argument(motion::bad_speed()));
        }
        let going = |_| self.stops.load(Ordering::Relaxed) == before;
        let moved = motion::move_to(Some(&self.robot), &targets, speed, going)?;
        if moved.arrived {
            Ok(moved.words())
        } else {
            Err(Failure::Stopped("stopped on its way".to_owned()))
        }
    }
}

fn words(failure: Failure) -> String {
    match failure {
        Failure::Daemon(error) => error.to_string(),
        Failure::Argument(problem) => problem.to_string(),
        Failure::Stopped(what) => what,
    }
}
