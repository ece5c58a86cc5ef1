//! The calibrations that the shipped robots come with (`config/calibrate.sh`): each is its robot's, changes nothing else
//! of it, and makes its torques better.

use crate::common;

use common::expect;
use std::fs;
use std::path::{Path, PathBuf};
use test_support::project_path;

const ROBOTS: [&str; 5] = ["test-joint", "leg", "hrp2-like", "lift-gripper", "humanoid"];

/// A copy of a folder.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().flatten() {
        let (path, copied) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &copied)
        } else {
            fs::copy(&path, &copied).map(|_| ()).unwrap()
        }
    }
}

/// Configuration and models of a shipped robot, in a folder of the test's own.
fn robot(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("shipped")
        .join(name);
    let _ = fs::remove_dir_all(&folder);
    for part in [format!("config/{name}"), format!("robot-models/{name}")] {
        copy(Path::new(&project_path(&part)), &folder.join(part));
    }
    folder
}

#[test]
fn a_shipped_calibration_is_of_its_robot_and_taken_back_leaves_its_configuration() {
    for name in ROBOTS {
        let folder = robot(name);
        let config = format!("config/{name}/calibrated.toml");
        let status = expect(
            &folder,
            &format!("calibrate status {config} --days 36500"),
            0,
        );
        assert!(status.contains(" calibrated "), "{name}\n{status}");
        let problems = expect(&folder, &format!("check {config}"), 0);
        assert!(problems.contains(name), "{problems}");
        let stands = ["centre of mass", "base's angle", "more delay"];
        let stands = stands.map(|part| problems.contains(part));
        assert_eq!(stands, [name == "humanoid"; 3], "{problems}");
        expect(&folder, &format!("calibrate rollback {config}"), 0);
        let text =
            |file: &str| fs::read_to_string(folder.join("config").join(name).join(file)).unwrap();
        assert!(
            text("calibrated.toml") == text("robot.toml"),
            "{name}: run config/calibrate.sh {name}"
        );
    }
}
