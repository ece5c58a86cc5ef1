//! `torquectl doctor`: what on this machine keeps a robot from running, or its cycles from being on time.

mod can;
mod finding;
mod interrupts;
mod kernel;
mod links;
mod machine;
mod nodes;
mod processor;
mod service;
mod shared_memory;

use crate::BAD_INPUT;
use crate::output::finish;
use finding::Findings;
use machine::{Machine, Root};
use robot_config::Robot;
use service::Service;
use std::path::PathBuf;
use std::process::ExitCode;
use torqued::failure::Failure;

const EXAMPLES: &str = "\
Examples:
  torquectl doctor
  torquectl doctor /etc/torqued/leg/robot.toml
  sudo torquectl doctor --fix /etc/torqued/leg/robot.toml
  torquectl doctor --nodes --json config/leg/robot.toml | jq '.findings[].id'

Without CONFIG, that of the only robot whose service is enabled is taken. docs/install.md explains each finding.
--fix makes only changes that harm nothing and that a reboot undoes; root may make them.

Exit codes:
  0  nothing found
  1  something found
  2  bad input: arguments or configuration";

/// Find what on this machine keeps a robot from running, or its cycles from being on time.
///
/// Each finding says what it is, why it matters, and the command that mends it. Looked at are kernel, processor,
/// interrupts, rights, service, shared memory and CAN interfaces. Nothing is changed without --fix.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct DoctorArguments {
    /// The robot's configuration
    #[arg(value_name = "CONFIG")]
    config: Option<String>,
    /// Change what is safe to change until the next boot, and look again
    #[arg(long)]
    fix: bool,
    /// Ask on the buses whether every drive answers; no daemon may use them meanwhile
    #[arg(long)]
    nodes: bool,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// A folder that stands for the root of the file system
    #[arg(long, value_name = "DIR", default_value = "/", hide = true)]
    root: PathBuf,
}

pub(crate) fn run(arguments: &DoctorArguments) -> ExitCode {
    match diagnosis(arguments) {
        Ok((text, is_well)) => match (finish(&text), is_well) {
            (code, true) => code,
            (_, false) => ExitCode::FAILURE,
        },
        Err(failure) => {
            eprintln!("{}", failure.message);
            ExitCode::from(failure.exit_code)
        }
    }
}

/// Text for the user, and whether no defect was found.
fn diagnosis(arguments: &DoctorArguments) -> Result<(String, bool), Failure> {
    let (machine, config) = machine(arguments)?;
    let mut findings = examine(&machine);
    let mut done = Vec::new();
    if arguments.fix {
        done = findings.fix(&machine.root);
        findings = examine(&machine);
    }
    if arguments.nodes {
        let (Some(robot), Some(config)) = (&machine.robot, &config) else {
            let what = "--nodes needs CONFIG, or one enabled service";
            return Err(Failure {
                message: what.to_owned(),
                exit_code: BAD_INPUT,
            });
        };
        nodes::check(robot, config, &mut findings)?;
    }
    findings.found.sort_by_key(|finding| finding.level);
    let text = if arguments.json {
        format!("{:#}\n", findings.json(&done))
    } else {
        findings.text(&done)
    };
    Ok((text, findings.found.is_empty()))
}

fn machine(arguments: &DoctorArguments) -> Result<(Machine, Option<String>), Failure> {
    let root = Root::new(arguments.root.clone());
    let service = Service::find(&root);
    let of_service = service.as_ref().and_then(Service::only_configuration);
    // A service whose configuration is missing is a finding, not bad input.
    let of_service = of_service
        .map(|file| root.path(&file))
        .filter(|file| file.exists());
    let of_service = of_service.map(|file| file.to_string_lossy().into_owned());
    let config = arguments.config.clone().or(of_service);
    let robot = config.as_deref().map(load).transpose()?;
    Ok((
        Machine {
            root,
            robot,
            service,
        },
        config,
    ))
}

fn load(config: &str) -> Result<Robot, Failure> {
    let read = |path: &str| terminal::read_text(path);
    robot_config::load(config, &read).map_err(Failure::bad_input)
}

fn examine(machine: &Machine) -> Findings {
    let mut findings = Findings::default();
    let checks = [
        kernel::check,
        processor::check,
        interrupts::check,
        service::check,
        shared_memory::check,
        can::check,
    ];
    for check in checks {
        check(machine, &mut findings);
    }
    findings
}
