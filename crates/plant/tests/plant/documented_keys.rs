//! docs/simulation.md describes every key that a sim.toml may have.

use plant::SimParameters;
use test_support::read_project_file;

/// Names in backquotes of a message, e.g. of "expected one of `a`, `b`".
fn quoted(message: &str) -> impl Iterator<Item = &str> {
    message.split('`').skip(1).step_by(2)
}

/// Keys allowed beside an unknown one in this table, as the refusal names them.
fn allowed(table: &str) -> Vec<String> {
    let text = format!("substep_us = 100\n{table}\nunknown_key = 1\n");
    let refusal = SimParameters::parse(&text, "sim.toml").expect_err("an unknown key");
    let refusal = refusal.to_string();
    let (_, expected) = refusal.split_once("expected").expect("the allowed keys");
    quoted(expected).map(str::to_owned).collect()
}

#[test]
fn the_page_describes_every_key() {
    let page = read_project_file("docs/simulation.md").expect("the page");
    let described: Vec<&str> = (page.lines())
        .filter(|line| line.starts_with("| `"))
        .flat_map(|line| quoted(line.split('|').nth(1).unwrap_or_default()))
        .map(|key| key.rsplit('.').next().unwrap_or(key))
        .collect();
    let mut count = 0;
    for table in [
        "[start]",
        "[transport]",
        "[ground]",
        "[[foot]]",
        "[harness]",
        "[[power_loss]]",
        "[[push]]",
        "[ft_sensor]",
        "[imu]",
        "[imu.sampling]",
        "[drive.a.transmission]",
        "[drive.a.kinematic_error]",
        "[drive.a.friction]",
        "[drive.a.bearing]",
        "[drive.a.sensors]",
        "[drive.a.controller]",
        "[drive.a.states]",
    ] {
        for key in allowed(table) {
            assert!(described.contains(&key.as_str()), "{table}: {key}");
            count += 1;
        }
    }
    // Tables are headings; keys of the top level are rows.
    for key in allowed("") {
        let is_table = page.contains(&format!("[{key}]")) || page.contains(&format!("[{key}."));
        assert!(is_table || described.contains(&key.as_str()), "{key}");
    }
    assert!(count > 60, "{count}");
}
