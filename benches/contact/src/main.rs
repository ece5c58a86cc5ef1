//! Writes docs/results/contact.md: contacts that are detected, motion without contact that is not taken
//! for one, and collisions under each reaction.

mod page;
mod robots;
mod runs;

use clap::Parser;
use std::path::PathBuf;
use std::process::ExitCode;

/// Judge the detection of contacts on simulated robots, and write the page of results
#[derive(Parser)]
#[command(after_help = EXAMPLES)]
struct Arguments {
    /// The page
    #[arg(long, default_value = "docs/results/contact.md")]
    out: PathBuf,
    /// One part alone, printed: steps, quiet or collisions; writes no page
    #[arg(long)]
    only: Option<String>,
    /// Only this robot: leg or humanoid; with --only
    #[arg(long)]
    robot: Option<String>,
    /// Only states with this text in their names, e.g. step; with --only
    #[arg(long, default_value = "")]
    state: String,
    /// Only this seed; default: 1, 2 and 3
    #[arg(long)]
    seed: Option<u64>,
    /// Simulated seconds without contact, of each motion and seed of the humanoid; the leg's are 2.5 times as many
    #[arg(long, default_value_t = 120.0)]
    seconds: f64,
    /// Threads; default: all cores
    #[arg(long)]
    threads: Option<usize>,
}

const EXAMPLES: &str = "\
Run it in the project's folder, by cargo run --release -p contact-bench --

Examples:
  contact-bench                                       everything, an hour on two cores
  contact-bench --only collisions                     a minute
  contact-bench --only quiet --robot leg --seconds 20";

fn main() -> ExitCode {
    match page::work(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("contact-bench: {message}");
            ExitCode::FAILURE
        }
    }
}
