//! `torquectl blackbox` of recorded runs that are none.

use crate::common;

use common::{expect, record_demo};
use serde_json::Value;
use std::fs;
use test_support::{TemporaryDirectory, project_path};

#[test]
fn an_ordinary_recording_has_no_fault() {
    let directory = TemporaryDirectory::new();
    let folder = directory.path();
    fs::create_dir_all(folder).unwrap();
    let motion =
        "settle_s = 0.2\njoint = [{ name = \"joint\", amplitude_deg = 20, period_s = 2 }]\n";
    fs::write(folder.join("motion.toml"), motion).unwrap();
    let robot = project_path("config/test-joint/robot.toml");
    record_demo(folder, robot, 1.5, 1);
    let shown = expect(folder, "blackbox run.mcap", 0);
    assert!(shown.contains("no fault in this recording"), "{shown}");
    let wrong = ["FAULT", "loop_ended", "defect"];
    assert!(wrong.iter().all(|word| !shown.contains(word)), "{shown}");
    let json: Value = serde_json::from_str(&expect(folder, "blackbox run.mcap --json", 0)).unwrap();
    assert!(json["fault"].is_null(), "{json}");
    assert_eq!(json["from_ms"], 0.0);
}
