//! `torquectl new`: a configuration from a URDF and the drives that answer, with every guess marked.

mod drives;
mod text;
mod urdf;

use crate::can::{self, Where};
use crate::margins;
use crate::output::finish;
use ::drives::scan::Found;
use clap::Args;
use drives::Kind;
use problem::Problem;
use robot_config::{BusParameters, Carrier, Problems};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use text::Draft;
use torqued::failure::Failure;
use urdf::Joint;

const EXAMPLES: &str = "\
Examples:
  torquectl new arm --urdf arm.urdf --scan can0
  torquectl new arm --urdf arm.urdf --scan 239.74.163.2:43113 --fd

NAME/robot.toml is written; `torquectl check` passes it. Drives are given to joints in the order of their identifiers
and of the URDF. Numbers that no drive has reported end with `# guessed`: measure or look up each before the robot is
enabled. It is not enabled by itself.

Exit codes:
  0  written
  1  the bus cannot be used, or fewer drives answer than the URDF has joints
  2  bad input: arguments or URDF, or there is such a configuration already";

/// Write a configuration for a robot of whose drives nothing is known but that they answer.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct NewArguments {
    /// The robot's name, and that of its folder
    #[arg(value_name = "NAME")]
    name: String,
    /// The robot's URDF
    #[arg(long, value_name = "FILE")]
    urdf: PathBuf,
    /// The bus on which its drives are: a CAN interface or GROUP:PORT
    #[arg(long, value_name = "BUS")]
    scan: String,
    /// The bus carries CAN FD
    #[arg(long)]
    fd: bool,
}

pub(crate) fn run(arguments: &NewArguments) -> ExitCode {
    match written(arguments) {
        Ok(text) => finish(&text),
        Err(failure) => {
            eprintln!("{}", failure.message);
            ExitCode::from(failure.exit_code)
        }
    }
}

fn written(arguments: &NewArguments) -> Result<String, Failure> {
    let path = PathBuf::from(&arguments.name).join("robot.toml");
    if path.exists() {
        let what = format!("{} is there already; allowed: another name", path.display());
        return Err(Failure::bad_input(what));
    }
    let joints = urdf::joints(&arguments.urdf).map_err(Failure::bad_input)?;
    let (mut bus, found, notes) = can::found_on(&Where::bus(&arguments.scan, arguments.fd))?;
    if matches!(bus.carrier, Carrier::UdpMulticast(_)) {
        // Its group is no name.
        "udp".clone_into(&mut bus.name);
    }
    let found: Vec<Found> = found
        .into_iter()
        .filter(|f| f.family != "canopen")
        .collect();
    if found.len() < joints.len() {
        let (drives, wanted) = (found.len(), joints.len());
        let what = format!(
            "{drives} drives answer, and the URDF has {wanted} joints: see `torquectl can scan`"
        );
        return Err(Failure::environment(what));
    }
    let draft = draft(arguments, &joints, bus, &found)?;
    let text = passing(draft, &path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(Failure::environment)?;
    terminal::write_file(&path, &text).map_err(Failure::environment)?;
    let guessed = text
        .lines()
        .filter(|line| line.ends_with("# guessed"))
        .count();
    let mut said = format!(
        "{}: {} joints; {guessed} lines end with `# guessed`: measure or look them up before the robot is enabled\n",
        path.display(),
        joints.len()
    );
    for left in found.iter().skip(joints.len()) {
        said += &format!(
            "note: {} {} moves no joint of the URDF\n",
            left.family, left.node
        );
    }
    for note in notes {
        said += &format!("note: {note}\n");
    }
    Ok(said)
}

fn draft(
    arguments: &NewArguments,
    joints: &[Joint],
    bus: BusParameters,
    found: &[Found],
) -> Result<Draft, Failure> {
    let fastest = joints
        .iter()
        .map(|joint| joint.velocity)
        .fold(0.0, f64::max);
    let mut kinds: Vec<Kind> = Vec::new();
    let mut of_joints = Vec::new();
    for (joint, device) in joints.iter().zip(found) {
        let kind = Kind::of(device, fastest).ok_or_else(|| {
            Failure::environment(format!("family {} has no profile", device.family))
        })?;
        let known = kinds.iter().position(|other| *other == kind);
        let index = known.unwrap_or_else(|| {
            kinds.push(kind);
            kinds.len() - 1
        });
        of_joints.push((joint.clone(), device.clone(), index));
    }
    let urdf = &arguments.urdf;
    let urdf = if urdf.is_absolute() {
        urdf.clone()
    } else {
        Path::new("..").join(urdf)
    };
    Ok(Draft {
        name: arguments.name.clone(),
        urdf: urdf.display().to_string(),
        bus,
        kinds,
        gains: vec![0; of_joints.len()],
        joints: of_joints,
    })
}

/// The draft with the first gains, joint by joint, that `check` does not refuse.
fn passing(mut draft: Draft, path: &Path) -> Result<String, Failure> {
    let file = path.display().to_string();
    loop {
        let text = draft.text();
        let read = |wanted: &str| {
            if Path::new(wanted) == path {
                Ok(text.clone())
            } else {
                // The folder of the configuration need not be there yet.
                let folder = path.parent().unwrap_or(Path::new("."));
                let inside = Path::new(wanted).strip_prefix(folder.join(".."));
                terminal::read_text(inside.unwrap_or(Path::new(wanted)))
            }
        };
        let robot = robot_config::load(&file, &read).map_err(Failure::bad_input)?;
        let judged = margins::judge(&robot);
        let refused = margins::refusals(&robot, &judged, &file);
        if refused.is_empty() {
            return Ok(text);
        }
        if !draft.soften(&refused) {
            return Err(no_gains(refused));
        }
    }
}

fn no_gains(refused: Vec<Problem>) -> Failure {
    Failure::bad_input(format!(
        "no gains of those tried have enough margin with the guessed drive:\n{}",
        Problems(refused)
    ))
}
