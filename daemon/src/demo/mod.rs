//! `torqued demo`: the whole chain against a simulated robot in this process.
//!
//! The plant and the daemon exchange the same CAN frames as on a bus, in lock-step on a virtual
//! clock: the torques do not depend on the machine's speed. Cycles begin in real time, so that
//! late ones mean something.

mod accuracy;
mod client;
mod motion;
mod plot;
mod report;
mod robots;
mod scene;
mod selection;
mod stance;

pub use client::DemoClient;
pub use motion::Motion;

use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::Args;
use cycle::ClientInput;
use indicatif::{ProgressBar, ProgressStyle};
use plant::CanRobot;
use recording::AttachedFile;
use robot_config::Robot;

use crate::bring_up::bring_up;
use crate::bus::LockStep;
use crate::bus::in_process::{SimulatedDeadline, VirtualClock, VirtualDeadline};
use crate::control_loop::ControlLoop;
use crate::failure::Failure;
use crate::real_time::Pace;
use report::Report;
use selection::Selection;
use terminal::print;

/// Options of `torqued demo`.
#[derive(Debug, Clone, Args)]
pub struct DemoOptions {
    /// The robot: test-joint, leg, hrp2-like, lift-gripper, humanoid, or the path of a robot.toml with a sim.toml beside it.
    #[arg(long, value_name = "ROBOT", default_value = "humanoid")]
    pub robot: String,
    /// Take the robot as data sheets have it, without its calibration.
    #[arg(long)]
    pub uncalibrated: bool,
    /// Duration, s.
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub seconds: f64,
    /// Draw true and estimated torques into this file.
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Joints to draw, separated by commas, or `all` [default: the six most loaded of different limbs]
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "plot")]
    pub joints: Vec<String>,
    /// Print the report as JSON.
    #[arg(long)]
    pub json: bool,
    /// Do not wait for real time between cycles.
    #[arg(long)]
    pub fast: bool,
    /// Seed of the simulated robot's noise and imperfections [default: that of its sim.toml]
    #[arg(long)]
    pub seed: Option<u64>,
    /// The motion [default: motion.toml beside the configuration]
    #[arg(long, value_name = "FILE.toml")]
    pub motion: Option<PathBuf>,
    /// Hang the robot in a stiff harness by this link, without a floor.
    #[arg(long, value_name = "LINK")]
    pub harness: Option<String>,
    /// Record every cycle into this new MCAP file.
    #[arg(long, value_name = "RUN.mcap")]
    pub record: Option<PathBuf>,
}

/// Runs the demo.
///
/// # Errors
/// Options that cannot be met, a plot that cannot be written.
pub fn run(options: &DemoOptions) -> Result<ExitCode, Failure> {
    if !(options.seconds.is_finite() && options.seconds > 0.0 && options.seconds <= 86_400.0) {
        return Err(Failure::bad_input(format!(
            "--seconds {}: allowed: above 0, at most a day",
            options.seconds
        )));
    }
    let scene = scene::load(options)?;
    let robot = &scene.robot;
    let selection = Selection::new(&options.joints, robot).map_err(Failure::bad_input)?;
    let configuration = scene.files.first().map(|file| file.path.clone());
    let report = simulate(options, robot, scene.plant, scene.motion, scene.files)?;
    if let Some(path) = &options.plot {
        let torques: Vec<f64> = report.joints.iter().map(|j| j.largest_torque).collect();
        let joints = selection.joints(robot, &torques);
        (report.draw(path, &joints)).map_err(Failure::bad_input)?;
    }
    if options.json {
        let json = serde_json::to_string(&report).map_err(Failure::environment)?;
        print(&format!("{json}\n")).map_err(Failure::environment)?;
    } else {
        print(&report.to_string()).map_err(Failure::environment)?;
        // By name it is the robot that this program was built with, whatever was calibrated since.
        let by_name = robots::NAMES.contains(&options.robot.as_str());
        if let Some(path) = configuration.filter(|_| by_name) {
            let path = format!("configuration {path}, as built in; of a file: --robot FILE\n");
            print(&path).map_err(Failure::environment)?;
        }
    }
    Ok(ExitCode::from(u8::from(report.summary.fault != 0)))
}

fn simulate(
    options: &DemoOptions,
    robot: &Robot,
    plant: CanRobot,
    motion: Motion,
    files: Vec<AttachedFile>,
) -> Result<Report, Failure> {
    let period = robot.parameters.timing.sample_period;
    let cycles = (options.seconds / period).ceil() as u64;
    let clock = VirtualClock::new();
    let period_ns = (period * 1e9) as u64;
    let mut pace: Box<dyn Pace> = if options.fast {
        Box::new(VirtualDeadline::new(&clock, period_ns))
    } else {
        Box::new(SimulatedDeadline::new(&clock, period_ns))
    };
    let mut client = DemoClient::new(robot, motion);
    let mut report = Report::new(robot, cycles);
    let mut bus = LockStep::new(plant, &clock);
    bring_up(robot, &mut bus, &AtomicBool::new(false))?;
    (bus.translate(&robot.nodes.actuators)).map_err(Failure::bad_input)?;
    // Nobody watches over its drives.
    drop(bus.listener());
    let mut control_loop = ControlLoop::new(robot, bus).map_err(Failure::bad_input)?;
    let mut recording = match &options.record {
        Some(path) => Some(scene::Recording::begin(
            robot,
            files,
            path,
            &mut control_loop,
        )?),
        None => None,
    };
    let progress = progress_bar(cycles, options.json);
    for cycle in 0..cycles {
        let wake = pace.wait();
        let input = ClientInput {
            reference: Some(client.reference()),
            request: client.request(),
            ..ClientInput::default()
        };
        let record = control_loop.run_cycle(&wake, &input);
        client.observe(record);
        report.take(record);
        report.compare(control_loop.bus().peer().truth());
        recording.iter_mut().for_each(scene::Recording::poll);
        progress.set_position(cycle);
    }
    progress.finish_and_clear();
    report.finish(control_loop.bus().peer());
    control_loop.end_as_asked();
    drop(control_loop);
    recording.map_or(Ok(()), scene::Recording::end)?;
    Ok(report)
}

/// A progress bar on a terminal; none where a program reads the output.
fn progress_bar(cycles: u64, json: bool) -> ProgressBar {
    if json || !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{bar:40} {percent} % of {len} cycles, {eta} left");
    let bar = ProgressBar::new(cycles);
    bar.enable_steady_tick(Duration::from_millis(200));
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
