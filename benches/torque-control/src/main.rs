//! Writes docs/results/torque-control.md: the predictive torque law beside D's, on simulated joints and
//! robots with every disturbance on.

mod cases;
mod currents;
mod joint;
mod page;
mod robots;
mod rows;
mod scenario;
mod tables;
mod variant;

use clap::Parser;
use std::path::PathBuf;
use std::process::ExitCode;

/// Judge the torque laws on simulated joints and robots, and write the page of results
#[derive(Parser)]
#[command(after_help = EXAMPLES)]
struct Arguments {
    /// The folder of the page and its picture
    #[arg(long, default_value = "docs/results")]
    out: PathBuf,
    /// Joints alone
    #[arg(long)]
    joints_only: bool,
}

const EXAMPLES: &str = "\
Examples:
  cargo run --release -p torque-control-bench                        some minutes on two cores
  cargo run --release -p torque-control-bench -- --joints-only --out /tmp";

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match page::write(&arguments.out, arguments.joints_only) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("torque-control-bench: {message}");
            ExitCode::FAILURE
        }
    }
}
