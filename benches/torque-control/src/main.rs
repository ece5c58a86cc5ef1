//! Writes docs/results/torque-control.md, the predictive torque law beside D's, and torque-modes.md, the
//! experiments of Z and G, on simulated joints and robots with every disturbance on.

mod bristles;
mod cases;
mod currents;
mod joint;
mod modes;
mod page;
mod robots;
mod rows;
mod scenario;
mod tables;
mod variant;

use clap::Parser;
use std::path::PathBuf;
use std::process::ExitCode;

/// Judge torque laws and modes on simulated joints and robots, and write the pages of results
#[derive(Parser)]
#[command(after_help = EXAMPLES)]
struct Arguments {
    /// The folder of the pages and their picture
    #[arg(long, default_value = "docs/results")]
    out: PathBuf,
    /// Joints alone
    #[arg(long)]
    joints_only: bool,
    /// The table of friction's bristles alone, as text
    #[arg(long, conflicts_with = "modes_only")]
    bristles_only: bool,
    /// The page of Z's and G's experiments alone
    #[arg(long)]
    modes_only: bool,
}

const EXAMPLES: &str = "\
Examples:
  cargo run --release -p torque-control-bench                        some minutes on two cores
  cargo run --release -p torque-control-bench -- --joints-only --out /tmp
  cargo run --release -p torque-control-bench -- --modes-only        passive mode and tracking alone";

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let (out, joints_only) = (&arguments.out, arguments.joints_only);
    if arguments.bristles_only {
        return match bristles::table() {
            Ok(text) => {
                println!("{text}");
                ExitCode::SUCCESS
            }
            Err(message) => {
                eprintln!("torque-control-bench: {message}");
                ExitCode::FAILURE
            }
        };
    }
    let written = modes::write(out, joints_only).and_then(|()| {
        if arguments.modes_only {
            Ok(())
        } else {
            page::write(out, joints_only)
        }
    });
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("torque-control-bench: {message}");
            ExitCode::FAILURE
        }
    }
}
