//! `torquectl record`: the daemon's recorder writes a recorded run.

use crate::requests::{Failure, connect, end};
use indicatif::{ProgressBar, ProgressStyle};
use problem::{Allowed, Problem};
use signal_hook::consts::{SIGINT, SIGTERM};
use std::io::{self, IsTerminal};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::sleep;
use std::time::Duration;
use torqued_client::Client;
use torqued_client::robot_state::{Answer, Request, Text, request};

const HELP: &str = "\
The daemon writes the file itself, so the path must be writable for it. The file holds everything that
every cycle was given and gave, and the configuration's files: torquectl info, export and replay need
nothing else; PlotJuggler and Foxglove show its JointState, WrenchStamped and Imu messages. Ctrl-C
ends the recording cleanly; a recording whose torquectl was killed ends after 5 s.

A replay is bit-exact only from the daemon's first cycle on: torqued run CONFIG --record FILE.

Examples:
  torquectl record -o run.mcap
  torquectl record -o run.mcap --seconds 60
  torquectl record -o what-was-that.mcap --last 4 --seconds 0

Exit codes:
  0  recorded
  1  torqued could not be reached, went away, or refused: the file is there already, a full disk
  2  bad input: arguments";

/// Period at which the recording is asked after.
const ASK: Duration = Duration::from_millis(200);

/// Record a running robot into an MCAP file.
#[derive(clap::Args)]
#[command(after_help = HELP)]
pub(crate) struct RecordArguments {
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// The file to write
    #[arg(short, long, value_name = "RUN.mcap")]
    output: PathBuf,
    /// Duration from now on, s; without it until Ctrl-C
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<f64>,
    /// Record the time before now too, s, at most 5
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = seconds)]
    last: f64,
    /// Replace the file if it is there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(arguments: &RecordArguments) -> ExitCode {
    end(record(arguments))
}

fn record(arguments: &RecordArguments) -> Result<String, Failure> {
    let unusable =
        |why: String| Failure::Argument(Problem::new(why, "a path of at most 1024 bytes"));
    let path = std::path::absolute(&arguments.output).map_err(|e| unusable(e.to_string()))?;
    let path = path.to_str().filter(|path| path.len() <= 1024);
    let path = path.ok_or_else(|| unusable("the path is too long, or not UTF-8".to_owned()))?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        let registered = signal_hook::flag::register(signal, Arc::clone(&stop));
        registered.map_err(|e| unusable(format!("signals cannot be caught: {e}")))?;
    }
    let client = connect(arguments.robot.as_ref())?;
    let begin = Request {
        kind: request::RECORD,
        seconds: arguments.seconds.unwrap_or(-1.0),
        last_s: arguments.last,
        overwrite: u32::from(arguments.force),
        path: Text::new(path),
        ..Request::default()
    };
    client.send_request(begin, |_| ())?;
    let bar = bar(path);
    let last = loop {
        let answer = ask(&client, request::RECORDING)?;
        if answer.progress >= 1.0 {
            break answer;
        }
        bar.set_message(answer.text.to_string());
        if stop.load(Ordering::Relaxed) {
            break ask(&client, request::END_RECORDING)?;
        }
        sleep(ASK);
    };
    bar.finish_and_clear();
    Ok(format!("{path}: {}\n", last.text))
}

fn ask(client: &Client, kind: u32) -> Result<Answer, Failure> {
    Ok(client.request(kind, "", |_| ())?)
}

fn bar(path: &str) -> ProgressBar {
    let bar = match io::stderr().is_terminal() {
        true => ProgressBar::new_spinner(),
        false => ProgressBar::hidden(),
    };
    if let Ok(style) = ProgressStyle::with_template("{spinner} {prefix}: {msg}") {
        bar.set_style(style);
    }
    bar.set_prefix(path.to_owned());
    bar
}

fn seconds(text: &str) -> Result<f64, Problem> {
    const ALLOWED: Allowed = Allowed::Within(0.0, 86_400.0);
    let seconds = text.parse().ok().filter(|seconds| ALLOWED.admits(*seconds));
    seconds.ok_or_else(|| Problem::new("not a duration in s", ALLOWED.to_string()))
}
