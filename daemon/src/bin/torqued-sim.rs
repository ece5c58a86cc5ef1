//! The command `torqued-sim`: the simulated robot as a process of its own on CAN.

use can_codec::{Frames, Gather};
use clap::{CommandFactory, Parser};
use plant::CanRobot;
use robot_config::Robot;
use serde::Serialize;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::fmt;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use terminal::print;
use torqued::bus::{Bus, Network, Waiting};
use torqued::failure::Failure;
use torqued::real_time::{self, RealTime, Settings};
use torqued::simulation;

/// Frames read at once: one batch of the bus.
const BATCH: usize = 64;
/// Longest wait on a bus without frames, ns; with drives that have clocks of their own.
const LOOK_NS: u64 = 50_000_000;
const LOOK_OF_NODES_NS: u64 = 500_000;

/// A simulated robot on CAN: answers SYNC as the robot's drives and sensors would.
///
/// Prints "ready" to standard error, and notifies systemd, once it listens. Ends at SIGINT, SIGTERM or
/// after --seconds, with a summary.
///
/// Exit codes: 0 success; 1 the system denied a resource; 2 bad input, nothing was started.
#[derive(Parser)]
#[command(
    name = "torqued-sim",
    version,
    after_help = "Examples:
  torqued-sim config/leg/robot.toml
  torqued-sim config/leg/robot.toml --sim sticky.toml --seed 7
  torqued-sim config/leg/robot.toml --seconds 10 --json | jq .frames_unknown
A virtual CAN bus for it, as root:
  ip link add dev vcan0 type vcan && ip link set vcan0 mtu 72 up"
)]
struct Arguments {
    /// The robot's configuration, e.g. config/leg/robot.toml: the same as the daemon's.
    config: PathBuf,
    /// Parameters of the simulated robot [default: sim.toml beside CONFIG]
    #[arg(long, value_name = "SIM.toml")]
    sim: Option<PathBuf>,
    /// Duration, s; without it the program ends at SIGINT or SIGTERM.
    #[arg(long, value_name = "S")]
    seconds: Option<f64>,
    /// Seed of the noise and imperfections, instead of that in SIM.toml.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Print the summary as JSON.
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    if let Some(code) = terminal::pages(Arguments::command) {
        return code;
    }
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("torqued-sim: {}", failure.message);
            ExitCode::from(failure.exit_code)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let seconds = match arguments.seconds {
        Some(s) if !(s > 0.0 && s < 1e9) => {
            let message = format!("--seconds {s}: allowed: a number above 0 and below 1e9");
            return Err(Failure::bad_input(message));
        }
        other => other,
    };
    let (robot, plant) = load(arguments)?;
    let bus = Network::open(&robot.parameters.buses)?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(Failure::environment)?;
    }
    let _until_the_end = be_punctual(&robot);
    eprintln!("ready: {} waits for SYNC", robot.parameters.name);
    // Nobody may be waiting for it: then there is nothing to notify.
    let _ = sd_notify::notify(&[sd_notify::NotifyState::Ready]);
    let end_ns = seconds.map_or(u64::MAX, |s| bus.now_ns() + (s * 1e9) as u64);
    let summary = Simulation::new(&robot, plant, bus).run(&stop, end_ns);
    if arguments.json {
        let json = serde_json::to_string(&summary).map_err(Failure::environment)?;
        print(&format!("{json}\n")).map_err(Failure::environment)?;
    } else {
        print(&summary.to_string()).map_err(Failure::environment)?;
    }
    Ok(())
}

fn load(arguments: &Arguments) -> Result<(Robot, CanRobot), Failure> {
    let config = arguments.config.to_string_lossy();
    let read = |path: &str| terminal::read_text(path);
    let robot = robot_config::load(&config, &read).map_err(Failure::bad_input)?;
    let beside = || simulation::default_file(&arguments.config);
    let file = arguments.sim.clone().unwrap_or_else(beside);
    let sim = simulation::parameters(&file, arguments.seed)?;
    if let Some(table) = sim.free_running() {
        return Err(Failure::bad_input(format!(
            "{}: {table}.sampled: on a CAN bus a frame is stamped when it comes, and all frames \
             come after SYNC; allowed: \"at_sync\"",
            file.display()
        )));
    }
    let plant = simulation::robot(&robot, &sim, &file)?;
    Ok((robot, plant))
}

