//! Paths that a configuration names.

use std::path::{Component, Path, PathBuf};

/// `path`, as written in the configuration at `config`, seen from where `config` is seen.
pub(crate) fn resolved(config: &str, path: &str) -> String {
    let folder = Path::new(config).parent().unwrap_or(Path::new(""));
    folder.join(path).to_string_lossy().into_owned()
}

/// The path without detours, for messages: `a/b/../c` as `a/c`.
pub(crate) fn shown(path: &str) -> String {
    let mut short = PathBuf::new();
    for part in Path::new(path).components() {
        let last = short.components().next_back();
        match (part, last) {
            (Component::ParentDir, Some(Component::Normal(_))) => {
                short.pop();
            }
            _ => short.push(part),
        }
    }
    short.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::{resolved, shown};

    #[test]
    fn paths_are_relative_to_the_configuration() {
        let path = resolved("config/leg/robot.toml", "../../robot-models/leg/robot.urdf");
        assert_eq!(path, "config/leg/../../robot-models/leg/robot.urdf");
        assert_eq!(shown(&path), "robot-models/leg/robot.urdf");
        assert_eq!(resolved("robot.toml", "a.dbc"), "a.dbc");
        assert_eq!(resolved("x/robot.toml", "/etc/a.dbc"), "/etc/a.dbc");
        assert_eq!(shown("../../a/./b"), "../../a/b");
    }
}
