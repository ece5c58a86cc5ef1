//! Judges the fused torque on the real arm and on the family of joints.

use clap::{Args, Parser, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::PathBuf;
use std::process::ExitCode;
use torque_judge::course::Training;
use torque_judge::family::{Judged, judge};
use torque_judge::specimen::FIRST_JUDGED;
use torque_judge::{page, real};

/// Judge the fused joint torque where it was not tuned
#[derive(Parser)]
#[command(after_help = EXAMPLES)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  torque-judge real --logs lara8_arm
  torque-judge family --part design --joints 6 --training full --training two-thirds
  torque-judge family --part judging --json judged.json

The real arm's logs (sweep.csv, jog_joints.csv) are columns of the repository allwinlucious/MasterThesis,
BSD-3-Clause; every other CSV file of the folder with the same columns is judged too.";

#[derive(Subcommand)]
enum Command {
    /// The real arm: trained on one log, judged on another
    Real {
        /// Folder of its logs
        #[arg(long)]
        logs: PathBuf,
        #[command(flatten)]
        out: Out,
    },
    /// The family: joints of different structure, several trainings, five scenarios
    Family {
        /// Part of the family
        #[arg(long, value_enum, default_value_t = Part::Design)]
        part: Part,
        /// Joints of it
        #[arg(long, default_value_t = 40)]
        joints: u64,
        /// Trainings; all if none is named
        #[arg(long, value_parser = training)]
        training: Vec<(Training, &'static str)>,
        /// Fits at a time
        #[arg(long, default_value_t = 1)]
        threads: usize,
        #[command(flatten)]
        out: Out,
    },
}

#[derive(Args)]
struct Out {
    /// Write all figures to this file
    #[arg(long)]
    json: Option<PathBuf>,
    /// Print the reports of the fits
    #[arg(long)]
    verbose: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Part {
    /// Looked at while the estimators were made
    Design,
    /// For judging only
    Judging,
}

fn training(name: &str) -> Result<(Training, &'static str), String> {
    let key = |name: &str| name.replace([' ', '-', '/'], "");
    let found = Training::ALL.into_iter().find(|(_, n)| key(n) == key(name));
    found.ok_or_else(|| {
        let names: Vec<&str> = Training::ALL.iter().map(|(_, n)| *n).collect();
        format!("allowed: {}", names.join(", "))
    })
}

fn main() -> ExitCode {
    let (text, json, out) = match Arguments::parse().command {
        Command::Real { logs, out } => match real::judge(&logs, &|_| ()) {
            Ok(cases) => {
                let reports = cases.iter().map(|c| {
                    format!(
                        "joint {}, {}:\n  {}\n",
                        c.joint,
                        c.logs,
                        c.report.join("\n  ")
                    )
                });
                let reports = if out.verbose {
                    reports.collect()
                } else {
                    String::new()
                };
                let text = format!("{reports}{}", page::real(&cases));
                (text, page::to_json(&Judged::default(), &cases), out)
            }
            Err(problem) => return failed(&problem.to_string()),
        },
        Command::Family {
            part,
            joints,
            training,
            threads,
            out,
        } => {
            let judged = family(part, joints, &training, threads);
            let mut text = page::family(&judged);
            if out.verbose {
                for (_, name) in Training::ALL {
                    text += &format!("\n{}", page::sources(&judged, name));
                }
                text += &format!("\n{}\n", judged.reports.join("\n"));
            }
            (text, page::to_json(&judged, &[]), out)
        }
    };
    print!("{text}");
    if let Some(path) = out.json
        && let Err(e) = std::fs::write(&path, format!("{json}\n"))
    {
        return failed(&format!("{}: {e}", path.display()));
    }
    ExitCode::SUCCESS
}

fn failed(message: &str) -> ExitCode {
    eprintln!("torque-judge: {message}");
    ExitCode::FAILURE
}

fn family(
    part: Part,
    joints: u64,
    trainings: &[(Training, &'static str)],
    threads: usize,
) -> Judged {
    let first = match part {
        Part::Design => 0,
        Part::Judging => FIRST_JUDGED,
    };
    let numbers: Vec<u64> = (first..first + joints).collect();
    let all = Training::ALL;
    let trainings = if trainings.is_empty() {
        &all[..]
    } else {
        trainings
    };
    let bar = ProgressBar::new((numbers.len() * trainings.len()) as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos} of {len} fits, {elapsed}") {
        bar.set_style(style);
    }
    let judged = judge(&numbers, trainings, threads, &|done| {
        bar.set_position(bar.position().max(done as u64));
    });
    bar.finish_and_clear();
    judged
}
