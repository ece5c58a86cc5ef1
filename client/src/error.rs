//! What can go wrong between a client and the daemon, and what to do about it.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::prelude::Node;

use crate::channel::Transport;

/// Why a client or the daemon could not use shared memory.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// The run directory cannot be used.
    RunDirectory {
        /// The directory.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// No daemon runs for that robot.
    NoDaemon {
        /// The robot asked for.
        robot: String,
        /// The service that was looked for.
        service: String,
        /// Where it was looked for.
        run_dir: String,
        /// How long was waited.
        waited: Duration,
    },
    /// The daemon is there but no record arrives.
    Silent {
        /// The robot.
        robot: String,
        /// How long was waited.
        waited: Duration,
    },
    /// Nobody receives references or requests any more.
    Gone {
        /// The robot.
        robot: String,
    },
    /// No robot was named, and not exactly one runs.
    WhichRobot {
        /// The robots that run.
        running: Vec<String>,
        /// Where they were looked for.
        run_dir: PathBuf,
    },
    /// The two ends were built with different records.
    OtherLayout {
        /// The service.
        service: String,
        /// The type that the service carries.
        theirs: String,
        /// The type that this program knows.
        ours: String,
    },
    /// Another client commands the robot.
    AlreadyCommanded {
        /// The robot.
        robot: String,
    },
    /// As many clients as can are asking for something.
    TooManyAsking {
        /// The robot.
        robot: String,
    },
    /// A request was not answered.
    Unanswered {
        /// The robot.
        robot: String,
        /// How long was waited since the last answer.
        waited: Duration,
    },
    /// The daemon has refused a request, and nothing has changed.
    Refused {
        /// Why, and what is allowed.
        reason: String,
    },
    /// Another daemon runs the robot.
    AlreadyRunning {
        /// The robot.
        robot: String,
    },
    /// A client holds more records than it may.
    TooManyRecordsHeld {
        /// How many it may hold.
        allowed: usize,
    },
    /// The daemon's publisher thread could not be started.
    Thread {
        /// The system's own words.
        reason: String,
    },
    /// Shared memory failed in a way that has no better explanation.
    Transport {
        /// The service.
        service: String,
        /// What was tried.
        doing: &'static str,
        /// The transport's own words.
        reason: String,
    },
}

impl Error {
    pub(crate) fn transport(service: &str, doing: &'static str, reason: &dyn fmt::Debug) -> Self {
        Self::Transport {
            service: service.to_owned(),
            doing,
            reason: format!("{reason:?}"),
        }
    }

    pub(crate) fn no_daemon(
        robot: &str,
        node: &Node<Transport>,
        service: String,
        waited: Duration,
    ) -> Self {
        let run_dir = node.config().global.root_path().to_string();
        Self::NoDaemon {
            robot: robot.to_owned(),
            service,
            run_dir,
            waited,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::RunDirectory { path, reason } => write!(
                f,
                "run directory {}: {reason}; set TORQUED_RUN_DIR to a directory of this user, the \
                 same for daemon and clients",
                path.display()
            ),
            Self::NoDaemon {
                robot,
                service,
                run_dir,
                waited,
            } => write!(
                f,
                "no torqued runs robot \"{robot}\": nobody offered service {service} in {run_dir} \
                 for {waited:?}; start `torqued run CONFIG` as this user (or set TORQUED_RUN_DIR \
                 to the daemon's directory)"
            ),
            Self::Silent { robot, waited } => write!(
                f,
                "robot \"{robot}\": no record for {waited:?}; torqued has stopped or was killed: \
                 look at its log and start it again"
            ),
            Self::Gone { robot } => write!(
                f,
                "robot \"{robot}\": nobody listens; torqued has stopped or was killed: \
                 look at its log and start it again"
            ),
            Self::WhichRobot { running, run_dir } if running.is_empty() => write!(
                f,
                "no torqued runs: no service torqued/<robot>/state in {}; start `torqued run \
                 CONFIG` as this user (or set TORQUED_RUN_DIR to the daemon's directory)",
                run_dir.display()
            ),
            Self::WhichRobot { running, .. } => {
                write!(f, "several robots run; name one of: {}", running.join(", "))
            }
            Self::OtherLayout {
                service,
                theirs,
                ours,
            } => write!(
                f,
                "service {service} carries {theirs}, but this program was built for {ours}: use a \
                 daemon and a client of the same version"
            ),
            Self::AlreadyCommanded { robot } => write!(
                f,
                "robot \"{robot}\" is commanded by another client; one at a time may command: stop \
                 that one first"
            ),
            Self::TooManyAsking { robot } => write!(
                f,
                "robot \"{robot}\": as many clients as can are asking for something; try again \
                 later"
            ),
            Self::Unanswered { robot, waited } => write!(
                f,
                "robot \"{robot}\": a request was not answered for {waited:?}; torqued has stopped \
                 or was killed: look at its log and start it again"
            ),
            Self::Refused { reason } => f.write_str(reason),
            Self::AlreadyRunning { robot } => write!(
                f,
                "robot \"{robot}\" is already run by another torqued; stop that one first"
            ),
            Self::TooManyRecordsHeld { allowed } => write!(
                f,
                "{allowed} records are held at once, which is all that is allowed: drop or copy \
                 earlier ones before asking for the next"
            ),
            Self::Thread { reason } => write!(f, "cannot start the publisher thread: {reason}"),
            Self::Transport {
                service,
                doing,
                reason,
            } => {
                write!(f, "cannot {doing} service {service}: {reason}")
            }
        }
    }
}

impl std::error::Error for Error {}
