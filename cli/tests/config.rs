//! `torquectl config show`: what the daemon understands, and where it comes from.

use serde_json::Value;
use std::process::Command;
use test_support::project_path;

fn settings(config: &str) -> Vec<Value> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_torquectl"));
    let output = command
        .args(["config", "show", "--json", config])
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let page: Value = serde_json::from_slice(&output.stdout).unwrap();
    page["settings"].as_array().unwrap().clone()
}

fn of<'a>(settings: &'a [Value], key: &str) -> &'a Value {
    let found = settings.iter().find(|setting| setting["key"] == key);
    found.unwrap_or_else(|| panic!("no key {key}"))
}

#[test]
fn values_of_the_file_have_its_lines_and_others_are_defaults() {
    let config = project_path("config/leg/robot.toml");
    let text = std::fs::read_to_string(&config).unwrap();
    let settings = settings(&config);
    let rate = of(&settings, "loop.rate_hz");
    assert_eq!(rate["value"], "1000.0");
    let line = rate["line"].as_u64().unwrap() as usize;
    assert!(
        text.lines().nth(line - 1).unwrap().starts_with("rate_hz"),
        "line {line}"
    );
    let limit = of(&settings, "safety.time_limit_ms");
    assert_eq!(
        (limit["value"].as_str(), limit["source"].as_str()),
        (Some("2000.0"), Some("default"))
    );
}

/// Every key that the file has is shown, with a line that has it.
#[test]
fn no_key_of_a_shipped_configuration_is_left_out() {
    for robot in ["leg", "humanoid", "hrp2-like", "lift-gripper", "test-joint"] {
        let config = project_path(&format!("config/{robot}/robot.toml"));
        let text = std::fs::read_to_string(&config).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        let settings = settings(&config);
        let shown: Vec<&str> = settings
            .iter()
            .filter_map(|setting| setting["key"].as_str())
            .collect();
        assert!(shown.len() > 60, "{robot}: {}", shown.len());
        for setting in &settings {
            let Some(line) = setting["line"].as_u64() else {
                continue;
            };
            let key = setting["key"].as_str().unwrap();
            let name = key.split(" (").next().unwrap().rsplit('.').next().unwrap();
            // A value of several lines begins where its key stands.
            assert!(
                lines[line as usize - 1].contains(name),
                "{robot}: {key} at line {line}"
            );
        }
        let plain = lines.iter().filter_map(|line| {
            let (key, value) = line.split_once(" = ")?;
            (!value.starts_with('{') && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_'))
                .then_some(key)
        });
        for key in plain {
            let has =
                |path: &&str| path.split(" (").next().unwrap().rsplit('.').next() == Some(key);
            assert!(shown.iter().any(has), "{robot}: {key} is not shown");
        }
    }
}
