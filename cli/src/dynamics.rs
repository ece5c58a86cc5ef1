//! `torquectl dynamics`: rigid-body dynamics of given states, to check a model against another
//! library.

mod evaluation;
mod report;
mod request;

use crate::output::{finish_or_refuse, read_input};
use clap::Args;
use dynamics::Base;
use evaluation::evaluate;
use problem::Problem;
use request::Cases;
use std::path::PathBuf;
use std::process::ExitCode;

/// Print rigid-body dynamics of given states as JSON
#[derive(Args)]
#[command(after_long_help = FORMAT)]
pub(crate) struct DynamicsArguments {
    /// The robot's URDF file
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
  {"joints":[...], "cases":[{"tau":[], "M":[[]], "nle":[], "g":[], "ddq_of_tau":[], "com":[3]}]}
with the base's six components first, then the joints in the order of "joints": all moving joints,
in any order. A mimic joint is independent if "joints" names it, and follows its joint otherwise.
Without "joints" the order is the model's: depth first, children sorted by name.
A continuous joint has one angle. "dq", "ddq" and "base" are optional, and zero by default.
An acceleration that is not finite (of a joint that moves no mass) is printed as null.

Optional keys beside "joints":
  "frames":[links]          adds each link's placement, motion and Jacobians
  "armature":{joint: x}     inertia that motors add about the joints' axes, kg m^2
  "more":true               adds centroidal momentum, energies, regressor and solutions with M
Optional keys of a case:
  "f_ext":{link:[6]}        wrenches on links, in the link's axes at its origin, linear first

Examples:
  echo '{"cases":[{"q":[0.1], "dq":[0], "ddq":[1]}]}' > joint.json
  torquectl dynamics --urdf robot-models/test-joint/robot.urdf joint.json
  echo '{"cases":[{"q":[0,0,0,0.5,0,0], "base":{"p":[0,0,1], "quat_xyzw":[0,0,0,1]}}]}' > leg.json
  torquectl dynamics --urdf robot-models/leg/robot.urdf --floating leg.json"#;

pub(crate) fn run(arguments: &DynamicsArguments) -> ExitCode {
    finish_or_refuse(report(arguments))
}

fn report(arguments: &DynamicsArguments) -> Result<String, Problem> {
    let urdf = read_input(&arguments.urdf)?;
    let file = arguments.cases.display().to_string();
    let text = read_input(&arguments.cases)?;
    let cases = parse(&text).map_err(|problem| problem.or_at(&file, 0))?;
    let base = if arguments.floating {
        Base::Floating
    } else {
        Base::Fixed
    };
    let urdf_file = arguments.urdf.display().to_string();
    let report = evaluate((&urdf, &urdf_file), base, (&cases, &file))?;
    for warning in &report.warnings {
        eprintln!("warning: {warning}");
    }
    let json = serde_json::to_string(&report).map_err(|e| Problem::new(e.to_string(), ""))?;
    Ok(json + "\n")
}

/// The request; a problem names the key that is wrong, beside line and column.
fn parse(text: &str) -> Result<Cases, Problem> {
    let mut json = serde_json::Deserializer::from_str(text);
    let cases =
        serde_path_to_error::deserialize(&mut json).map_err(|e| match e.path().iter().next() {
            Some(_) => Problem::new(e.to_string(), ""),
            None => Problem::new(e.inner().to_string(), ""),
        })?;
    (json.end()).map_err(|e| Problem::new(e.to_string(), ""))?;
    Ok(cases)
}
