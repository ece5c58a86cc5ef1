//! `torquectl can`: who is on a bus, and what it says of itself.

mod clear;
mod line;
mod page;
mod setup;

use crate::output::finish;
use clap::Subcommand;
use drives::scan::{BusToScan, Found, Scan};
use line::Line;
use robot_config::{BusParameters, Carrier, Robot, UdpGroup};
use serde_json::{Value, json};
use std::net::Ipv4Addr;
use std::process::ExitCode;
use torqued::failure::Failure;

const EXAMPLES: &str = "\
Examples:
  torquectl can scan
  torquectl can scan --bus can0
  torquectl can scan config/leg/robot.toml --json
  torquectl can show 3 --bus can0
  torquectl can clear 3 config/leg/robot.toml
  torquectl can setup --dry-run config/leg/robot.toml

Without CONFIG, BUS is a CAN interface, or GROUP:PORT of a UDP bus; without both, every CAN interface is scanned.
No daemon may use the bus meanwhile: its loop would take the answers for drives of its own.

Exit codes:
  0  done
  1  nobody answered, the bus cannot be used, a set-up is not as planned, or an error is still there
  2  bad input: arguments or configuration";

/// Find drives on a bus, show what they say of themselves, clear their errors, show what a set-up would write.
///
/// No question can move anything. The scan listens for 1.2 s first: nothing is asked under identifiers that an
/// ODrive would take as commands. CubeMars actuators know no question but a command, and are not found.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CanArguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Who is there: family, node, state, error, identity
    Scan(Where),
    /// All that one device says of itself
    Show(OneNode),
    /// Clear the error of a drive that is off
    Clear(OneNode),
    /// What the daemon would write to CANopen drives before it starts, with the values that are there
    Setup(SetupArguments),
}

/// The buses that are meant.
#[derive(clap::Args)]
pub(crate) struct Where {
    /// The robot's configuration: its buses, and its joints' names
    #[arg(value_name = "CONFIG")]
    config: Option<String>,
    /// One bus: of CONFIG by its name; without CONFIG a CAN interface or GROUP:PORT
    #[arg(long, value_name = "BUS")]
    bus: Option<String>,
    /// Without CONFIG: the bus carries CAN FD
    #[arg(long, conflicts_with = "config")]
    fd: bool,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

impl Where {
    /// All buses of a configuration.
    pub(crate) fn config(config: &str) -> Self {
        Self {
            config: Some(config.to_owned()),
            bus: None,
            fd: false,
            json: false,
        }
    }

    /// One bus that is no configuration's.
    pub(crate) fn bus(bus: &str, fd: bool) -> Self {
        Self {
            config: None,
            bus: Some(bus.to_owned()),
            fd,
            json: false,
        }
    }
}

#[derive(clap::Args)]
struct OneNode {
    /// Its identifier
    #[arg(value_name = "NODE", value_parser = clap::value_parser!(u8).range(0..=127))]
    node: u8,
    #[command(flatten)]
    at: Where,
}

#[derive(clap::Args)]
struct SetupArguments {
    /// Only read; the set-up itself is made by torqued
    #[arg(long, required = true)]
    dry_run: bool,
    /// The robot's configuration
    #[arg(value_name = "CONFIG")]
    config: String,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &CanArguments) -> ExitCode {
    let done = match &arguments.command {
        Command::Scan(at) => scan(at),
        Command::Show(one) => show(one),
        Command::Clear(one) => clear::run(one),
        Command::Setup(arguments) => setup::run(arguments),
    };
    match done {
        Ok((text, true)) => finish(&text),
        Ok((text, false)) => {
            finish(&text);
            ExitCode::FAILURE
        }
        Err(failure) => {
            eprintln!("{}", failure.message);
            ExitCode::from(failure.exit_code)
        }
    }
}

/// Lines that a command prints, and whether it did what was asked.
type Done = Result<(String, bool), Failure>;

/// The buses that are meant, and the robot whose they are.
struct Target {
    buses: Vec<BusParameters>,
    robot: Option<Robot>,
}

impl Target {
    fn of(at: &Where) -> Result<Self, Failure> {
        let Some(config) = &at.config else {
            let buses = match &at.bus {
                Some(bus) => vec![bus_parameters(bus, at.fd)?],
                None => line::interfaces(at.fd)?,
            };
            return Ok(Self { buses, robot: None });
        };
        let robot = load(config)?;
        let mut buses = robot.parameters.buses.clone();
        if let Some(name) = &at.bus {
            let names: Vec<_> = buses.iter().map(|bus| bus.name.clone()).collect();
            buses.retain(|bus| bus.name == *name);
            if buses.is_empty() {
                let allowed = names.join(", ");
                let what = format!("{config} has no bus {name:?}; allowed: {allowed}");
                return Err(Failure::bad_input(what));
            }
        }
        Ok(Self {
            buses,
            robot: Some(robot),
        })
    }

