//! Shared by the daemon's tests: run directories, robots and their simulation.
#![allow(dead_code, reason = "each test binary uses a part")]

pub(crate) mod eventful;
pub(crate) mod recorded;

use plant::{CanRobot, SimParameters};
use robot_config::Robot;
use test_support::{TemporaryDirectory, read_project_file};
use torqued_client::Location;

/// A run directory of one test, with room for a state directory.
pub(crate) struct RunDir {
    pub(crate) location: Location,
    pub(crate) directory: TemporaryDirectory,
}

impl RunDir {
    pub(crate) fn new() -> Self {
        let directory = TemporaryDirectory::new();
        let location = Location::at(directory.path()).expect("a run directory");
        let prefix = location.shared_memory_prefix();
        Self {
            location,
            directory: directory.with_shared_memory(prefix),
        }
    }
}

/// A robot of the project.
pub(crate) fn robot(name: &str) -> Robot {
    let config = format!("config/{name}/robot.toml");
    robot_config::load(&config, &read_project_file).expect("a robot")
}

/// The leg with these contact sets.
pub(crate) fn leg_with_contacts(contacts: &str) -> Robot {
    let read = |path: &str| {
        let text = read_project_file(path)?;
        let line = "unknown_wrench_link = \"base_link\"\n";
        Ok(if path.ends_with("robot.toml") {
            format!("{}{contacts}", text.replace(line, ""))
        } else {
            text
        })
    };
    robot_config::load("config/leg/robot.toml", &read).expect("the leg")
}

/// The simulation's parameters for a robot of the project.
pub(crate) fn sim(name: &str) -> SimParameters {
    let path = format!("config/{name}/sim.toml");
    let text = read_project_file(&path).expect("readable");
    SimParameters::parse(&text, &path).expect("parameters")
}

/// The simulated robot.
pub(crate) fn plant(robot: &Robot, sim: &SimParameters) -> CanRobot {
    let urdf = read_project_file(&robot.parameters.urdf_path).expect("readable");
    CanRobot::new(robot, &urdf, sim).expect("a plant")
}
