//! Judges the fused torque on the real arm and on the family of joints.

use clap::{Args, Parser, Subcommand, ValueEnum};
use identification::log::{LogReader, LogRow};
use indicatif::{ProgressBar, ProgressStyle};
use joint_file::{JointFile, no_files};
use problem::Problem;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use test_support::ResultsPage;
use torque_judge::course::Training;
use torque_judge::family::{Fit, Judged, judge, plan};
use torque_judge::fit::{fit, times};
use torque_judge::results::TaredCases;
use torque_judge::score::Score;
use torque_judge::specimen::FIRST_JUDGED;
use torque_judge::{drives, page, real, results};

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
  torque-judge real --logs lara8_arm --splits
  torque-judge family --part design --joints 6 --training one-sign --training standing
  torque-judge family --part design --joints 6 --training full --training two-thirds
  torque-judge family --part judging --json judged.json
  torque-judge results --logs lara8_arm --drives kuka_kr300 --out docs/results/torque-judge.md
  torque-judge sides --seed $(date +%Y%m%d) --out docs/results/torque-judge.md
  torque-judge logs --joint joint.toml --turn turn.csv --training train.csv slow.csv fast.csv

The real arm's logs (sweep.csv, jog_joints.csv) are columns of the repository allwinlucious/MasterThesis,
BSD-3-Clause; every other CSV file of the folder with the same columns is judged too.";

