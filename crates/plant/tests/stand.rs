//! The humanoid on its feet and the leg in its stand, under their drives' own control.

use plant::{CanRobot, SimParameters, SimRobot, Truth};

fn can_robot(name: &str, sim: &SimParameters) -> CanRobot {
    let read = |path: &str| std::fs::read_to_string(path);
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    let robot = robot_config::load(&format!("{root}/config/{name}/robot.toml"), &read).unwrap();
    let urdf = read(&robot.parameters.urdf_path).unwrap();
    CanRobot::new(&robot, &urdf, sim).unwrap()
}

fn parameters(name: &str) -> SimParameters {
    let path = format!("{}/../../config/{name}/sim.toml", env!("CARGO_MANIFEST_DIR"));
    SimParameters::parse(&std::fs::read_to_string(&path).unwrap(), &path).unwrap()
}

fn run(robot: &mut SimRobot, seconds: f64) -> &Truth {
    for _ in 0..(seconds * 1000.0) as usize {
        robot.advance();
    }
    robot.truth()
}

#[test]
fn the_humanoid_stands_still_for_seconds() {
    let mut robot = can_robot("humanoid", &parameters("humanoid")).robot().clone();
    let start = robot.truth().clone();
    let end = run(&mut robot, 3.0);
    let tilt = 2.0 * f64::hypot(end.base_orientation[0], end.base_orientation[1]);
    let sunk = start.base_position[2] - end.base_position[2];
    assert!(tilt < 0.01, "tilted by {tilt} rad");
    assert!(sunk.abs() < 0.005, "sunk by {sunk} m");
    let fastest = end.joints.iter().fold(0.0_f64, |m, j| m.max(j.dq.abs()));
    assert!(fastest < 1e-3, "still moving at {fastest} rad/s");
}
