//! The robots of the project, inside the program: the demo needs no file.

use std::io;

/// A path from the project's root with the file's text.
macro_rules! embedded {
    ($path:literal) => {
        ($path, include_str!(concat!("../../../", $path)))
    };
}

/// Every file of the demo's robots, by its path in the project.
const FILES: &[(&str, &str)] = &[
    embedded!("config/test-joint/robot.toml"),
    embedded!("config/test-joint/sim.toml"),
    embedded!("config/test-joint/motion.toml"),
    embedded!("robot-models/test-joint/robot.urdf"),
    embedded!("robot-models/test-joint/drives.dbc"),
    embedded!("config/leg/robot.toml"),
    embedded!("config/leg/sim.toml"),
    embedded!("config/leg/motion.toml"),
    embedded!("robot-models/leg/robot.urdf"),
    embedded!("robot-models/leg/drives.dbc"),
    embedded!("config/hrp2-like/robot.toml"),
    embedded!("config/hrp2-like/sim.toml"),
    embedded!("config/hrp2-like/motion.toml"),
    embedded!("robot-models/hrp2-like/robot.urdf"),
    embedded!("robot-models/hrp2-like/drives.dbc"),
    embedded!("config/lift-gripper/robot.toml"),
    embedded!("config/lift-gripper/sim.toml"),
    embedded!("config/lift-gripper/motion.toml"),
    embedded!("robot-models/lift-gripper/robot.urdf"),
    embedded!("robot-models/lift-gripper/drives.dbc"),
    embedded!("config/humanoid/robot.toml"),
    embedded!("config/humanoid/sim.toml"),
    embedded!("config/humanoid/motion.toml"),
    embedded!("robot-models/humanoid/robot.urdf"),
    embedded!("robot-models/humanoid/drives.dbc"),
];

/// Names of the demo's robots.
pub(super) const NAMES: &[&str] = &["test-joint", "leg", "hrp2-like", "lift-gripper", "humanoid"];

/// The text of a file of the demo's robots.
///
/// # Errors
/// `NotFound` for any other path.
pub(super) fn read(path: &str) -> io::Result<String> {
    // A config names its files relative to itself: `config/leg/../../robot-models/…`.
    let mut parts = Vec::new();
    for part in path.split('/') {
        if part == ".." {
            parts.pop();
        } else {
            parts.push(part);
        }
    }
    let path = parts.join("/");
    FILES
        .iter()
        .find(|(name, _)| *name == path)
        .map(|(_, text)| (*text).to_owned())
        .ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "not a file of the demo's robots"))
}
