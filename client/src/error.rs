//! Errors between a client and the daemon, each with its remedy.

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use robot_state::{
    CommanderRecord, CommanderStatus, Event, RobotState, lease_refusal, not_followed, piece_refusal,
};

/// An error of a client's or the daemon's use of shared memory.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The run directory cannot be used.
    #[error("run directory {}: {reason}; set TORQUED_RUN_DIR to a directory of this user, the same for \
             daemon and clients", path.display())]
    RunDirectory {
        /// The directory.
        path: PathBuf,
        /// The defect.
        reason: String,
    },
    /// Shared memory is full.
    #[error(
        "shared memory is full: {needed} bytes are needed in /dev/shm, {free} are free; remove \
             files in /dev/shm that no process uses, or make it larger: \
             `mount -o remount,size=256M /dev/shm`"
    )]
    NoRoom {
        /// Bytes that are free.
        free: u64,
        /// Bytes that are needed.
        needed: u64,
    },
    /// Shared memory has no place for further files.
    #[error(
        "shared memory has no place for further files: {needed} are needed in /dev/shm, {free} can be \
             made; remove files in /dev/shm that no process uses, or allow more: \
             `mount -o remount,nr_inodes=1000000 /dev/shm`"
    )]
    NoFiles {
        /// Files that can be made.
        free: u64,
        /// Files that are needed.
        needed: u64,
    },
    /// Another user has made a file with a name of the run directory.
    #[error(
        "user {user} has made {}, a name that belongs to run directory {}: end that user's programs and \
             remove the file; a torqued that is started alone in this directory takes other names",
        file.display(), run_dir.display()
    )]
    ForeignFile {
        /// The file.
        file: PathBuf,
        /// The user's number.
        user: u32,
        /// The run directory.
        run_dir: PathBuf,
    },
    /// No daemon runs for that robot.
    #[error(
        "no torqued runs robot \"{robot}\": service {service} was not offered in {run_dir} for \
             {waited:?}; start `torqued run CONFIG` as this user (or set TORQUED_RUN_DIR to the \
             daemon's directory)"
    )]
    NoDaemon {
        /// The robot asked for.
        robot: String,
        /// The service that a daemon would offer.
        service: String,
        /// The run directory.
        run_dir: String,
        /// The time waited.
        waited: Duration,
    },
    /// The robot does not have that frame.
    #[error(
        "robot \"{robot}\" has {count} frames [[frame]] for mode Cartesian: there is none of index {frame}"
    )]
    NoFrame {
        /// The robot.
        robot: String,
        /// The index asked for.
        frame: usize,
        /// Frames of the robot.
        count: usize,
    },
    /// The daemon is there but no record arrives.
    #[error(
        "robot \"{robot}\": no record for {waited:?}; torqued has stopped or was killed: look at \
             its log and start it again"
    )]
    NoRecord {
        /// The robot.
        robot: String,
        /// The time waited.
        waited: Duration,
    },
    /// References or requests have no receiver any more.
    #[error(
        "robot \"{robot}\": its services have no receiver; torqued has stopped or was killed: look \
             at its log and start it again"
    )]
    Gone {
        /// The robot.
        robot: String,
    },
    /// No robot was named, and none or several run.
    #[error("{}", which_robot(running, run_dir))]
    WhichRobot {
        /// The robots that run.
        running: Vec<String>,
        /// The run directory.
        run_dir: PathBuf,
    },
    /// The two ends were built with different records.
    #[error(
        "service {service} carries {theirs}, but this program was built for {ours}: use a daemon \
             and a client of the same version"
    )]
    OtherLayout {
        /// The service.
        service: String,
        /// Type that the service carries.
        theirs: String,
        /// Type that this program was built for.
        ours: String,
    },
    /// Another client commands the robot.
    #[error(
        "robot \"{robot}\" is commanded by another client: process {pid} (session {session:016x}, \
             priority {priority}), for {held:.1?}; one at a time may command: stop that one first, \
             or ask with a higher priority"
    )]
    AlreadyCommanded {
        /// The robot.
        robot: String,
        /// Process of the other client.
        pid: u32,
        /// Its session.
        session: u64,
        /// Its priority.
        priority: u32,
        /// How long it has commanded.
        held: Duration,
    },
    /// This client no longer commands the robot.
    #[error("robot \"{robot}\": the command was lost: {reason}; ask for mode hold to get it again")]
    CommandLost {
        /// The robot.
        robot: String,
        /// How it was lost.
        reason: &'static str,
    },
    /// References are not followed, though this client commands the robot.
    #[error(
        "robot \"{robot}\": references are not followed: {}",
        why_not_followed(&status.commander, status.state).unwrap_or_default()
    )]
    NotFollowed {
        /// The robot.
        robot: String,
        /// The daemon's report.
        status: Box<CommanderStatus>,
    },
    /// A piece of a trajectory was refused.
    #[error(
        "robot \"{robot}\": a piece of the trajectory was refused: {}; the robot holds",
        why_piece_refused(*reason).unwrap_or_default()
    )]
    PieceRefused {
        /// The robot.
        robot: String,
        /// One of [`piece_refusal`].
        reason: u32,
    },
    /// A trajectory ended in motion.
    #[error(
        "robot \"{robot}\": the trajectory ended in motion: velocity or acceleration of its last point \
             was not 0, or the next points had not come in time; the robot was brought to rest"
    )]
    TrajectoryEnded {
        /// The robot.
        robot: String,
    },
    /// The greatest number of clients command, or try to.
    #[error("robot \"{robot}\": the greatest number of clients try to command it; try again later")]
    TooManyCommanders {
        /// The robot.
        robot: String,
    },
    /// The greatest number of clients have requests open.
    #[error(
        "robot \"{robot}\": the greatest number of clients have requests open; try again later"
    )]
    TooManyRequests {
        /// The robot.
        robot: String,
    },
    /// A request was not answered.
    #[error(
        "robot \"{robot}\": a request was not answered for {waited:?}; torqued has stopped or was \
             killed: look at its log and start it again"
    )]
    Unanswered {
        /// The robot.
        robot: String,
        /// The time waited since the last answer.
        waited: Duration,
    },
    /// The daemon has refused a request, and nothing has changed.
    #[error("{reason}")]
    Refused {
        /// Reason, and what is allowed.
        reason: String,
    },
    /// Another daemon runs the robot.
    #[error("robot \"{robot}\" is already run by another torqued; stop that one first")]
    AlreadyRunning {
        /// The robot.
        robot: String,
    },
    /// A client holds more records than it may.
    #[error(
        "this client holds {allowed} records, the greatest number allowed: drop or copy earlier ones \
             before asking for the next"
    )]
    TooManyRecordsHeld {
        /// The greatest number allowed.
        allowed: usize,
    },
    /// The daemon's publisher thread could not be started.
    #[error("cannot start the publisher thread: {reason}")]
    Thread {
        /// Message of the operating system.
        reason: String,
    },
    /// Shared memory failed in a way that has no better explanation.
    #[error("cannot {doing} service {service}: {reason}")]
    Transport {
        /// The service.
        service: String,
        /// The operation that failed.
        doing: &'static str,
        /// Message of the transport.
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
}

