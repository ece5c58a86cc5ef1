//! The robots of `config/`.

use plant::{CanRobot, SimParameters};
use robot_config::Robot;

fn path(name: &str, file: &str) -> String {
    format!("{}/../../config/{name}/{file}", env!("CARGO_MANIFEST_DIR"))
}

pub(crate) fn robot(name: &str) -> Robot {
    let read = |path: &str| std::fs::read_to_string(path);
    robot_config::load(&path(name, "robot.toml"), &read).unwrap()
}

pub(crate) fn parameters(name: &str) -> SimParameters {
    let path = path(name, "sim.toml");
    SimParameters::parse(&std::fs::read_to_string(&path).unwrap(), &path).unwrap()
}

pub(crate) fn can_robot(name: &str, sim: &SimParameters) -> Result<CanRobot, String> {
    let robot = robot(name);
    let urdf = std::fs::read_to_string(&robot.parameters.urdf_path).unwrap();
    CanRobot::new(&robot, &urdf, sim)
}