    /// The joint whose drive a device is; none: there is no such joint.
    fn joint(&self, found: &Found) -> Option<&str> {
        let robot = self.robot.as_ref()?;
        let name = &self.buses.get(usize::from(found.bus))?.name;
        let all = &robot.parameters.buses;
        let bus = all.iter().position(|bus| bus.name == *name)?;
        let at = (bus as u8, found.node);
        let plans = robot.nodes.plans.iter();
        let plan = plans.filter(|plan| (plan.bus, plan.node) == at);
        let actuators = robot.nodes.actuators.iter();
        let actuator =
            actuators.filter(|a| (a.at.bus, a.at.node) == at && a.family == found.family);
        let plan = plan.map(|plan| plan.name.as_str());
        plan.chain(actuator.map(|a| a.name.as_str())).next()
    }

    fn json(&self, found: &Found) -> Value {
        let facts = found
            .facts
            .iter()
            .map(|(name, value)| ((*name).to_owned(), json!(value)));
        json!({
            "bus": self.buses[usize::from(found.bus)].name,
            "node": found.node,
            "family": found.family,
            "joint": self.joint(found),
            "reply_id": found.reply,
            "state": found.state,
            "on": found.is_on,
            "error": found.error,
            "facts": facts.collect::<serde_json::Map<_, _>>(),
        })
    }
}

fn load(config: &str) -> Result<Robot, Failure> {
    let read = |path: &str| terminal::read_text(path);
    robot_config::load(config, &read).map_err(Failure::bad_input)
}

/// A bus that is no configuration's.
fn bus_parameters(bus: &str, fd: bool) -> Result<BusParameters, Failure> {
    let carrier = match bus.split_once(':') {
        None => Carrier::SocketCan(bus.to_owned()),
        Some((group, port)) => {
            let group: Option<Ipv4Addr> = group.parse().ok().filter(Ipv4Addr::is_multicast);
            let (Some(group), Ok(port)) = (group, port.parse()) else {
                let what = format!(
                    "--bus {bus:?} is not allowed; allowed: a CAN interface, or GROUP:PORT"
                );
                return Err(Failure::bad_input(what));
            };
            Carrier::UdpMulticast(UdpGroup {
                group,
                port,
                interface: None,
                hop_limit: 0,
            })
        }
    };
    Ok(BusParameters {
        name: bus.to_owned(),
        carrier,
        interface_place: "--bus".to_owned(),
        dbc_paths: Vec::new(),
        fd,
    })
}

/// Drives that a scan finds on the buses, and questions that it had to leave out.
fn scanned(
    line: &mut Line,
    buses: &[BusParameters],
    only: Option<u8>,
) -> (Vec<Found>, Vec<String>) {
    let of_bus = |(bus, parameters): (usize, &BusParameters)| BusToScan {
        bus: bus as u8,
        fd: parameters.fd,
    };
    let buses_to_scan = buses.iter().enumerate().map(of_bus);
    let mut scans: Vec<Scan> = buses_to_scan.map(|of| Scan::new(of, only)).collect();
    line.run(|frames, now, out| {
        for scan in &mut scans {
            frames
                .iter()
                .for_each(|frame| scan.receive(frame, now, out));
            scan.poll(now, out);
        }
        scans.iter().all(Scan::is_done)
    });
    let skipped = scans.iter().zip(buses).flat_map(|(scan, bus)| {
        let note = |node| {
            let name = &bus.name;
            format!(
                "{name}: an ODrive {node} was heard, what it could take as a command was not asked"
            )
        };
        scan.skipped().into_iter().map(note)
    });
    let notes = skipped.collect();
    (scans.iter().flat_map(Scan::found).collect(), notes)
}

fn scan(at: &Where) -> Done {
    let target = Target::of(at)?;
    let mut line = Line::open(&target.buses)?;
    let (found, notes) = scanned(&mut line, &target.buses, None);
    let text = if at.json {
        let found: Vec<_> = found.iter().map(|f| target.json(f)).collect();
        format!("{:#}\n", json!({ "found": found, "notes": notes }))
    } else {
        page::scan(&target, &found, &notes)
    };
    Ok((text, !found.is_empty()))
}

fn show(one: &OneNode) -> Done {
    let target = Target::of(&one.at)?;
    let mut line = Line::open(&target.buses)?;
    let (found, notes) = scanned(&mut line, &target.buses, Some(one.node));
    let text = if one.at.json {
        let found: Vec<_> = found.iter().map(|f| target.json(f)).collect();
        format!("{:#}\n", json!({ "found": found, "notes": notes }))
    } else {
        page::show(&target, &found, &notes)
    };
    Ok((text, !found.is_empty()))
}

/// Buses and nodes of the devices that answer.
pub(crate) fn answering(at: &Where) -> Result<Vec<(u8, u8)>, Failure> {
    let target = Target::of(at)?;
    let mut line = Line::open(&target.buses)?;
    let (found, _) = scanned(&mut line, &target.buses, None);
    Ok(found.iter().map(|found| (found.bus, found.node)).collect())
}

/// A bus, what a scan finds on it, and what it had to leave out.
pub(crate) fn found_on(at: &Where) -> Result<(BusParameters, Vec<Found>, Vec<String>), Failure> {
    let target = Target::of(at)?;
    let mut line = Line::open(&target.buses)?;
    let (mut found, notes) = scanned(&mut line, &target.buses, None);
    found.sort_by_key(|device| (device.bus, device.node));
    let bus = target.buses.into_iter().next();
    let bus = bus.ok_or_else(|| Failure::environment("no bus"))?;
    Ok((bus, found, notes))
}
