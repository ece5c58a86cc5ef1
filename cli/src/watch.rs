//! `torquectl watch`: measured, estimated and commanded torques of a running robot.

mod json;
mod screen;
mod text;

use crate::NO_DAEMON;
use crate::requests::{PATIENCE, connect};
use problem::{Allowed, Problem};
use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;
use std::thread::sleep;
use std::time::{Duration, Instant};
use torqued_client::{Client, Error, Record};

/// Clears the terminal and moves the cursor to its upper left corner.
const CLEAR: &str = "\x1b[2J\x1b[H";

const EXAMPLES: &str = "\
On a terminal it is a program: keys sort and filter the joints, choose the torque that is shown, hold the
picture; ? lists them. Into a pipe, or with --plain, it prints tables.

Examples:
  torquectl watch
  torquectl watch --plain
  torquectl watch --robot leg --once
  torquectl watch --json --rate 100 | jq '.joints[0].tau_whole_body.tau_Nm'

torquectl looks for the daemon in $TORQUED_RUN_DIR; else in /run/torqued, if the user is root or its
owner; else in $XDG_RUNTIME_DIR/torqued; else in /tmp/torqued-UID. The daemon must run as the same
user.

Exit codes:
  0  done
  1  no daemon answered within 2 s, or it went away";

/// Show the torques of a running robot: estimated from the encoders, from the F/T sensors and IMU,
/// and commanded.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct WatchArguments {
    /// The robot's name; optional if only one robot runs
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// Show one record and end
    #[arg(long)]
    once: bool,
    /// Print tables, also on a terminal
    #[arg(long)]
    plain: bool,
    /// Print JSON instead of text, one object per line
    #[arg(long)]
    json: bool,
    /// How often to show the newest record, 0.1 to 1000 Hz
    #[arg(long, value_name = "HZ", default_value_t = 5.0, value_parser = rate)]
    rate: f64,
}

pub(crate) fn run(arguments: &WatchArguments) -> ExitCode {
    match watch(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        // The reader of the output closed the pipe, as `head` does.
        Err(Failure::Output(e)) if e.kind() == io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(Failure::Output(e)) => {
            eprintln!("cannot print: {e}");
            ExitCode::from(NO_DAEMON)
        }
        Err(Failure::Daemon(e)) => {
            eprintln!("{e}");
            ExitCode::from(NO_DAEMON)
        }
    }
}

enum Failure {
    Daemon(Error),
    Output(io::Error),
}

impl From<Error> for Failure {
    fn from(e: Error) -> Self {
        Self::Daemon(e)
    }
}

impl From<io::Error> for Failure {
    fn from(e: io::Error) -> Self {
        Self::Output(e)
    }
}

fn watch(arguments: &WatchArguments) -> Result<(), Failure> {
    let prints = arguments.once || arguments.json || arguments.plain;
    let dumb = std::env::var_os("TERM").is_none_or(|term| term == "dumb");
    if !(prints || dumb) && io::stdout().is_terminal() && io::stdin().is_terminal() {
        return screen::run(arguments);
    }
    let mut client = connect(arguments.robot.as_ref())?;
    let mut out = io::stdout().lock();
    let redraw = !arguments.once && !arguments.json && out.is_terminal();
    let period = Duration::from_secs_f64(1.0 / arguments.rate);
    let mut next = Instant::now();
    loop {
        let record = newest(&mut client)?;
        let description = client.description();
        let shown = if arguments.json {
            json::object(description, &record).to_string()
        } else {
            text::screen(description, &record)
        };
        if redraw {
            out.write_all(CLEAR.as_bytes())?;
        }
        writeln!(out, "{shown}")?;
        out.flush()?;
        drop(record);
        if arguments.once {
            return Ok(());
        }
        next += period;
        sleep(next.saturating_duration_since(Instant::now()));
        // A terminal that could not keep up does not get the missed ones all at once.
        next = next.max(Instant::now() - period);
    }
}

/// The newest record; waits for one if there is none since the last call.
fn newest(client: &mut Client) -> Result<Record, Error> {
    match client.latest()? {
        Some(record) => Ok(record),
        None => client.next_record(PATIENCE),
    }
}

fn rate(text: &str) -> Result<f64, Problem> {
    const ALLOWED: Allowed = Allowed::Within(0.1, 1000.0);
    let rate = text.parse().ok().filter(|rate| ALLOWED.admits(*rate));
    rate.ok_or_else(|| Problem::new("not a rate in Hz", ALLOWED.to_string()))
}
