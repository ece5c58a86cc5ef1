//! `torquectl check`: a configuration and its files, checked without starting anything.

pub(crate) mod bus_load;
mod frames;
mod gains;
mod json;
mod stand;
mod text;

use crate::margins;
use crate::output::finish_or_refuse;
use bus_load::{Bitrate, BusLoad, bus_loads, refusals};
use dynamics::{Frame, Model};
use plant::{CanRobot, SimParameters};
use problem::Problem;
use robot_config::{JointParameters, Problems, Robot};
use std::io;
use std::path::Path;
use std::process::ExitCode;

const EXAMPLES: &str = "\
Examples:
  torquectl check config/leg/robot.toml
  torquectl check --json config/humanoid/robot.toml
  torquectl check --bitrate 500000 config/leg/robot.toml

Every problem is printed on stderr as FILE:LINE: what is wrong; allowed: what is allowed.
A sim.toml beside CONFIG, with the parameters of the simulated robot, is checked too.
docs/configuration.md and docs/simulation.md describe every key.

Exit codes:
  0  the configuration is complete
  2  the configuration, its URDF or one of its DBC files has a problem or cannot be read, or a
     torque loop, or the hold of a drive that takes currents, has less margin than 30 degrees or 6 dB,
     or a bus cannot carry its frames at this bit rate";

/// Check a robot's configuration with its URDF and DBC files, and print a summary.
///
/// Nothing is started: CAN interfaces need not exist. A torque loop with less margin than 30 degrees or 6 dB is
/// refused, that of the predictive law and that of joints without a link-side encoder; so is a bus whose frames take
/// longer than a cycle.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CheckArguments {
    /// The robot's configuration
    #[arg(value_name = "CONFIG")]
    config: String,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// Bit rate of the buses, for the estimate of their load
    #[arg(long, value_name = "HZ", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(10_000..=20_000_000))]
    bitrate: u32,
    /// Bit rate of the data phase of CAN FD frames
    #[arg(long, value_name = "HZ", default_value_t = 5_000_000, value_parser = clap::value_parser!(u32).range(10_000..=20_000_000))]
    data_bitrate: u32,
}

pub(crate) fn run(arguments: &CheckArguments) -> ExitCode {
    finish_or_refuse(report(arguments))
}

fn report(arguments: &CheckArguments) -> Result<String, Problems> {
    let read = |path: &str| terminal::read_text(path);
    let robot = robot_config::load(&arguments.config, &read)?;
    check_simulation(&arguments.config, &robot)?;
    let rate = Bitrate {
        nominal: f64::from(arguments.bitrate),
        data: f64::from(arguments.data_bitrate),
    };
    let buses = bus_loads(&robot, rate);
    let mut warnings = warnings(&robot, &buses);
    let outdated = crate::prove::outdated(Path::new(&arguments.config), &robot)?;
    if !outdated.is_empty() {
        warnings.push(format!(
            "joints {} are not proven since their tables have changed: torquectl prove {}",
            outdated.join(", "),
            arguments.config
        ));
    }
    let judged = margins::judge(&robot);
    let mut refused = margins::refusals(&robot, &judged, &arguments.config);
    refused.extend(refusals(&robot, &buses, &arguments.config));
    if !refused.is_empty() {
        return Err(Problems(refused));
    }
    Ok(if arguments.json {
        format!("{:#}\n", json::object(&robot, &buses, &judged, &warnings))
    } else {
        text::page(&robot, &buses, &judged, &warnings)
    })
}

/// Checks the simulated robot's parameters beside the configuration, if there are any.
fn check_simulation(config: &str, robot: &Robot) -> Result<(), Problem> {
    let path = Path::new(config).with_file_name("sim.toml");
    let name = path.to_string_lossy();
    let text = match terminal::read_text(&path) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(Problem::unreadable(&name, &e)),
    };
    let sim = SimParameters::parse(&text, &name)?;
    let urdf = sim.urdf_or(&robot.parameters.urdf_path);
    let urdf = terminal::read_text(urdf).map_err(|e| Problem::unreadable(urdf, &e))?;
    CanRobot::new(robot, &urdf, &sim).map_err(|problem| problem.or_at(&name, 0))?;
    Ok(())
}

