//! The robots of the project, inside the program: the demo needs no file.

use std::io;

// `NAMES` and `FILES`: see build.rs.
include!(concat!(env!("OUT_DIR"), "/robots.rs"));

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

/// The configuration of one of the demo's robots: the calibrated one, where there is one.
pub(super) fn configuration(name: &str, uncalibrated: bool) -> String {
    let calibrated = format!("config/{name}/calibrated.toml");
    if !uncalibrated && read(&calibrated).is_ok() {
        calibrated
    } else {
        format!("config/{name}/robot.toml")
    }
}
