//! Writes docs/results/standing.md: a humanoid that stands, pushed and left alone, in two worlds side by side: the
//! project's own plant, and MuJoCo with joints that share nothing with it.

mod mujoco;
mod own;
mod page;
mod stand;

use clap::Parser;
use std::path::PathBuf;
use std::process::ExitCode;

/// Push a standing humanoid in two worlds, and write the page of results
#[derive(Parser)]
#[command(after_help = EXAMPLES)]
struct Arguments {
    /// The page
    #[arg(long, default_value = "docs/results/standing.md")]
    out: PathBuf,
    /// Draws of joints that stand without a push, in each world
    #[arg(long, default_value_t = 20)]
    draws: u64,
    /// Simulated time for which each of them stands, s
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Only this world: own or mujoco
    #[arg(long)]
    world: Option<String>,
    /// Only this mode: `inverse_dynamics` or `stand`
    #[arg(long)]
    mode: Option<String>,
    /// Only pushes whose name contains this, as "60 N from right"; their joints stay the same
    #[arg(long)]
    push: Option<String>,
}

const EXAMPLES: &str = "\
Run it in the project's folder, by cargo run --release -p standing-bench --; MuJoCo is that of rt-tests/install.sh

Examples:
  standing-bench                                   everything, an hour
  standing-bench --draws 2 --seconds 10 --out /tmp/standing.md
  standing-bench --mode stand --world mujoco --push 60 --draws 0 --out /tmp/pushes.md
  standing-bench --world own --draws 20 --seconds 120 --out /tmp/own.md";

fn main() -> ExitCode {
    match page::write(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("standing-bench: {message}");
            ExitCode::FAILURE
        }
    }
}