/// Findings that are unusual but do not keep the robot from running.
fn warnings(robot: &Robot, buses: &[BusLoad]) -> Vec<String> {
    let of_model = robot.model.warnings().iter();
    let mut warnings: Vec<String> = of_model.map(ToString::to_string).collect();
    let timing = &robot.parameters.timing;
    for (bus, load) in robot.parameters.buses.iter().zip(buses) {
        match &load.time {
            None => warnings.push(format!(
                "bus {}: udp_multicast is for simulated robots: datagrams have no priority, and a \
                 lost one is noticed only by what is missing",
                bus.name
            )),
            Some(time) if time.answers_s > timing.gather_deadline => warnings.push(format!(
                "bus {}: SYNC and answers take {:.0} us at worst, loop.gather_deadline_us is {:.0}",
                bus.name,
                time.answers_s * 1e6,
                timing.gather_deadline * 1e6
            )),
            Some(_) => {}
        }
        if load.received == 0 && load.sent == 0 {
            warnings.push(format!("bus {}: no signal of it is used", bus.name));
        }
    }
    let by_sensors = robot.parameters.torque_law.uses_sensors();
    if by_sensors && robot.parameters.ft_sensors.is_empty() {
        warnings.push(
            "control.torque_feedback is by F/T sensors and there is no F/T sensor: every contact \
             counts as joint torque"
                .to_owned(),
        );
    }
    for ft in &robot.parameters.ft_sensors {
        if mass_beyond(&robot.model, &ft.sensor.frame) <= 0.0 {
            let (name, frame) = (&ft.sensor.name, &ft.sensor.frame);
            warnings.push(format!(
                "F/T sensor {name}: nothing beyond it has a mass in the URDF (frame {frame})"
            ));
        }
    }
    warnings
}

/// Mass of a link and of all that it carries, kg.
fn mass_beyond(model: &Model, link: &str) -> f64 {
    let frames = model.frames();
    let Some(first) = model.frame_index(link) else {
        return 0.0;
    };
    let carried = |&(index, _): &(usize, &Frame)| {
        let mut chain = std::iter::successors(Some(index), |&i| frames[i].parent);
        chain.any(|i| i == first)
    };
    let beyond = frames.iter().enumerate().filter(carried);
    beyond.map(|(_, frame)| frame.inertia.mass).sum()
}

/// One count of the link-side encoder as torque, N·m: how fine torque from encoders can be; none without
/// that encoder.
fn torque_per_count(joint: &JointParameters) -> Option<f64> {
    let e = &joint.estimator;
    (joint.has_link_encoder).then_some(e.compliance.k_fs0 * e.link_resolution)
}

/// Limitations of joints without a link-side encoder, in sentences; none where every joint has one.
fn lacking(robot: &Robot) -> Option<String> {
    let p = &robot.parameters;
    let alone = p.joints.iter().filter(|joint| !joint.has_link_encoder);
    let names: Vec<&str> = alone.map(|joint| joint.name.as_str()).collect();
    (!names.is_empty()).then(|| {
        format!(
            "{}: no link-side encoder.\n\
             q is the motor's angle less the torsion that the estimated torque explains; dq and ddq contain no \
             vibration of the link on its gear.\n\
             No torque from encoders: torque is fed back from F/T sensors and IMU, {:.0} ms late; tau_hat has \
             its changes from motor current, with the motor's friction.\n\
             No second encoder contradicts one that slips or drifts: a step beyond what torque can make of the \
             rotor's velocity is found, and a drive whose current shows another set-point than was sent. A slow \
             drift is not found.",
            names.join(", "),
            1e3 * (p.filters.window - 1) as f64 * 0.5 * p.timing.sample_period,
        )
    })
}

fn command(joint: &JointParameters) -> &'static str {
    if joint.takes_position() {
        "position"
    } else {
        "current"
    }
}
