//! `torquectl calibrate`: a robot's parameters from its own recordings.

mod adopt;
mod difference;
mod drives;
mod everything;
mod fit;
mod identity;
mod inertia;
mod inspected;
mod loads;
mod payload;
pub(crate) mod runs;
mod sensors;
mod shown;
mod status;
mod store;
mod stretch;

use crate::output::finish_or_refuse;
use crate::spool::return_memory;
use clap::{Args, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// Calibrate a robot from its own recordings, and adopt the result
#[derive(Args)]
#[command(
    after_long_help = everything::HELP,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true
)]
pub(crate) struct CalibrateArguments {
    #[command(subcommand)]
    what: Option<What>,
    #[command(flatten)]
    runs: everything::RunsArguments,
}

#[derive(Subcommand)]
enum What {
    Inertia(inertia::InertiaArguments),
    Payload(payload::PayloadArguments),
    Status(status::StatusArguments),
    Diff(difference::DiffArguments),
    /// Adopt a calibration into the robot's configuration; the old one is kept
    #[command(after_help = COMMIT)]
    Commit(CommitArguments),
    /// Go back to the calibration before the last commit
    Rollback(RollbackArguments),
}

const COMMIT: &str = "\
The files go into a new folder calibrations/DATE beside the configuration, whose keys then name them: joint
files, the URDF with other inertias, offsets of F/T sensors, and what drives differ in (calibration.toml lists
all under [settings]). The configuration is replaced at once, so that there is always a whole one. The daemon
reads it when it is started next. What the calibration lacks stays as it is. Offsets and masses beyond F/T
sensors that changed make an earlier tare wrong: tare again.";

#[derive(Args)]
struct CommitArguments {
    /// The robot's configuration
    config: PathBuf,
    /// The folder that `torquectl calibrate` wrote
    calibration: PathBuf,
}

#[derive(Args)]
struct RollbackArguments {
    /// The robot's configuration
    config: PathBuf,
}

pub(crate) fn run(arguments: &CalibrateArguments) -> ExitCode {
    return_memory();
    match &arguments.what {
        None => everything::run(&arguments.runs),
        Some(What::Inertia(arguments)) => inertia::run(arguments),
        Some(What::Payload(arguments)) => payload::run(arguments),
        Some(What::Status(arguments)) => status::run(arguments),
        Some(What::Diff(arguments)) => difference::run(arguments),
        Some(What::Commit(CommitArguments {
            config,
            calibration,
        })) => {
            let done = adopt::commit(config, calibration);
            finish_or_refuse(done.map(|folder| {
                let (config, folder) = (config.display(), folder.display());
                format!("{config}: uses {folder} from the daemon's next start on\n")
            }))
        }
        Some(What::Rollback(RollbackArguments { config })) => {
            finish_or_refuse(adopt::rollback(config).map(|folder| {
                let (config, folder) = (config.display(), folder.display());
                format!("{config}: no longer uses {folder}, which is kept\n")
            }))
        }
    }
}
