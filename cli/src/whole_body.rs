//! `torquectl whole-body`: torques and contact wrenches of given instants, to check sensors and
//! estimator against another library.

use crate::BAD_INPUT;
use crate::output::finish;
use ::whole_body::cases::{Cases, SensorsFile, evaluate};
use clap::Args;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Print joint torques and contact wrenches that F/T sensors and IMU tell, as JSON
#[derive(Args)]
#[command(after_long_help = FORMAT)]
pub(crate) struct WholeBodyArguments {
    /// The robot
    #[arg(long)]
    urdf: PathBuf,
    /// Its sensors, as TOML (see --help)
    #[arg(long)]
    sensors: PathBuf,
    /// Instants, as JSON (see --help)
    cases: PathBuf,
}

const FORMAT: &str = r#"SENSORS, where * marks what is required; lengths in m, angles in degrees:
  [imu]                 or  [fixed_base]
  frame* = "LINK"           link* = "LINK"
  xyz_m, rpy_deg            gravity_m_per_s2 = [0, 0, -9.81]  # in that link's axes
  angular_acceleration = "given" | "neglect"
  [[ft_sensor]]
  name* = "NAME"
  frame* = "LINK"       # measures in this link's frame, moved by xyz_m, turned by rpy_deg
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
  none (nothing touches that part). F/T sensors cut the robot into parts: each needs a contact.
Prints {"joints":[], "cases":[{"tau":[], "sigma":[], "contacts":[{..., "wrench":[6], "sigma":[6]}],
  "parts":[{"beyond", "first_link", "links", "unknowns", "net":[6], "residual":[6],
  "residual_sigma":[6]}]}]}, wrenches force first, on the robot, in the link's axes at the point.

Example:
  torquectl whole-body --urdf robot.urdf --sensors sensors.toml cases.json | jq '.cases[0].tau'

Exit codes: 0 done; 2 bad input, or contacts from which the wrenches do not follow.
docs/whole-body.md tells all of this at length."#;

pub(crate) fn run(arguments: &WholeBodyArguments) -> ExitCode {
    match report(arguments) {
        Ok(json) => finish(&format!("{json}\n")),
        Err(message) => {
            eprintln!("torquectl whole-body: {message}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn report(arguments: &WholeBodyArguments) -> Result<String, String> {
    let urdf = read(&arguments.urdf)?;
    let sensors_file = arguments.sensors.display().to_string();
    let sensors = SensorsFile::parse(&read(&arguments.sensors)?, &sensors_file)?;
    let file = arguments.cases.display();
    let text = read(&arguments.cases)?;
    let cases: Cases = serde_json::from_str(&text).map_err(|e| format!("{file}: {e}"))?;
    let urdf_file = arguments.urdf.display().to_string();
    let report = evaluate(&urdf, &urdf_file, &sensors, &cases).map_err(|e| match e {
        // The URDF's messages name their file themselves.
        e if e.starts_with(&urdf_file) => e,
        e => format!("{file}: {e}"),
    })?;
    serde_json::to_string(&report).map_err(|e| e.to_string())
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}
