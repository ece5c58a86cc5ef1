//! `torquectl replay`: a recorded run computed again, with the same or another configuration.

mod html;

use crate::BAD_INPUT;
use crate::output::apart;
use crate::recorded::{self, describe_ending};
use crate::units::{cell, keys};
use indicatif::{ProgressBar, ProgressStyle};
use problem::Problems;
use recording::{CycleMessage, Ending, Header, Replay, Replayed, TORQUES};
use robot_config::Robot;
use serde_json::{Value, json};
use std::fmt::Write;
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use terminal::TextTable;

const HELP: &str = "\
The file carries the configuration's files; nothing else is needed. With them every bit of every cycle
must be computed again as recorded, records and frames sent: else the first difference is named. That
holds for recordings from the daemon's first cycle on (torqued run --record). One that begins later is
computed from its begin without what the loop knew by then.

With --config the torques of both configurations are compared where both are valid.

Examples:
  torquectl replay run.mcap
  torquectl replay run.mcap --config config/leg/robot.toml
  torquectl replay run.mcap --config new/robot.toml --report difference.html
  torquectl replay run.mcap --json | jq .bit_exact

Exit codes:
  0  bit-exact, or compared with another configuration
  1  not bit-exact with the recorded configuration
  2  bad input: not a recorded run, another robot, a configuration with problems";

/// Cycles between two updates of the progress bar.
const BAR_STEP: u64 = 1000;

/// Compute a recorded run again and compare.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct ReplayArguments {
    /// The recorded run
    run: PathBuf,
    /// Another configuration of the same robot
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Write the comparison, with curves of the torques, into this HTML file
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &ReplayArguments) -> ExitCode {
    let comparison = match replay(arguments) {
        Ok(comparison) => comparison,
        Err(problems) => {
            eprintln!("{problems}");
            return ExitCode::from(BAD_INPUT);
        }
    };
    let shown = if arguments.json {
        format!("{}\n", object(&comparison))
    } else {
        text(&comparison)
    };
    let code = crate::output::finish(&shown);
    if comparison.is_failure() {
        ExitCode::FAILURE
    } else {
        code
    }
}

/// A replay and what it was of.
pub(crate) struct Comparison {
    pub(crate) header: Header,
    /// The other configuration.
    pub(crate) config: Option<PathBuf>,
    pub(crate) result: Replayed,
    pub(crate) ending: Ending,
    /// Duration of the replay, s.
    pub(crate) took_s: f64,
}

impl Comparison {
    /// Time of the run, s.
    pub(crate) fn run_s(&self) -> f64 {
        self.result.cycles as f64 * self.header.period_s
    }

    /// The recorded configuration did not give the recorded bits, though it should have.
    fn is_failure(&self) -> bool {
        let whole = self.result.first_cycle == 1 && self.result.missing.is_empty();
        self.config.is_none() && whole && !self.result.is_bit_exact()
    }
}

fn replay(arguments: &ReplayArguments) -> Result<Comparison, Problems> {
    let path = &arguments.run;
    // Beside another configuration the torques of the own one are wanted, otherwise its checksums.
    let mut run = match arguments.config {
        Some(_) => recorded::open_with_inputs(path)?,
        None => recorded::open_as_it_is(path)?,
    };
    let header = run.header().clone();
    let robot = load(&header, arguments.config.as_deref())?;
    let mut replay = Replay::new(&robot, &header)?;
    let mut curves = arguments
        .report
        .as_ref()
        .map(|_| html::Curves::new(&header));
    let bar = progress_bar();
    let began = Instant::now();
    let ending = recorded::read_all(path, &mut run, |_, message: &CycleMessage| {
        let record = replay.step(message);
        if let Some(curves) = &mut curves {
            curves.take(&message.record.cycle, record);
        }
        if message.record.cycle.sequence.is_multiple_of(BAR_STEP) {
            bar.inc(BAR_STEP);
        }
        Ok(())
    })?;
    bar.finish_and_clear();
    let comparison = Comparison {
        header,
        config: arguments.config.clone(),
        result: replay.result().clone(),
        ending,
        took_s: began.elapsed().as_secs_f64(),
    };
    if let (Some(file), Some(curves)) = (&arguments.report, &curves) {
        let page = html::page(&comparison, curves);
        apart(file, std::slice::from_ref(path))?;
        terminal::write_file(file, &page)?;
    }
    Ok(comparison)
}

fn progress_bar() -> ProgressBar {
    let bar = if io::stderr().is_terminal() {
        ProgressBar::new_spinner()
    } else {
        ProgressBar::hidden()
    };
    if let Ok(style) = ProgressStyle::with_template("{spinner} {pos} cycles, {per_sec}") {
        bar.set_style(style);
    }
    bar
}

