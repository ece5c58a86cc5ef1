//! Files of the project: robots, configurations.

use std::io::Result;

/// Path of a project file that is given relative to the project's root.
#[must_use]
pub fn project_path(file: &str) -> String {
    format!("{}/../../{file}", env!("CARGO_MANIFEST_DIR"))
}

/// Text of a project file that is given relative to the project's root: `config/leg/robot.toml`.
///
/// # Errors
/// No such file.
#[expect(clippy::disallowed_methods, reason = "for tests")]
pub fn read_project_file(file: &str) -> Result<String> {
    std::fs::read_to_string(project_path(file))
}

/// The motion by which torques of a shipped robot are judged: that of its demo, but of a humanoid, whose demo balances,
/// one whose loads do not depend on it.
#[must_use]
pub fn judged_motion(robot: &str) -> String {
    let file = if robot == "humanoid" { "bow" } else { "motion" };
    format!("config/{robot}/{file}.toml")
}

/// Text of a project file, with drives that take no control words: they are always on.
///
/// # Errors
/// No such file.
pub fn read_with_drives_always_on(file: &str) -> Result<String> {
    let text = read_project_file(file)?;
    let lines = text.split_inclusive('\n');
    Ok(if file.ends_with("robot.toml") {
        lines.filter(|l| !l.starts_with("control = {")).collect()
    } else {
        text
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn reads_a_robot_and_what_it_names() {
        let read = |file| super::read_project_file(file).unwrap_or_default();
        assert!(read("config/leg/robot.toml").contains("robot.urdf"));
        assert!(read("config/leg/../../robot-models/leg/robot.urdf").contains("<robot"));
    }
}
