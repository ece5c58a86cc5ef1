//! Torque control on single joints that share nothing with the project's plant but the frames: writes what
//! docs/results/torque-control.md says of them beside the own plant.

mod catalogue;
mod config;
mod draw;
mod drive;
mod friction;
mod gear;
mod page;
mod plant;
mod rig;
mod run;
mod tasks;

use clap::Parser;
use std::path::PathBuf;
use std::process::ExitCode;

/// Judge torque control on drawn joints, and write their part of the page of results
#[derive(Parser)]
#[command(after_help = EXAMPLES)]
struct Arguments {
    /// The page that has the part
    #[arg(long, default_value = "docs/results/torque-control.md")]
    page: PathBuf,
    /// Joints
    #[arg(long, default_value_t = 40)]
    joints: usize,
    /// Print all figures of the joint of this seed alone
    #[arg(long)]
    seed: Option<u64>,
    /// Joints at a time
    #[arg(long, default_value_t = 2)]
    threads: usize,
}

const EXAMPLES: &str = "\
Examples:
  cargo run --release -p drawn-joints-bench                      some minutes on two cores
  cargo run --release -p drawn-joints-bench -- --seed 7          one joint, on standard output";

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let done = match arguments.seed {
        Some(seed) => run::one(seed),
        None => page::write(&arguments.page, arguments.joints, arguments.threads),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("drawn-joints-bench: {message}");
            ExitCode::FAILURE
        }
    }
}
