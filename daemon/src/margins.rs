//! The margins of the torque loops, before anything is started: what `torquectl check` refuses does not run.

use std::path::Path;

use robot_config::torque_loops::refused_loops;
use robot_config::{Problems, Robot};

use crate::failure::Failure;

/// Checks the margins of the robot's torque loops; `config`: its file, for messages; `accepted`: too little margin is
/// printed and run.
///
/// # Errors
/// A loop with less margin than 30 degrees or 6 dB, where this is not accepted.
pub fn check(robot: &Robot, config: &Path, accepted: bool) -> Result<(), Failure> {
    let refused = refused_loops(robot, &config.to_string_lossy());
    if refused.is_empty() {
        return Ok(());
    }
    let refused = Problems(refused);
    if accepted {
        tracing::warn!("accepted: {refused}");
        return Ok(());
    }
    Err(Failure::bad_input(format!(
        "{refused}\nThese loops may swing by themselves; whoever knows that they do not starts them with --accept-margins."
    )))
}
