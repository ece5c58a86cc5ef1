//! Results of functions: codes, and the words of the last error.

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use torqued_client::Error;

/// Result of a function. Numbers keep their meaning in later versions.
#[repr(i32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Code {
    /// It is done.
    Ok = 0,
    /// An argument cannot be used: a null pointer, a text that is not UTF-8, a negative time.
    Argument = 1,
    /// The run directory cannot be used.
    RunDirectory = 2,
    /// Shared memory is full.
    NoRoom = 3,
    /// No daemon runs for that robot.
    NoDaemon = 4,
    /// The robot does not have that frame.
    NoFrame = 5,
    /// No record has arrived in time.
    NoRecord = 6,
    /// The daemon has stopped or was killed.
    Gone = 7,
    /// No robot was named, and none or several run.
    WhichRobot = 8,
    /// Daemon and client are of different versions.
    OtherLayout = 9,
    /// Another client commands the robot.
    AlreadyCommanded = 10,
    /// This client no longer commands the robot; ask for mode hold to get it again.
    CommandLost = 11,
    /// References are not followed, though this client commands the robot.
    NotFollowed = 12,
    /// A piece of a trajectory was refused; the robot holds.
    PieceRefused = 13,
    /// A trajectory ended in motion; the robot was brought to rest.
    TrajectoryEnded = 14,
    /// The greatest number of clients command, or try to.
    TooManyCommanders = 15,
    /// The greatest number of clients have requests open.
    TooManyRequests = 16,
    /// A request was not answered.
    Unanswered = 17,
    /// The daemon has refused a request, and nothing has changed.
    Refused = 18,
    /// Any other error of shared memory or of the operating system.
    Transport = 19,
    /// A defect of this library.
    Panicked = 20,
}

impl Code {
    fn of(error: &Error) -> Self {
        match error {
            Error::RunDirectory { .. } | Error::ForeignFile { .. } => Self::RunDirectory,
            Error::NoRoom { .. } | Error::NoFiles { .. } => Self::NoRoom,
            Error::NoDaemon { .. } => Self::NoDaemon,
            Error::NoFrame { .. } => Self::NoFrame,
            Error::NoRecord { .. } => Self::NoRecord,
            Error::Gone { .. } => Self::Gone,
            Error::WhichRobot { .. } => Self::WhichRobot,
            Error::OtherLayout { .. } => Self::OtherLayout,
            Error::AlreadyCommanded { .. } => Self::AlreadyCommanded,
            Error::CommandLost { .. } => Self::CommandLost,
            Error::NotFollowed { .. } => Self::NotFollowed,
            Error::PieceRefused { .. } => Self::PieceRefused,
            Error::TrajectoryEnded { .. } => Self::TrajectoryEnded,
            Error::TooManyCommanders { .. } => Self::TooManyCommanders,
            Error::TooManyRequests { .. } => Self::TooManyRequests,
            Error::Unanswered { .. } => Self::Unanswered,
            Error::Refused { .. } => Self::Refused,
            _ => Self::Transport,
        }
    }
}

/// Why a function did not do its work.
pub(crate) struct Failure {
    code: Code,
    words: String,
}

impl Failure {
    pub(crate) fn argument(words: impl Into<String>) -> Self {
        Self {
            code: Code::Argument,
            words: words.into(),
        }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self {
            code: Code::of(&error),
            words: error.to_string(),
        }
    }
}

thread_local! {
    static MESSAGE: RefCell<CString> = RefCell::default();
}

/// Runs the body of a function: its error becomes a code and words, and so does a panic.
pub(crate) fn guard(body: impl FnOnce() -> Result<(), Failure>) -> Code {
    // What a panic has left half done belongs to the handle that the caller has to close.
    let failure = match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => return Code::Ok,
        Ok(Err(failure)) => failure,
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
            Failure {
                code: Code::Panicked,
                words: format!("defect of libtorqued: {}", text.unwrap_or("no message")),
            }
        }
    };
    let words = CString::new(failure.words.replace('\0', " ")).unwrap_or_default();
    MESSAGE.with(|message| *message.borrow_mut() = words);
    failure.code
}

/// Words of the last error that a function of this thread has returned, with its remedy, as UTF-8. They
/// are valid until the thread's next error; empty before the first one.
#[unsafe(no_mangle)]
pub extern "C" fn torqued_message() -> *const c_char {
    MESSAGE.with(|message| message.borrow().as_ptr())
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::*;

    fn message() -> String {
        // SAFETY: the pointer is valid until this thread's next error.
        let words = unsafe { CStr::from_ptr(torqued_message()) };
        words.to_string_lossy().into_owned()
    }

    #[test]
    fn a_panic_is_a_code_with_its_words() {
        assert_eq!(guard(|| panic!("no {}", "moon")), Code::Panicked);
        assert_eq!(message(), "defect of libtorqued: no moon");
    }

    #[test]
    fn an_error_keeps_its_words() {
        let refused = || {
            let reason = "no moon; allowed: standing".to_owned();
            Err(Error::Refused { reason }.into())
        };
        assert_eq!(guard(refused), Code::Refused);
        assert_eq!(message(), "no moon; allowed: standing");
        assert_eq!(guard(|| Ok(())), Code::Ok);
        assert_eq!(message(), "no moon; allowed: standing");
    }
}
