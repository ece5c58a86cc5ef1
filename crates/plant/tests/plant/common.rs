//! The robots of `config/`.

use plant::{CanRobot, SimParameters};
use problem::Problem;
use robot_config::{Robot, slots};
use test_support::{read_project_file, read_with_drives_always_on};

/// The robot with drives that are always on.
pub(crate) fn robot(name: &str) -> Robot {
    let path = format!("config/{name}/robot.toml");
    robot_config::load(&path, &read_with_drives_always_on).unwrap()
}

/// The values that the send table takes, with these set-points.
pub(crate) fn send_slots(set_points: &[f64]) -> Vec<f64> {
    let mut values = vec![f64::NAN; slots::command(set_points.len())];
    for (joint, set_point) in set_points.iter().enumerate() {
        values[slots::command(joint)] = *set_point;
    }
    values
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
