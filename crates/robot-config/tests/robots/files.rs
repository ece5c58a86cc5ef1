//! Files held in memory: the repository's robots, and changes to them.

use robot_config::{Problems, Robot};
use std::collections::BTreeMap;
use std::io;

macro_rules! repository {
    ($($path:literal),* $(,)?) => {
        &[$(($path, include_str!(concat!("../../../../", $path)))),*]
    };
}

const FILES: &[(&str, &str)] = repository![
    "config/test-joint/robot.toml",
    "config/leg/robot.toml",
    "config/hrp2-like/robot.toml",
    "config/lift-gripper/robot.toml",
    "config/humanoid/robot.toml",
    "robot-models/test-joint/robot.urdf",
    "robot-models/leg/robot.urdf",
    "robot-models/hrp2-like/robot.urdf",
    "robot-models/lift-gripper/robot.urdf",
    "robot-models/humanoid/robot.urdf",
    "robot-models/test-joint/drives.dbc",
    "robot-models/leg/drives.dbc",
    "robot-models/hrp2-like/drives.dbc",
    "robot-models/lift-gripper/drives.dbc",
    "robot-models/humanoid/drives.dbc",
];

/// The repository's files, by the path that the configurations lead to.
pub(crate) struct Files(BTreeMap<String, String>);

impl Files {
    /// As they are.
    pub(crate) fn new() -> Self {
        let owned = FILES
            .iter()
            .map(|(path, text)| ((*path).to_owned(), (*text).to_owned()));
        Self(owned.collect())
    }

    /// With one text replaced wherever it stands; it must stand somewhere.
    pub(crate) fn with(mut self, path: &str, from: &str, to: &str) -> Self {
        let text = self.0.get_mut(path).expect("a file of the repository");
        assert!(text.contains(from), "{path} lacks {from:?}");
        *text = text.replace(from, to);
        self
    }

    /// With one more file.
    pub(crate) fn and(mut self, path: &str, text: &str) -> Self {
        self.0.insert(path.to_owned(), text.to_owned());
        self
    }

    /// A file's text.
    pub(crate) fn text(&self, path: &str) -> &str {
        &self.0[path]
    }

    /// The line, from 1, of the first occurrence of a text in a file.
    pub(crate) fn line(&self, path: &str, text: &str) -> usize {
        let place = self.0[path].find(text).expect("the text");
        1 + self.0[path][..place].matches('\n').count()
    }

    pub(crate) fn load(&self, path: &str) -> Result<Robot, Problems> {
        robot_config::load(path, &|path| {
            let mut parts: Vec<&str> = Vec::new();
            for part in path.split('/') {
                match part {
                    ".." => {
                        parts.pop();
                    }
                    part => parts.push(part),
                }
            }
            let missing = || io::Error::from(io::ErrorKind::NotFound);
            self.0.get(&parts.join("/")).cloned().ok_or_else(missing)
        })
    }

    /// The errors' text.
    pub(crate) fn errors(&self, path: &str) -> String {
        match self.load(path) {
            Ok(_) => panic!("{path} was accepted"),
            Err(error) => error.to_string(),
        }
    }
}

pub(crate) const LEG: &str = "config/leg/robot.toml";
pub(crate) const HRP2_LIKE: &str = "config/hrp2-like/robot.toml";
pub(crate) const LIFT_GRIPPER: &str = "config/lift-gripper/robot.toml";
pub(crate) const HUMANOID: &str = "config/humanoid/robot.toml";

/// The only problem is on the line of `at` in the file at `path`, and its text has all `parts`.
#[track_caller]
pub(crate) fn refused(files: &Files, path: &str, at: &str, parts: &[&str]) {
    let text = files.errors(path);
    assert_eq!(text.lines().count(), 1, "{text}");
    let place = format!("{path}:{}: ", files.line(path, at));
    assert!(text.starts_with(&place), "{place} does not begin\n{text}");
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
}

pub(crate) fn leg_with(from: &str, to: &str) -> Files {
    Files::new().with(LEG, from, to)
}
