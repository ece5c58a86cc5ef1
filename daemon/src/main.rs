//! The command `torqued`.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::{CommandFactory, Parser, Subcommand};
use recording::AttachedFile;
use robot_config::Robot;
use robot_state::Content;
use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
use terminal::print;
use torqued::demo::{self, DemoOptions};
use torqued::failure::Failure;
use torqued::margins;
use torqued::recorder::Contents;
use torqued::run::RunOptions;
use torqued::simulation::{self, default_file};

/// Joint torques for robots without joint-torque sensors.
///
/// Exit codes: 0 success; 1 the system denied a resource, or a fault is latched at the end;
/// 2 bad input, nothing was started.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:
  torqued demo                                   a simulated humanoid, no hardware needed
  torqued demo --robot leg --plot leg.svg        a picture of true and estimated torques
  torqued run config/leg/robot.toml              the daemon
  torqued run config/leg/robot.toml --simulate   the same with a simulated robot, without CAN
  torqued run config/leg/robot.toml --seconds 10 --json"
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Estimate and control a simulated robot in this process: no hardware, no root, no CAN.
    #[command(after_help = "Examples:
  torqued demo --robot humanoid --seconds 10
  torqued demo --robot leg --plot leg.svg
  torqued demo --robot my_arm/robot.toml --plot arm.svg
  torqued demo --robot test-joint --json | jq .joints[0].whole_body
  torqued demo --robot humanoid --harness chest_pitch_link --motion sweeps.toml --seconds 60 \\
    --fast --record sweeps.mcap

A robot of your own needs a sim.toml beside its robot.toml, and may have a motion.toml
(docs/simulation.md).")]
    Demo(DemoOptions),
    /// Run the daemon: read the robot's frames, share its torques, command its drives.
    #[command(after_help = "Examples:
  torqued run /etc/torqued/leg/robot.toml
  torqued run config/leg/robot.toml --simulate
  torqued run config/leg/robot.toml --simulate sticky.toml --seed 7
  torqued run config/leg/robot.toml --record run.mcap
  torqued run config/leg/robot.toml --record run.mcap --content frames   # a sixth; a replay computes the rest
  torqued run config/leg/robot.toml --seconds 10 --json

What `torquectl check` refuses is not started: also a torque loop with less margin than 30 degrees or 6 dB, unless
--accept-margins is given.

With --simulate no CAN interface is needed: a simulated robot answers in this process, in real time.
Clients, torquectl, tares and faults work as on a robot. Where the computer is too slow, the simulated
robot's time passes more slowly.

Signals: SIGINT and SIGTERM bring the robot to rest, switch its drives off and end the daemon; SIGUSR1 brings
it to rest and holds it, as `torquectl stop` does.")]
    Run {
        /// The robot's configuration, e.g. config/leg/robot.toml.
        config: PathBuf,
        /// Duration, s; without it the daemon ends at SIGINT or SIGTERM.
        #[arg(long, value_name = "S")]
        seconds: Option<f64>,
        /// Simulate the robot, with these parameters [default: sim.toml beside CONFIG]
        #[arg(long, value_name = "SIM.toml", num_args = 0..=1)]
        #[expect(
            clippy::option_option,
            reason = "not given, given alone, given with a file"
        )]
        simulate: Option<Option<PathBuf>>,
        /// Seed of the simulated robot's noise and imperfections, instead of that in SIM.toml.
        #[arg(long, value_name = "N", requires = "simulate")]
        seed: Option<u64>,
        /// Record from the first cycle on into this new MCAP file; only such a recording can be
        /// replayed bit by bit.
        #[arg(long, value_name = "FILE")]
        record: Option<PathBuf>,
        /// What --record holds of every cycle: docs/recording.md.
        #[arg(long, value_name = "all|frames|torques", default_value_t)]
        content: Content,
        /// Messages a second, with --content torques; without it one for each cycle.
        #[arg(long, value_name = "HZ", requires = "record")]
        rate: Option<f64>,
        /// Run torque loops with less margin than 30 degrees or 6 dB: they may swing by themselves.
        #[arg(long)]
        accept_margins: bool,
        /// Print the summary as JSON.
        #[arg(long)]
        json: bool,
    },
}