/// Why no mode of the commander is followed, and the next step; `state`: number of the robot's state.
/// None where modes are followed.
#[must_use]
pub fn why_not_followed(commander: &CommanderRecord, state: u32) -> Option<String> {
    let cause = Event::from_number(commander.cause);
    let state = RobotState::from_number(state).map_or("unknown", RobotState::name);
    Some(match (commander.not_followed, cause) {
        (0, _) => return None,
        (not_followed::FAULT, Some(event)) => format!(
            "fault {} {} is latched ({}); mend its cause, then `torquectl acknowledge` and \
             `torquectl enable`",
            event.number(),
            event.name(),
            event.cause()
        ),
        (not_followed::STATE, _) => {
            format!(
                "the robot is in state {state}, not in holding; `torquectl state` has the next step"
            )
        }
        (not_followed::HOLD_FIRST, Some(event)) => format!(
            "the robot holds after {} {} ({}); ask for mode hold first",
            event.number(),
            event.name(),
            event.cause()
        ),
        (not_followed::HOLD_FIRST, None) => {
            "the robot holds after an operator's request; ask for mode hold first".to_owned()
        }
        (not_followed::NOT_READY, _) => "the joints' filters are not full yet".to_owned(),
        (not_followed::NOT_POSSIBLE, Some(event)) => format!(
            "the mode needs a source that {} {} speaks against ({})",
            event.number(),
            event.name(),
            event.cause()
        ),
        (not_followed::NOT_POSSIBLE, None) => {
            "the mode needs F/T sensors or the IMU, which are not ready".to_owned()
        }
        _ => format!("the robot is in state {state}"),
    })
}

/// Why a client does not command: the words of a `lease_refusal`. None for 0.
#[must_use]
pub fn why_refused(reason: u32) -> Option<&'static str> {
    Some(match reason {
        0 => return None,
        lease_refusal::HELD => "another client of the same or a higher priority commands",
        lease_refusal::HOLD_FIRST => "its session did not command, and it did not ask for hold",
        lease_refusal::OLD_SESSION => "its session is older than one that has commanded since",
        lease_refusal::NOT_ADVANCED => "its sequence or its time of sending did not advance",
        lease_refusal::TOO_OLD => "it was sent longer ago than loop.reference_timeout_ms",
        _ => "its session is not valid",
    })
}

/// Why a piece of a trajectory is not followed: the words of a [`piece_refusal`]. None for 0.
#[must_use]
pub fn why_piece_refused(reason: u32) -> Option<&'static str> {
    Some(match reason {
        0 => return None,
        piece_refusal::SESSION => "its session does not command",
        piece_refusal::LIMIT => {
            "a point is beyond a joint's limits of position, velocity or acceleration, or not within \
             their reach from the one before"
        }
        piece_refusal::NOT_ADVANCED => "its sequence did not advance",
        piece_refusal::LATE => "its first point had passed already, or the trajectory had ended",
        piece_refusal::GAP => "its first point lies beyond the end of those before",
        piece_refusal::APART => "at its first point it is not where those before lead",
        piece_refusal::TOO_FAR => "it lies further ahead than a trajectory is buffered",
        piece_refusal::BUSY => "another trajectory is followed, and is not at rest",
        _ => "its joints, its points or their spacing are not valid, or a number is not finite",
    })
}

fn which_robot(running: &[String], run_dir: &Path) -> String {
    if running.is_empty() {
        return format!(
            "no torqued runs: no service torqued/<robot>/state in {}; start `torqued run CONFIG` as \
             this user (or set TORQUED_RUN_DIR to the daemon's directory)",
            run_dir.display()
        );
    }
    format!("several robots run; name one of: {}", running.join(", "))
}
