//! `torquectl fit`: parameters of a joint's estimators from recorded logs.

use crate::BAD_INPUT;
use crate::estimate::{open_log, read_joint};
use crate::output::finish;
use crate::report::{self, Traces};
use crate::rows::warn_of_cut;
use clap::{ArgMatches, Args, Command, FromArgMatches, Subcommand};
use identification::all::{self, Fitted, Step};
use identification::inputs::{self, Inspection, LogKind};
use identification::joined::{Zeros, joined};
use identification::log::LogRow;
use indicatif::{ProgressBar, ProgressStyle};
use joint_file::JointFile;
use problem::{Problem, Problems};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Fit the estimators of a joint to recorded logs
#[derive(Args)]
#[command(after_long_help = EXAMPLES)]
pub(crate) struct FitArguments {
    #[command(subcommand)]
    what: What,
}

const EXAMPLES: &str = "\
Logs are CSV with columns t,theta,q,i[,tau_sensor][,tau_feedforward] (see `torquectl estimate --help`).

Examples:
  torquectl fit all --joint elbow.toml --no-load turn.csv --training train.csv -o fitted.toml
  torquectl fit all --joint elbow.toml --no-load turn.csv --training monday.csv friday.csv -o fitted.toml
  torquectl fit all --joint elbow.toml --training monday.csv friday.csv -o fitted.toml  # no unloaded turn
  torquectl fit kinematic-error --joint elbow.toml --log turn.csv -o elbow.toml
  torquectl fit compliance --joint elbow.toml --log train.csv -o elbow.toml

The network and the Gaussian processes are written beside OUT.toml, as OUT.network.toml and so on.";

enum What {
    All(AllArguments),
    One(&'static Step, StepArguments),
}

/// Every step, and all of them.
static STEPS: [Step; Step::ALL.len()] = Step::ALL;
const ALL: &str = "all";
const ABOUT_ALL: &str =
    "Every step: the kinematic error from an unloaded turn, all others from loaded motion and rest";

impl Subcommand for What {
    fn augment_subcommands(command: Command) -> Command {
        let all = AllArguments::augment_args(Command::new(ALL).about(ABOUT_ALL));
        let steps = STEPS
            .iter()
            .map(|step| StepArguments::augment_args(Command::new(step.name).about(step.about)));
        command
            .subcommand_required(true)
            .arg_required_else_help(true)
            .subcommand(all)
            .subcommands(steps)
    }

    fn augment_subcommands_for_update(command: Command) -> Command {
        Self::augment_subcommands(command)
    }

