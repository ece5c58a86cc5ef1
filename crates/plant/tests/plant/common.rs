//! The robots of `config/`.

use plant::{CanRobot, SimParameters};
use problem::Problem;
use robot_config::Robot;
use test_support::read_project_file;

pub(crate) fn robot(name: &str) -> Robot {
    robot_config::load(&format!("config/{name}/robot.toml"), &read_project_file).unwrap()
}

pub(crate) fn parameters(name: &str) -> SimParameters {
    let path = format!("config/{name}/sim.toml");
    SimParameters::parse(&read_project_file(&path).unwrap(), &path).unwrap()
}

pub(crate) fn can_robot(name: &str, sim: &SimParameters) -> Result<CanRobot, Problem> {
    let robot = robot(name);
    let urdf = read_project_file(&robot.parameters.urdf_path).unwrap();
    CanRobot::new(&robot, &urdf, sim)
}
