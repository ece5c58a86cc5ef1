//! Why a command ends, and with which exit code.

use std::fmt::Display;

use crate::bus::OpenError;

/// The message for the user and the exit code.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// The problem: what is wrong, where, and what is allowed.
    pub message: String,
    /// 1: the environment denies something; 2: bad input.
    pub exit_code: u8,
}

impl Failure {
    /// Something in a file or on the command line is wrong: exit code 2, nothing was started.
    pub fn bad_input(message: impl Display) -> Self {
        Self {
            message: message.to_string(),
            exit_code: 2,
        }
    }

    /// The machine does not let us: exit code 1.
    pub fn environment(message: impl Display) -> Self {
        Self {
            message: message.to_string(),
            exit_code: 1,
        }
    }
}

impl From<OpenError> for Failure {
    fn from(error: OpenError) -> Self {
        match error {
            OpenError::Interfaces(_) => Self::bad_input(error),
            OpenError::NoCan(_) | OpenError::Socket(..) | OpenError::Group(..) => {
                Self::environment(error)
            }
        }
    }
}
