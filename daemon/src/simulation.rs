//! A simulated robot from files: for `torqued-sim`, and for `torqued run --simulate`.

use std::path::{Path, PathBuf};

use plant::{CanRobot, SimParameters};
use robot_config::Robot;

use crate::failure::Failure;

/// The file with the simulated robot's parameters, where none is named: beside the configuration.
#[must_use]
pub fn default_file(config: &Path) -> PathBuf {
    config.with_file_name("sim.toml")
}

/// Reads the parameters of the simulated robot.
///
/// # Errors
/// A file that cannot be read, or that contains a mistake.
pub fn parameters(file: &Path, seed: Option<u64>) -> Result<SimParameters, Failure> {
    let parsed = SimParameters::parse(&text(file)?, &file.to_string_lossy());
    let mut sim = parsed.map_err(Failure::bad_input)?;
    sim.seed = seed.unwrap_or(sim.seed);
    Ok(sim)
}

/// The simulated robot; `file`: that of its parameters, for messages.
///
/// # Errors
/// Parameters that do not fit the robot.
pub fn robot(robot: &Robot, sim: &SimParameters, file: &Path) -> Result<CanRobot, Failure> {
    let urdf = text(Path::new(sim.urdf_or(&robot.parameters.urdf_path)))?;
    CanRobot::new(robot, &urdf, sim)
        .map_err(|problem| Failure::bad_input(problem.or_at(&file.to_string_lossy(), 0)))
}

fn text(path: &Path) -> Result<String, Failure> {
    terminal::read_text(path).map_err(|error| {
        let path = path.display();
        Failure::bad_input(format!(
            "{path}: cannot be read: {error}; allowed: a readable text file"
        ))
    })
}
