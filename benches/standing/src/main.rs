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
    /// Pushes of mode stand on the own plant, each with other joints: 4 of 30 N, then all of 60 N, from each side in
    /// turn. In MuJoCo, which is slower, and of mode inverse dynamics the first 8
    #[arg(long, default_value_t = 20)]
    pushes: u64,
    /// Simulated time for which mode stand stands without a push in one more run on the own plant, s; in MuJoCo, which
    /// is slower, a fifth of it. 0: no such run
    #[arg(long, default_value_t = 600.0)]
    long: f64,
    /// Draws of joints that stand without a push, in each world
    #[arg(long, default_value_t = 20)]
    draws: u64,
    /// Simulated time for which each of them stands, s
    #[arg(long, default_value_t = 60.0)]
    seconds: f64,
    /// Simulated time for which mode stand steps in place, s, with the joints of each seed in each world. 0: no such run
    #[arg(long, default_value_t = 300.0)]
    steps: f64,
    /// Joints that step in place, in each world
    #[arg(long, default_value_t = 2)]
    steppers: u64,
    /// Runs at a time
    #[arg(long, default_value_t = 2)]
    threads: usize,
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
  standing-bench --pushes 8 --long 0 --draws 2 --seconds 10 --out /tmp/standing.md
  standing-bench --mode stand --world mujoco --push 60 --draws 0 --long 0 --out /tmp/pushes.md
  standing-bench --world own --pushes 0 --draws 20 --seconds 120 --out /tmp/own.md";

fn main() -> ExitCode {
    match page::write(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("standing-bench: {message}");
            ExitCode::FAILURE
        }
    }
}