/// The robot of the recording, or that of another configuration.
fn load(header: &Header, config: Option<&Path>) -> Result<Robot, Problems> {
    if let Some(config) = config {
        return robot_config::load(&config.to_string_lossy(), &|path| terminal::read_text(path));
    }
    header.load_robot()
}

/// The verdict in a sentence.
pub(crate) fn verdict(comparison: &Comparison) -> String {
    let result = &comparison.result;
    let mut out = String::new();
    if result.first_cycle > 1 {
        let _ = writeln!(
            out,
            "the recording begins with cycle {}: filters and states start anew, so bits are not compared",
            result.first_cycle
        );
    }
    if let Some((first, count)) = result.missing.first() {
        let _ = writeln!(
            out,
            "{count} cycles from {first} on are missing ({} gaps in all): what follows can differ",
            result.missing.len()
        );
    }
    match (&comparison.config, &result.first_difference) {
        (None, None) => out += "bit-exact: every record and every frame sent is as recorded\n",
        (None, Some(_)) if result.first_cycle > 1 => {}
        (None, Some(difference)) => {
            let _ = writeln!(
                out,
                "NOT bit-exact: {} of {} cycles differ; first in cycle {}: {} was {}, now {}",
                result.different,
                result.cycles,
                difference.cycle,
                difference.field,
                difference.recorded,
                difference.replayed
            );
        }
        (Some(config), None) => {
            let _ = writeln!(out, "{}: no bit differs", config.display());
        }
        (Some(config), Some(difference)) => {
            let _ = writeln!(
                out,
                "{}: differs first in cycle {}: {} was {}, is {}",
                config.display(),
                difference.cycle,
                difference.field,
                difference.recorded,
                difference.replayed
            );
        }
    }
    out
}

fn text(comparison: &Comparison) -> String {
    let (run_s, took_s) = (comparison.run_s(), comparison.took_s);
    let mut out = format!(
        "{}: {} cycles, {run_s:.3} s computed in {took_s:.3} s, {:.1} times real time\n",
        comparison.header.robot,
        comparison.result.cycles,
        run_s / took_s.max(1e-9)
    );
    out += &verdict(comparison);
    out += &describe_ending(&comparison.ending);
    let compared = comparison.config.is_some() || comparison.result.first_cycle > 1;
    if compared {
        let _ = writeln!(out, "\ndifference of the torques, RMS / largest, N·m");
        out += &table(comparison).to_string();
    }
    out
}

/// RMS and largest difference of every torque.
pub(crate) fn table(comparison: &Comparison) -> TextTable {
    let heading = std::iter::once("joint")
        .chain(TORQUES)
        .map(str::to_owned)
        .collect();
    let joints = comparison
        .header
        .joints
        .iter()
        .zip(&comparison.result.joints)
        .enumerate();
    let rows = joints.map(|(j, (name, torques))| {
        let kind = comparison.header.kind(j);
        let cells = torques.iter().map(|torque| match torque.cycles {
            0 => "-".to_owned(),
            _ => {
                let both = format!("{:.3} / {:.3}", torque.rms(), torque.largest);
                cell(kind, both, "N·m")
            }
        });
        std::iter::once(name.clone()).chain(cells).collect()
    });
    TextTable(std::iter::once(heading).chain(rows).collect())
}

fn object(comparison: &Comparison) -> Value {
    let result = &comparison.result;
    let difference = result.first_difference.as_ref().map(|difference| {
        json!({
            "cycle": difference.cycle,
            "field": difference.field,
            "recorded": difference.recorded,
            "replayed": difference.replayed,
        })
    });
    let joints = comparison.header.joints.iter().zip(&result.joints);
    let joints = joints.enumerate().map(|(j, (name, torques))| {
        let kind = comparison.header.kind(j);
        let torques = TORQUES.iter().zip(torques).map(|(torque, sum)| {
            let value = json!({
                "cycles": sum.cycles,
                "rms_Nm": sum.rms(),
                "largest_Nm": sum.largest,
                "largest_cycle": sum.largest_at,
            });
            ((*torque).to_owned(), keys(kind, value))
        });
        json!({ "name": name, "difference": torques.collect::<serde_json::Map<_, _>>() })
    });
    json!({
        "robot": comparison.header.robot,
        "config": comparison.config.as_ref().map(|path| path.display().to_string()),
        "cycles": result.cycles,
        "first_cycle": result.first_cycle,
        "missing": result.missing,
        "bit_exact": result.is_bit_exact(),
        "different_cycles": result.different,
        "first_difference": difference,
        "run_s": comparison.run_s(),
        "took_s": comparison.took_s,
        "times_real_time": comparison.run_s() / comparison.took_s.max(1e-9),
        "joints": joints.collect::<Vec<_>>(),
        "ending": describe_ending(&comparison.ending).trim_end(),
    })
}
