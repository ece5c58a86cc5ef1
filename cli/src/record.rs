//! `torquectl record`: the daemon's recorder writes a recorded run.

use crate::motion::catch_signals;
use crate::requests::{Failure, connect, end};
use indicatif::{ProgressBar, ProgressStyle};
use problem::{Allowed, Problem};
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::thread::sleep;
use std::time::Duration;
use torqued_client::robot_state::{Answer, Content, Request, Text, request};
use torqued_client::{Client, Error};

const HELP: &str = "\
The daemon writes the file itself, so the path must be writable for it. By default the file holds
everything that every cycle was given and gave, and the configuration's files: torquectl info, export and
replay need nothing else; PlotJuggler and Foxglove show its JointState, WrenchStamped and Imu messages.
Ctrl-C ends the recording cleanly; a recording whose torquectl was killed ends after 5 s.

--content frames holds what every cycle was given: torquectl computes the rest when it reads the file.
--content torques holds angles, torques, wrenches, commands and events with seven digits, without frames.

A replay is bit-exact only from the daemon's first cycle on: torqued run CONFIG --record FILE. Computed from
frames alone, the first seconds of a recording that begins later lack what filters and fits knew.

Examples:
  torquectl record -o run.mcap
  torquectl record -o run.mcap --seconds 60
  torquectl record -o night.mcap --content torques --rate 100
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
    /// What the file holds of every cycle
    #[arg(long, value_name = "all|frames|torques", default_value_t)]
    content: Content,
    /// Messages a second, with --content torques; without it one for each cycle
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Replace the file if it is there, once the new one has ended
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(arguments: &RecordArguments) -> ExitCode {
    end(record(arguments))
}

fn record(arguments: &RecordArguments) -> Result<String, Failure> {
    let stop = catch_signals().map_err(Failure::Argument)?;
    let client = connect(arguments.robot.as_ref())?;
    let (path, seconds) = (&arguments.output, arguments.seconds);
    let contents = (arguments.content, arguments.rate);
    let (last, force) = (arguments.last, arguments.force);
    let recording = Recording::begin(&client, path, seconds, last, contents, force)?;
    let bar = bar(&recording.path);
    loop {
        let answer = recording.state(&client)?;
        if answer.progress >= 1.0 {
            bar.finish_and_clear();
            return Ok(format!("{}: {}\n", recording.path, answer.text));
        }
        bar.set_message(answer.text.to_string());
        if stop.load(Ordering::Relaxed) {
            bar.finish_and_clear();
            return Ok(recording.end(&client)? + "\n");
        }
        sleep(ASK);
    }
}

/// A recording that the daemon makes. One that is not asked after for 5 s ends.
pub(crate) struct Recording {
    path: String,
}

impl Recording {
    /// Begins with `last` s before now; without `seconds` it goes on until its end is asked for. With the
    /// content so many messages a second; none: one for each cycle.
    ///
    /// # Errors
    /// A path that cannot be used, a file that is there and may not be replaced.
    pub(crate) fn begin(
        client: &Client,
        path: &Path,
        seconds: Option<f64>,
        last: f64,
        (content, rate_hz): (Content, Option<f64>),
        force: bool,
    ) -> Result<Self, Failure> {
        let unusable =
            |why: String| Failure::Argument(Problem::new(why, "a path of at most 1024 bytes"));
        let path = std::path::absolute(path).map_err(|e| unusable(e.to_string()))?;
        let path = path.to_str().filter(|path| path.len() <= 1024);
        let path = path.ok_or_else(|| unusable("the path is too long, or not UTF-8".to_owned()))?;
        let begin = Request {
            kind: request::RECORD,
            seconds: seconds.unwrap_or(-1.0),
            last_s: last,
            content: content.number(),
            rate_hz: rate_hz.unwrap_or(0.0),
            overwrite: u32::from(force),
            path: Text::new(path),
            ..Request::default()
        };
        client.send_request(begin, |_| ())?;
        let path = path.to_owned();
        Ok(Self { path })
    }

    /// Its state; to be asked for every second or so.
    pub(crate) fn state(&self, client: &Client) -> Result<Answer, Error> {
        client.request(request::RECORDING, "", |_| ())
    }

    /// Ends it; gives the path and the daemon's words about the file.
    pub(crate) fn end(self, client: &Client) -> Result<String, Error> {
        let answer = client.request(request::END_RECORDING, "", |_| ())?;
        Ok(format!("{}: {}", self.path, answer.text))
    }
}

fn bar(path: &str) -> ProgressBar {
    let bar = if io::stderr().is_terminal() {
        ProgressBar::new_spinner()
    } else {
        ProgressBar::hidden()
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
