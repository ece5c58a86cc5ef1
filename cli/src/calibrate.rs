//! `torquectl calibrate`: a robot's parameters from its own recordings.

mod inertia;

use clap::{Args, Subcommand};
use std::process::ExitCode;

/// Calibrate a robot from its own recordings
#[derive(Args)]
pub(crate) struct CalibrateArguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Inertia(inertia::InertiaArguments),
}

pub(crate) fn run(arguments: &CalibrateArguments) -> ExitCode {
    match &arguments.what {
        What::Inertia(arguments) => inertia::run(arguments),
    }
}
