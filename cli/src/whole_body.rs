//! `torquectl whole-body`: torques and contact wrenches of given instants, to check the estimator
//! against another library.

mod evaluation;
pub(crate) mod of_robot;
mod report;
pub(crate) mod request;
pub(crate) mod sensors_file;

use crate::output::{finish_or_refuse, read_input};
use clap::Args;
use evaluation::evaluate;
use of_robot::sensors_text;
use problem::{Problem, Problems};
use request::Cases;
use sensors_file::SensorsFile;
use std::path::PathBuf;
use std::process::ExitCode;

/// Print joint torques and contact wrenches from F/T sensors and IMU, as JSON
#[derive(Args)]
#[command(after_long_help = FORMAT)]
pub(crate) struct WholeBodyArguments {
    /// The robot's URDF file
    #[arg(long)]
    urdf: PathBuf,
    /// The robot's sensors, as TOML (see --help), or its robot.toml
    #[arg(long)]
    sensors: PathBuf,
    /// Instants, as JSON (see --help)
    cases: PathBuf,
}

const FORMAT: &str = r#"SENSORS is a robot's robot.toml (its F/T sensors, IMU or stand, and first contact set), or a file of its
own, where * marks required keys; lengths in m, angles in degrees:
  [imu]                 or  [fixed_base]
  frame* = "LINK"           link* = "LINK"
  xyz_m, rpy_deg            gravity_m_per_s2 = [0, 0, -9.81]  # in that link's axes
  angular_acceleration = "given" | "neglect"
  [[ft_sensor]]
  name* = "NAME"
  frame* = "LINK"       # measures in this link's frame, displaced by xyz_m, rotated by rpy_deg
  cut = "LINK"          # the first link beyond the sensor; by default the frame's
  sign = 1              # 1: wrench of the part beyond on the part before; -1: the reverse
  sigma_N, sigma_Nm     # and sigma_m_per_s2, sigma_rad_per_s2 of [imu]; zero by default
  [[contact]]           # as in CASES, for cases without contacts
  [least_squares]
  weights = "unit" | "expected"
  residual = "stays" | "handed_on"
CASES:
  {"joints":[names], "contacts":[...],
   "cases":[{"q":[], "dq":[], "ddq":[], "gyro":[3], "accelerometer":[3], "gyro_derivative":[3],
     "ft":{"NAME":[fx,fy,fz,tx,ty,tz]},
     "contacts":[{"link":"LINK", "type":"full_wrench", "point_m":[3], "direction":[3]}]}]}
  type: full_wrench (6 unknowns), pure_force (3), known_direction (1; needs direction),
  none (no contact on that part). F/T sensors cut the robot into parts: each needs a contact.
Prints {"joints":[], "cases":[{"tau":[], "sigma":[], "contacts":[{..., "wrench":[6], "sigma":[6]}],
  "parts":[{"beyond", "first_link", "links", "unknowns", "net":[6], "residual":[6],
  "residual_sigma":[6]}]}]}, wrenches force first, on the robot, in the link's axes at the point.

Example:
  torquectl whole-body --urdf robot.urdf --sensors sensors.toml cases.json | jq '.cases[0].tau'
  torquectl whole-body --urdf robot.urdf --sensors config/leg/robot.toml cases.json

Exit codes: 0 done; 2 bad input, or contacts whose wrenches cannot be determined.
docs/whole-body-files.md describes the formats."#;

pub(crate) fn run(arguments: &WholeBodyArguments) -> ExitCode {
    finish_or_refuse(report(arguments))
}

fn report(arguments: &WholeBodyArguments) -> Result<String, Problems> {
    let urdf = read_input(&arguments.urdf)?;
    let (text, sensors_file) = sensors_text(&arguments.sensors)?;
    let sensors = SensorsFile::parse(&text, &sensors_file)?;
    let file = arguments.cases.display().to_string();
    let cases: Cases = serde_json::from_str(&read_input(&arguments.cases)?)
        .map_err(|e| Problem::new(e.to_string(), "").at(&file, 0))?;
    let urdf_file = arguments.urdf.display().to_string();
    let report = evaluate((&urdf, &urdf_file), &sensors, (&cases, &file))?;
    let json = serde_json::to_string(&report).map_err(|e| Problem::new(e.to_string(), ""))?;
    Ok(json + "\n")
}