/// Answers late if others use the CPU, so it takes what real time it can get: the loop's own priority.
/// Where both have one CPU, the loop then reads all answers at once; one step below, it would
/// interrupt the answers at each frame. Drives are no part of the daemon's report: no warnings.
fn be_punctual(robot: &Robot) -> Option<RealTime> {
    let settings = Settings {
        require: false,
        priority: robot.parameters.timing.priority,
        cpu: None,
    };
    real_time::enter(&settings).ok()
}

/// The robot and the bus it is on.
struct Simulation<'a> {
    robot: &'a Robot,
    plant: CanRobot,
    bus: Network,
    summary: Summary,
    /// SYNC frames of each bus.
    syncs: Vec<u64>,
}

impl<'a> Simulation<'a> {
    fn new(robot: &'a Robot, plant: CanRobot, bus: Network) -> Self {
        Self {
            robot,
            plant,
            bus,
            summary: Summary {
                robot: robot.parameters.name.clone(),
                ..Summary::default()
            },
            syncs: vec![0; robot.parameters.buses.len()],
        }
    }

    fn run(mut self, stop: &AtomicBool, end_ns: u64) -> Summary {
        // A robot that was stopped for a while finds a backlog: the answers to what is read at
        // once must have room.
        let own = 2 * self.robot.nodes.mounted.len();
        let answers = BATCH * (self.robot.receive.message_count() + own);
        let look = if own > 0 { LOOK_OF_NODES_NS } else { LOOK_NS };
        let (mut rx, mut tx) = (Frames::new(BATCH), Frames::new(answers));
        // Waits for nothing in particular, so it is complete with whatever is there.
        let mut whatever = Gather::new(0);
        let started = self.bus.now_ns();
        while !stop.load(Ordering::Relaxed) && self.bus.now_ns() < end_ns {
            self.bus.wait(end_ns.min(self.bus.now_ns() + look));
            rx.clear();
            tx.clear();
            self.bus
                .receive(&mut rx, &mut whatever, &self.robot.send, 0);
            self.plant.exchange(&rx, self.bus.now_ns(), &mut tx);
            self.bus.send(&tx);
            // The answers are on their way: time to count.
            self.count(&rx);
        }
        self.sum_up(started)
    }

    fn count(&mut self, rx: &Frames) {
        for frame in rx {
            let is_sync = |sync: &can_codec::Frame| sync.bus == frame.bus && sync.id == frame.id;
            if frame.error {
                continue;
            }
            if self.robot.sync.iter().any(is_sync) {
                self.syncs[usize::from(frame.bus)] += 1;
            }
        }
    }

    fn sum_up(self, started_ns: u64) -> Summary {
        let counters = self.bus.counters();
        let undecoded = self.plant.undecoded_frames();
        Summary {
            frames_unknown: self.plant.unknown_frames() - undecoded,
            frames_undecoded: undecoded,
            seconds: (self.bus.now_ns() - started_ns) as f64 * 1e-9,
            cycles: self.syncs.iter().copied().max().unwrap_or(0),
            syncs: self.syncs.iter().sum(),
            frames_received: counters.received,
            frames_sent: counters.sent,
            send_failed: counters.send_failed,
            error_frames: counters.error_frames,
            frames_lost: counters.dropped,
            ..self.summary
        }
    }
}

/// Traffic between daemon and robot, counted by the robot.
#[derive(Debug, Default, Serialize)]
struct Summary {
    robot: String,
    seconds: f64,
    cycles: u64,
    syncs: u64,
    frames_received: u64,
    frames_sent: u64,
    frames_unknown: u64,
    frames_undecoded: u64,
    frames_lost: u64,
    send_failed: u64,
    error_frames: u64,
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: {} cycles in {:.3} s, {} SYNC frames",
            self.robot, self.cycles, self.seconds, self.syncs
        )?;
        writeln!(
            f,
            "received   {} frames, {} of an unknown id, {} of a wrong length, {} lost, {} error \
             frames",
            self.frames_received,
            self.frames_unknown,
            self.frames_undecoded,
            self.frames_lost,
            self.error_frames
        )?;
        writeln!(
            f,
            "sent       {} frames, {} refused",
            self.frames_sent, self.send_failed
        )
    }
}
