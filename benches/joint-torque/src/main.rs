//! Writes docs/results/joint-torque.md, or the logs that it rests on.

use clap::{Parser, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use joint_torque_bench::joint::BenchJoint;
use joint_torque_bench::judge::{Outcome, calibrate, judge};
use joint_torque_bench::lara8::lara8;
use joint_torque_bench::page::{Results, page};
use joint_torque_bench::plot::draw;
use joint_torque_bench::run::run;
use joint_torque_bench::scenario::{self, Scenario};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use test_support::ResultsPage;

/// Judge every joint-torque estimator on simulated joints
#[derive(Parser)]
#[command(after_help = EXAMPLES)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  joint-torque-bench results                      some 20 minutes on two cores
  joint-torque-bench results --seeds 0 --out /tmp  two minutes: nominal joints alone
  joint-torque-bench logs --joint z --out logs
  torquectl fit all --joint logs/joint.toml --no-load logs/turn.csv --training logs/train.csv -o z.toml
  torquectl estimate --joint z.toml --log logs/fast.csv";

#[derive(Subcommand)]
enum Command {
    /// Write the page of results and its pictures
    Results {
        /// The folder
        #[arg(long, default_value = "docs/results")]
        out: PathBuf,
        /// Redrawn joints of each kind
        #[arg(long, default_value_t = 20)]
        seeds: u64,
    },
    /// Write the logs of a joint's calibration runs and scenarios
    Logs {
        /// z (16 N·m, 100:1) or s (400 N·m, 160:1)
        #[arg(long)]
        joint: String,
        /// Redraw its parameters with this seed; 0 keeps them
        #[arg(long, default_value_t = 0)]
        seed: u64,
        /// The folder
        #[arg(long)]
        out: PathBuf,
    },
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Results { out, seeds } => results(&out, seeds),
        Command::Logs { joint, seed, out } => logs(&joint, seed, &out),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("joint-torque-bench: {message}");
            ExitCode::FAILURE
        }
    }
}

fn specimen(name: &str, seed: u64) -> Result<BenchJoint, String> {
    let joint = BenchJoint::named(name)?;
    Ok(if seed == 0 {
        joint
    } else {
        joint.redrawn(seed)
    })
}

fn scenarios(joint: &BenchJoint) -> Vec<Scenario> {
    let mut all = scenario::experiments(joint);
    all.extend(scenario::u_experiments(joint));
    all
}

type Judged = (Vec<Outcome>, Vec<String>);

fn one(name: &str, seed: u64) -> Result<Judged, String> {
    let joint = specimen(name, seed)?;
    let fitted = calibrate(&joint).map_err(|e| format!("joint {name}, seed {seed}: {e}"))?;
    let mut outcomes = judge(&joint, &fitted, &scenarios(&joint))?;
    if seed > 0 {
        outcomes.iter_mut().for_each(|o| o.trace.clear());
    }
    Ok((outcomes, fitted.report))
}

fn results(out: &Path, seeds: u64) -> Result<(), String> {
    let count = 2 * (seeds + 1);
    let style = ProgressStyle::with_template("{bar:30} {pos} of {len} joints, {elapsed}");
    let bar = ProgressBar::new(count);
    let bar = style.map_or(bar.clone(), |style| bar.with_style(style));
    bar.tick();
    // Work is dealt out joint by joint, Z's kind and S's by turns.
    let next = AtomicU64::new(0);
    let judged: Mutex<Vec<(u64, Result<Judged, String>)>> = Mutex::new(Vec::new());
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    if k >= count {
                        break;
                    }
                    let done = one(if k.is_multiple_of(2) { "z" } else { "s" }, k / 2);
                    if let Ok(mut judged) = judged.lock() {
                        judged.push((k, done));
                    }
                    bar.inc(1);
                }
            });
        }
    });
    bar.finish_and_clear();
    let mut judged = judged.into_inner().map_err(|e| e.to_string())?;
    judged.sort_by_key(|(k, _)| *k);
    let mut kinds: [Vec<(u64, Judged)>; 2] = [Vec::new(), Vec::new()];
    for (k, done) in judged {
        kinds[(k % 2) as usize].push((k / 2, done?));
    }
    let [(z, z_report, z_redrawn), (s, s_report, s_redrawn)] = kinds.map(|mut kind| {
        let (_, (nominal, report)) = kind.remove(0);
        let redrawn: Vec<(u64, Vec<Outcome>)> = kind
            .into_iter()
            .map(|(seed, (outcomes, _))| (seed, outcomes))
            .collect();
        (nominal, report, redrawn)
    });
    std::fs::create_dir_all(out).map_err(|e| format!("{}: {e}", out.display()))?;
    for (name, title, outcomes) in [
        ("z", "Z's joint, 16 N·m: simulated", &z),
        ("s", "S's joint, 400 N·m: simulated", &s),
    ] {
        let path = out.join(format!("joint-torque-{name}.svg"));
        draw(&path, title, outcomes).map_err(|e| e.to_string())?;
    }
    let results = Results {
        z,
        s,
        reports: [z_report, s_report],
        redrawn: [z_redrawn, s_redrawn],
        lara8: lara8()?,
    };
    let path = out.join("joint-torque.md");
    ResultsPage::new(&page(&results))?.write(&path)?;
    println!("{}", path.display());
    for (name, lines) in ["z", "s"].iter().zip(&results.reports) {
        let path = out.join(format!("joint-torque-{name}-fit.txt"));
        write(&path, &(lines.join("\n") + "\n"))?;
    }
    Ok(())
}

fn logs(name: &str, seed: u64, out: &Path) -> Result<(), String> {
    let joint = specimen(name, seed)?;
    std::fs::create_dir_all(out).map_err(|e| format!("{}: {e}", out.display()))?;
    let file = joint.file.to_toml().map_err(|e| e.to_string())?;
    write(&out.join("joint.toml"), &file)?;
    let calibration = [scenario::turn(&joint), scenario::train(&joint)];
    for scenario in calibration.into_iter().chain(scenarios(&joint)) {
        let mut text = "t,theta,q,i,tau_sensor\n".to_owned();
        for (row, _) in run(&joint, &scenario) {
            let [t, theta, q, i, tau] = [row.t, row.theta, row.q, row.current, row.tau_sensor];
            text += &format!("{t:.3},{theta},{q},{i},{tau}\n");
        }
        let file = scenario.name.replace(' ', "-").to_lowercase();
        write(&out.join(format!("{file}.csv")), &text)?;
    }
    Ok(())
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))?;
    println!("{}", path.display());
    Ok(())
}