fn main() -> ExitCode {
    if let Some(code) = terminal::pages(Arguments::command) {
        return code;
    }
    let arguments = Arguments::parse();
    torqued::log::start();
    let result = match arguments.command {
        Command::Demo(options) => demo::run(&options),
        Command::Run {
            config,
            seconds,
            simulate,
            seed,
            record,
            content,
            rate,
            accept_margins,
            json,
        } => {
            let sim = simulate.map(|file| file.unwrap_or_else(|| default_file(&config)));
            let sim = sim.as_deref().map(|file| (file, seed));
            let files = RefCell::new(Vec::new());
            read_robot(&config, &files).and_then(|robot| {
                margins::check(&robot, &config, accept_margins)?;
                let period_s = robot.parameters.timing.sample_period;
                let contents =
                    Contents::new(content, rate, period_s).map_err(Failure::bad_input)?;
                let record = record.map(|path| (path, contents));
                run(&robot, files.into_inner(), sim, seconds, record, json)
            })
        }
    };
    match result {
        Ok(code) => code,
        Err(failure) => {
            eprintln!("torqued: {}", failure.message);
            ExitCode::from(failure.exit_code)
        }
    }
}

/// Reads the configuration and the files that it names, and keeps their texts for recordings.
fn read_robot(config: &Path, files: &RefCell<Vec<AttachedFile>>) -> Result<Robot, Failure> {
    let read = |path: &str| {
        let text = terminal::read_text(path)?;
        let mut files = files.borrow_mut();
        // One that several drives share is read several times.
        if !files.iter().any(|file: &AttachedFile| file.path == path) {
            files.push(AttachedFile {
                path: path.to_owned(),
                text: text.clone(),
            });
        }
        Ok(text)
    };
    robot_config::load(&config.to_string_lossy(), &read).map_err(Failure::bad_input)
}

/// Runs the robot, or a simulated one with the parameters in the file `sim` and its seed.
fn run(
    robot: &Robot,
    files: Vec<AttachedFile>,
    sim: Option<(&Path, Option<u64>)>,
    seconds: Option<f64>,
    record: Option<(PathBuf, Contents)>,
    json: bool,
) -> Result<ExitCode, Failure> {
    let rate_hz = 1.0 / robot.parameters.timing.sample_period;
    let cycles = match seconds {
        None => None,
        Some(s) if s > 0.0 && s.is_finite() => Some((s * rate_hz).ceil() as u64),
        Some(s) => {
            return Err(Failure::bad_input(format!(
                "--seconds {s}: must be above 0"
            )));
        }
    };
    if let Some((path, _)) = record.as_ref().filter(|(path, _)| path.exists()) {
        return Err(Failure::bad_input(format!(
            "--record {}: there is such a file; allowed: the name of a new one",
            path.display()
        )));
    }
    let plant = sim.map(|(file, seed)| {
        let parameters = simulation::parameters(file, seed)?;
        simulation::robot(robot, &parameters, file)
    });
    let plant = plant.transpose()?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(Failure::environment)?;
    }
    let stop_and_hold = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(SIGUSR1, Arc::clone(&stop_and_hold))
        .map_err(Failure::environment)?;
    let options = RunOptions {
        cycles,
        files,
        record,
        stop_and_hold,
    };
    let summary = match plant {
        Some(plant) => torqued::run::simulate(robot, plant, options, &stop)?,
        None => torqued::run::run(robot, options, &stop)?,
    };
    if json {
        let json = serde_json::to_string(&summary).map_err(Failure::environment)?;
        print(&format!("{json}\n")).map_err(Failure::environment)?;
    } else {
        print(&summary.to_string()).map_err(Failure::environment)?;
    }
    Ok(ExitCode::from(u8::from(summary.fault != 0)))
}