    fn has_subcommand(name: &str) -> bool {
        name == ALL || STEPS.iter().any(|step| step.name == name)
    }
}

impl FromArgMatches for What {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let missing = || clap::Error::new(clap::error::ErrorKind::MissingSubcommand);
        let (name, matches) = matches.subcommand().ok_or_else(missing)?;
        match STEPS.iter().find(|step| step.name == name) {
            Some(step) => Ok(Self::One(step, StepArguments::from_arg_matches(matches)?)),
            None => Ok(Self::All(AllArguments::from_arg_matches(matches)?)),
        }
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

#[derive(Args)]
struct AllArguments {
    /// The joint (TOML); only its table [joint] is needed
    #[arg(long)]
    joint: PathBuf,
    /// Log of one unloaded output turn each way (CSV: t,theta,q,i), begun some 20 degrees before the angles that
    /// matter; without one the torsion's zero is unknown until a tare
    #[arg(long)]
    no_load: Option<PathBuf>,
    /// Logs of loaded motion and rest (CSV: t,theta,q,i,tau_sensor); each may have encoder zeros of its own
    #[arg(long, required = true, num_args = 1..)]
    training: Vec<PathBuf>,
    #[command(flatten)]
    out: OutArguments,
}

#[derive(Args)]
struct StepArguments {
    /// The joint (TOML), with the tables that this fit needs
    #[arg(long)]
    joint: PathBuf,
    /// The logs (CSV: t,theta,q,i,tau_sensor; kinematic-error takes one, without tau_sensor)
    #[arg(long, required = true, num_args = 1..)]
    log: Vec<PathBuf>,
    #[command(flatten)]
    out: OutArguments,
}

#[derive(Args)]
struct OutArguments {
    /// File for the fitted joint (TOML)
    #[arg(short, long)]
    out: PathBuf,
    /// Write a page of figures of the training log by the fitted joint (HTML)
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Fit to logs that are not what they claim to be, as they stand; what is wrong with them is reported
    #[arg(long)]
    accept: bool,
    /// Print the results as JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &FitArguments) -> ExitCode {
    let done = match &arguments.what {
        What::All(arguments) => fit_all(arguments),
        What::One(step, arguments) => fit_one(step, arguments),
    };
    match done {
        Ok(report) => finish(&report),
        Err(problems) => {
            for problem in problems.0 {
                eprintln!("torquectl fit: {problem}");
            }
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn fit_all(arguments: &AllArguments) -> Result<String, Problems> {
    let joint = read_joint(&arguments.joint)?;
    let stem = stem(&arguments.out.out)?;
    let turn = match &arguments.no_load {
        Some(turn) => inspected(&joint, turn, LogKind::NoLoad, arguments.out.accept)
            .map(|(rows, lines)| (Some(rows), lines)),
        None => Ok((None, Vec::new())),
    };
    let train = training(
        &joint,
        &arguments.training,
        LogKind::Training,
        arguments.out.accept,
    );
    let ((turn, mut inputs), (train, of_train)) = both(turn, train)?;
    inputs.extend(of_train);
    let bar = bar();
    let fitted = all::fit(&joint, turn.as_deref(), &train, &mut progress(&bar));
    bar.finish_and_clear();
    let logs = names(arguments.no_load.iter().chain(&arguments.training));
    let fitted = fitted.map_err(|p| p.or_at(&logs, 0))?;
    page(&fitted, &arguments.out, &inputs, &train)?;
    Ok(write(&fitted, &arguments.out, &stem, &inputs)?)
}

/// Problems of both logs, where both have some.
fn both<A, B>(a: Result<A, Problems>, b: Result<B, Problems>) -> Result<(A, B), Problems> {
    match (a, b) {
        (Ok(a), Ok(b)) => Ok((a, b)),
        (Err(mut a), Err(b)) => {
            a.0.extend(b.0);
            Err(a)
        }
        (Err(problems), _) | (_, Err(problems)) => Err(problems),
    }
}

fn fit_one(step: &Step, arguments: &StepArguments) -> Result<String, Problems> {
    let joint = read_joint(&arguments.joint)?;
    let stem = stem(&arguments.out.out)?;
    let accept = arguments.out.accept;
    let (rows, inputs) = match (step.log, &arguments.log[..]) {
        (LogKind::NoLoad, [turn]) => inspected(&joint, turn, LogKind::NoLoad, accept)?,
        (LogKind::NoLoad, logs) => {
            let reason = format!("--log: {} logs", logs.len());
            return Err(Problem::new(reason, "one log of an unloaded turn each way").into());
        }
        (kind, logs) => training(&joint, logs, kind, accept)?,
    };
    let bar = bar();
    let fitted = all::fit_one(&joint, step, &rows, &mut progress(&bar));
    bar.finish_and_clear();
    let fitted = fitted.map_err(|p| p.or_at(&names(&arguments.log), 0))?;
    page(&fitted, &arguments.out, &inputs, &rows)?;
    Ok(write(&fitted, &arguments.out, &stem, &inputs)?)
}

/// The page of `--report`, written before the joint: a page that cannot be written changes nothing.
fn page(
    fitted: &Fitted,
    out: &OutArguments,
    inputs: &[String],
    rows: &[LogRow],
) -> Result<(), Problem> {
    let Some(path) = &out.report else {
        return Ok(());
    };
    let sections = [
        ("Logs".to_owned(), inputs.to_vec()),
        ("Fits".to_owned(), fitted.report.clone()),
    ];
    let title = format!("{}, fitted: its own training log", fitted.joint.joint.name);
    report::write(path, &title, &sections, &Traces::run(&fitted.joint, rows)?)
}

/// Progress on stderr, if that is a terminal.
fn bar() -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} {percent:>3} % {elapsed} {msg}");
    let bar = ProgressBar::new(1000);
    style.map_or(bar.clone(), |style| bar.with_style(style))
}

fn progress(bar: &ProgressBar) -> impl FnMut(f64, &str) {
    |part, what| {
        bar.set_position((1000.0 * part) as u64);
        bar.set_message(what.to_owned());
    }
}

/// The out file's name without `.toml`, from which trained files' names are made. Checked before
/// the fit, which takes a while and would be lost to a folder that does not exist.
fn stem(out: &Path) -> Result<String, Problem> {
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        let (out, folder) = (out.display(), folder.display());
        let reason = format!("--out {out}: {folder} is not a folder");
        return Err(Problem::new(reason, "a folder that exists"));
    }
    let toml = out.extension().is_some_and(|extension| extension == "toml");
    match out.file_stem().and_then(|stem| stem.to_str()) {
        Some(stem) if toml => Ok(stem.to_owned()),
        _ => {
            let reason = format!("--out {}: no name of a joint file", out.display());
            Err(Problem::new(reason, "a name in .toml"))
        }
    }
}

fn write(
    fitted: &Fitted,
    out: &OutArguments,
    stem: &str,
    inputs: &[String],
) -> Result<String, Problem> {
    let files = fitted.files(stem)?;
    let files = files.iter();
    let files = files.map(|(name, text)| (out.out.with_file_name(name), text.as_str()));
    let files: Vec<_> = files.collect();
    // A joint and what was trained for it belong together.
    terminal::write_files(&files)?;
    let written = files.iter().map(|(path, _)| path.display().to_string());
    let written: Vec<_> = written.collect();
    Ok(if out.json {
        let report = serde_json::json!({
            "inputs": inputs, "report": fitted.report, "written": written
        });
        format!("{report}\n")
    } else {
        format!(
            "{}\n{}\nwritten: {}\n",
            inputs.join("\n"),
            fitted.report.join("\n"),
            written.join(", ")
        )
    })
}

/// The logs' names, for a problem of all of them.
fn names<'a>(logs: impl IntoIterator<Item = &'a PathBuf>) -> String {
    let names = logs.into_iter().map(|path| path.display().to_string());
    names.collect::<Vec<_>>().join(", ")
}

/// Training logs as one, with what is reported of them.
fn training(
    joint: &JointFile,
    logs: &[PathBuf],
    kind: LogKind,
    accept: bool,
) -> Result<(Vec<LogRow>, Vec<String>), Problems> {
    let (mut rows, mut lines, mut problems) = (Vec::new(), Vec::new(), Vec::new());
    for path in logs {
        match inspected(joint, path, kind, accept) {
            Ok((of_log, reported)) => {
                rows.push(of_log);
                lines.extend(reported);
            }
            Err(found) => problems.extend(found.0),
        }
    }
    if !problems.is_empty() {
        return Err(Problems(problems));
    }
    let (rows, shifts) = joined(joint, rows, Zeros::OfEachLog)?;
    for (path, (shift, _)) in logs.iter().zip(&shifts).skip(1) {
        let (file, turns) = (path.display(), shift / std::f64::consts::TAU);
        lines.push(format!(
            "{file}: zero of the motor-side encoder {turns:.3} turns from that of the first log"
        ));
    }
    Ok((rows, lines))
}

/// The rows of a log that can be fitted to, and what is reported of them.
fn inspected(
    joint: &JointFile,
    path: &Path,
    kind: LogKind,
    accept: bool,
) -> Result<(Vec<LogRow>, Vec<String>), Problems> {
    let file = path.display().to_string();
    let mut log = open_log(path)?;
    let rows = log.rows()?;
    warn_of_cut(log.is_cut(), path);
    let of_file = |p: Problems| Problems(p.0.into_iter().map(|p| p.or_at(&file, 0)).collect());
    let inspection: Inspection = match inputs::inspect(joint, &rows, kind) {
        Err(problems) if accept => {
            let lines = problems.0.iter().map(|p| format!("{file}: accepted: {p}"));
            return Ok((rows, lines.collect()));
        }
        inspected => inspected.map_err(of_file)?,
    };
    let lines = inspection.lines().into_iter();
    let lines = lines.map(|line| format!("{file}: {line}")).collect();
    Ok((inspection.mended, lines))
}
