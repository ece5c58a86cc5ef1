//! `torquectl dynamics`: rigid-body dynamics of given states, to check a model against another
//! library.

use crate::BAD_INPUT;
use clap::Args;
use dynamics::Base;
use dynamics::cases::{Cases, evaluate};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Print rigid-body dynamics of given states as JSON
#[derive(Args)]
#[command(after_long_help = FORMAT)]
pub(crate) struct DynamicsArguments {
    /// The robot
    #[arg(long)]
    urdf: PathBuf,
    /// The root link moves freely; the base's six components then come first
    #[arg(long)]
    floating: bool,
    /// States, as JSON (see --help)
    cases: PathBuf,
}

const FORMAT: &str = r#"Reads {"joints":[names], "cases":[{"q":[], "dq":[], "ddq":[],
  "base":{"p":[3], "quat_xyzw":[4], "v":[6], "a":[6]}}]}
with the velocity and acceleration of the base linear then angular, in base axes; prints
  {"joints":[...], "cases":[{"tau":[], "M":[[]], "nle":[], "g":[], "ddq_of_tau":[], "com":[3]}]}.
Without "joints" the model's order holds; a mimic joint that is named there is independent.
A continuous joint has one angle. "dq", "ddq" and "base" may be left out and are zero.
Also read: "frames":[links] beside "joints", which adds each link's placement, motion and Jacobians;
"f_ext":{link:[6]} in a case, wrenches on links, in the link's axes at its origin.
An acceleration that is not finite (a joint that moves no mass) is printed as null."#;

pub(crate) fn run(arguments: &DynamicsArguments) -> ExitCode {
    match report(arguments) {
        Ok(json) => {
            println!("{json}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("torquectl dynamics: {message}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn report(arguments: &DynamicsArguments) -> Result<String, String> {
    let urdf = read(&arguments.urdf)?;
    let file = arguments.cases.display();
    let cases: Cases =
        serde_json::from_str(&read(&arguments.cases)?).map_err(|e| format!("{file}: {e}"))?;
    let base = if arguments.floating {
        Base::Floating
    } else {
        Base::Fixed
    };
    let name = arguments.urdf.display().to_string();
    let report = evaluate(&urdf, &name, base, &cases).map_err(|e| match e {
        dynamics::cases::CasesError::Urdf(e) => e.to_string(),
        dynamics::cases::CasesError::Request(e) => format!("{file}: {e}"),
    })?;
    serde_json::to_string(&report).map_err(|e| e.to_string())
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}