#[derive(Subcommand)]
enum Command {
    /// The real arm: trained on one log, judged on another
    Real {
        /// Folder of its logs
        #[arg(long)]
        logs: PathBuf,
        /// Its other splits instead: halves and thirds of each log, all joints
        #[arg(long)]
        splits: bool,
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
    /// The results page: the real arm, the judging part of the family, times
    Results {
        /// Folder of the real arm's logs
        #[arg(long)]
        logs: PathBuf,
        /// Folder of the logs of drives without a torque reference (A.csv, B.csv)
        #[arg(long)]
        drives: PathBuf,
        /// Joints of the family
        #[arg(long, default_value_t = 40)]
        joints: u64,
        /// Fits at a time
        #[arg(long, default_value_t = 1)]
        threads: usize,
        /// Begin no fit of the family after so many minutes: the page names the number of fits
        #[arg(long)]
        minutes: Option<f64>,
        /// Keep the family's and the times' part of the page as it is; the page says so
        #[arg(long, conflicts_with_all = ["joints", "threads", "minutes", "json"])]
        keep_family: bool,
        /// The page; its section of design joints is kept
        #[arg(long, short)]
        out: PathBuf,
        /// Write all figures to this file
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Design joints beside joints drawn by a seed that nobody chose: a section of the results page
    Sides {
        /// Today's date, as 20261126: it draws the joints
        #[arg(long)]
        seed: u64,
        /// Joints of each part
        #[arg(long, default_value_t = 12)]
        joints: u64,
        /// Fits at a time
        #[arg(long, default_value_t = 1)]
        threads: usize,
        /// The page
        #[arg(long, short)]
        out: PathBuf,
    },
    /// Any logs of one joint, as joint-torque-bench writes them: errors against `tau_sensor`
    Logs {
        /// The joint (TOML); only its table [joint] is needed
        #[arg(long)]
        joint: PathBuf,
        /// Log of one unloaded output turn each way
        #[arg(long)]
        turn: Option<PathBuf>,
        /// Log of loaded motion and rest
        #[arg(long)]
        training: PathBuf,
        /// The logs that are judged, from their second second on
        logs: Vec<PathBuf>,
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
    let mut all = Training::ALL.into_iter().chain(Training::UNTURNED);
    let names: Vec<&str> = all.clone().map(|(_, n)| n).collect();
    all.find(|(_, n)| key(n) == key(name))
        .ok_or_else(|| format!("allowed: {}", names.join(", ")))
}

fn main() -> ExitCode {
    let (text, json, out) = match Arguments::parse().command {
        Command::Real {
            logs,
            splits: true,
            out,
        } => match real::splits(&logs, &|_| ()) {
            Ok(cases) => {
                let text = page::splits(&cases);
                let cases: Vec<_> = cases.into_iter().map(|(_, case)| case).collect();
                let text = format!("{}\n{text}", page::real(&cases));
                (text, page::to_json(&Judged::default(), &cases), out)
            }
            Err(problem) => return failed(&problem.to_string()),
        },
        Command::Real {
            logs,
            splits: false,
            out,
        } => match real::judge(&logs, &|_| ()) {
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
            if Training::UNTURNED
                .iter()
                .any(|t| judged.cases.iter().any(|c| c.training == t.1))
            {
                text += &format!("\n{}", page::unturned(&judged));
            }
            if out.verbose {
                for (_, name) in Training::ALL {
                    text += &format!("\n{}", page::sources(&judged, name));
                }
                text += &format!("\n{}", page::constants(&judged));
                text += &format!("\n{}\n", judged.reports.join("\n"));
            }
            (text, page::to_json(&judged, &[]), out)
        }
        Command::Results {
            logs,
            drives,
            joints,
            threads,
            minutes,
            keep_family,
            out,
            json,
        } => {
            if keep_family {
                return match renew(&logs, &drives, &out) {
                    Ok(()) => ExitCode::SUCCESS,
                    Err(problem) => failed(&problem.to_string()),
                };
            }
            let numbers: Vec<u64> = (FIRST_JUDGED..FIRST_JUDGED + joints).collect();
            return match write_results(
                [&logs, &drives],
                &plan(&numbers),
                (threads, minutes),
                &out,
                json.as_deref(),
            ) {
                Ok(()) => ExitCode::SUCCESS,
                Err(problem) => failed(&problem.to_string()),
            };
        }
        Command::Sides {
            seed,
            joints,
            threads,
            out,
        } => {
            return match write_sides(seed, joints, threads, &out) {
                Ok(()) => ExitCode::SUCCESS,
                Err(problem) => failed(&problem.to_string()),
            };
        }
        Command::Logs {
            joint,
            turn,
            training,
            logs,
        } => {
            return match judge_logs(&joint, turn.as_deref(), &training, &logs) {
                Ok(text) => {
                    print!("{text}");
                    ExitCode::SUCCESS
                }
                Err(problem) => failed(&problem.to_string()),
            };
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

fn read_rows(path: &Path) -> Result<Vec<LogRow>, Problem> {
    let name = path.display().to_string();
    let file =
        File::open(path).map_err(|e| Problem::new(e.to_string(), "").at(name.as_str(), 0))?;
    LogReader::new(BufReader::new(file), &name)?.rows()
}

fn judge_logs(
    joint: &Path,
    turn: Option<&Path>,
    training: &Path,
    logs: &[PathBuf],
) -> Result<String, Problem> {
    let name = joint.display().to_string();
    let text = std::fs::read_to_string(joint)
        .map_err(|e| Problem::new(e.to_string(), "").at(name.as_str(), 0))?;
    let file = JointFile::parse(&text, &name, &no_files)?;
    let turn = turn.map(read_rows).transpose()?;
    let (file, notes) = fit(&file, turn.as_deref(), &read_rows(training)?)?;
    let mut scores = Vec::new();
    for path in logs {
        let rows = read_rows(path)?.into_iter();
        let rows: Vec<_> = rows.map(|row| (row, row.tau_sensor)).collect();
        let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned());
        scores.push((stem.unwrap_or_default(), Score::of(&file, &rows, 1.0)?));
    }
    Ok(format!("{}\n\n{}", notes.join("\n"), page::logs(&scores)))
}

fn write(path: &Path, text: String) -> Result<(), Problem> {
    let name = path.display().to_string();
    std::fs::write(path, text).map_err(|e| Problem::new(e.to_string(), "").at(name, 0))
}

/// Writes the page, and the files of its rows beside it.
fn write_page(path: &Path, page: &str) -> Result<(), Problem> {
    let written = ResultsPage::new(page).and_then(|page| page.write(path));
    written.map_err(|e| Problem::new(e, "a folder that can be written"))
}

/// Joints of the judging part that are judged without an unloaded turn.
const UNTURNED_JOINTS: u64 = 24;

/// Judges the real arm and joints without an unloaded turn.
fn judge_tared(logs: &Path) -> Result<TaredCases, Problem> {
    let joints = FIRST_JUDGED..FIRST_JUDGED + UNTURNED_JOINTS;
    let fits: Vec<Fit> = joints
        .flat_map(|number| Training::UNTURNED.map(|training| (number, training)))
        .collect();
    Ok(TaredCases {
        real: real::judge(logs, &|_| ())?,
        splits: real::splits(logs, &|_| ())?,
        unturned: judge(&fits, 1, None, &|_| ()),
    })
}

/// Judges the real arm and the drives and writes the page, the rest as it was.
fn renew(logs: &Path, drives: &Path, out: &Path) -> Result<(), Problem> {
    let old = std::fs::read_to_string(out).map_err(|e| Problem::unreadable(out.display(), &e))?;
    let offered = drives::judge(drives)?;
    let page = results::without_family(&judge_tared(logs)?, &offered, &old).ok_or_else(|| {
        let reason = format!("{}: no family's part to keep", out.display());
        Problem::new(reason, "a page that this command has made")
    })?;
    write_page(out, &page)
}

/// Judges everything and writes the page.
fn write_results(
    [logs, drives]: [&Path; 2],
    fits: &[Fit],
    (threads, minutes): (usize, Option<f64>),
    out: &Path,
    json: Option<&Path>,
) -> Result<(), Problem> {
    let offered = drives::judge(drives)?;
    let tared = judge_tared(logs)?;
    let until = minutes.map(|minutes| Instant::now() + Duration::from_secs_f64(60.0 * minutes));
    let judged = with_progress(fits, threads, until);
    let times = times(FIRST_JUDGED)?;
    if let Some(path) = json {
        write(path, format!("{}\n", page::to_json(&judged, &tared.real)))?;
    }
    let old = std::fs::read_to_string(out).unwrap_or_default();
    let page = results::results(&tared, &offered, &judged, times, &old);
    write_page(out, &page)
}

/// Trainings of the parts side by side: the longest one, judged within its angles and outside.
const SIDES: [&str; 2] = ["full", "outside"];

/// Judges both parts and writes their section of the page.
fn write_sides(seed: u64, joints: u64, threads: usize, out: &Path) -> Result<(), Problem> {
    let old = std::fs::read_to_string(out).map_err(|e| Problem::unreadable(out.display(), &e))?;
    let part = |first: u64| {
        let trainings = Training::ALL.into_iter();
        let trainings = trainings.filter(|(_, name)| SIDES.contains(name));
        let fits: Vec<Fit> = trainings
            .flat_map(|training| (first..first + joints).map(move |number| (number, training)))
            .collect();
        with_progress(&fits, threads, None)
    };
    // Far from the other parts' numbers, and no two dates share one.
    let (design, unseen) = (part(0), part(seed * 1000));
    let table = page::sides(&[("design", &design), ("unseen", &unseen)]);
    let page = results::with_sides(&old, seed, joints, &table).ok_or_else(|| {
        let reason = format!("{}: no section of times", out.display());
        Problem::new(reason, "a page that `results` has made")
    })?;
    write_page(out, &page)
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
    let each = |number: &u64| {
        let number = *number;
        trainings
            .iter()
            .map(move |training| (number, *training))
            .collect::<Vec<_>>()
    };
    let fits: Vec<Fit> = numbers.iter().flat_map(each).collect();
    with_progress(&fits, threads, None)
}

fn with_progress(fits: &[Fit], threads: usize, until: Option<Instant>) -> Judged {
    let bar = ProgressBar::new(fits.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos} of {len} fits, {elapsed}") {
        bar.set_style(style);
    }
    let judged = judge(fits, threads, until, &|done| {
        bar.set_position(bar.position().max(done as u64));
    });
    bar.finish_and_clear();
    judged
}
