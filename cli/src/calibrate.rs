//! `torquectl calibrate`: a robot's parameters from its own recordings.

mod adopt;
mod difference;
mod fit;
mod identity;
mod inertia;
mod joints;
pub(crate) mod runs;
mod status;
mod store;

use crate::output::finish_or_refuse;
use clap::{Args, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// Calibrate a robot from its own recordings, and adopt the result
#[derive(Args)]
#[command(after_long_help = EXAMPLES)]
pub(crate) struct CalibrateArguments {
    #[command(subcommand)]
    what: What,
}

const EXAMPLES: &str = "\
Examples:
  torquectl calibrate joints sweeps.mcap stance.mcap -o calibrated --report calibrated.html
  torquectl calibrate diff config/leg/robot.toml calibrated
  torquectl calibrate commit config/leg/robot.toml calibrated
  torquectl calibrate status config/leg/robot.toml
  torquectl calibrate rollback config/leg/robot.toml
  torquectl calibrate inertia --help";

#[derive(Subcommand)]
enum What {
    Inertia(inertia::InertiaArguments),
    Joints(joints::JointsArguments),
    Status(status::StatusArguments),
    Diff(difference::DiffArguments),
    /// Adopt a calibration into the robot's configuration; the old one is kept
    #[command(after_help = COMMIT)]
    Commit(CommitArguments),
    /// Go back to the calibration before the last commit
    Rollback(RollbackArguments),
}

const COMMIT: &str = "\
The joint files go into a new folder calibrations/DATE beside the configuration, then the configuration's
keys `calibration` name them: that file is replaced at once, so that there is always a whole one. The
daemon reads it when it is started next. Joints that the calibration lacks keep what they have.";

#[derive(Args)]
struct CommitArguments {
    /// The robot's configuration
    config: PathBuf,
    /// The folder that `torquectl calibrate joints` wrote
    calibration: PathBuf,
}

#[derive(Args)]
struct RollbackArguments {
    /// The robot's configuration
    config: PathBuf,
}

pub(crate) fn run(arguments: &CalibrateArguments) -> ExitCode {
    match &arguments.what {
        What::Inertia(arguments) => inertia::run(arguments),
        What::Joints(arguments) => joints::run(arguments),
        What::Status(arguments) => status::run(arguments),
        What::Diff(arguments) => difference::run(arguments),
        What::Commit(CommitArguments {
            config,
            calibration,
        }) => {
            let done = adopt::commit(config, calibration);
            finish_or_refuse(done.map(|folder| {
                let (config, folder) = (config.display(), folder.display());
                format!("{config}: uses {folder} from the daemon's next start on\n")
            }))
        }
        What::Rollback(RollbackArguments { config }) => {
            finish_or_refuse(adopt::rollback(config).map(|folder| {
                let (config, folder) = (config.display(), folder.display());
                format!("{config}: no longer uses {folder}, which is kept\n")
            }))
        }
    }
}
