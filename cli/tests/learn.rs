//! `torquectl learn` as a whole process, on a recording that the daemon's loop made of a simulated joint with
//! a payload that its model does not have.

use crate::common;

use common::{expect, record_demo};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use test_support::project_path;

/// The test joint in a folder of its own, its simulated link with half as much again at its end.
fn robot() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("learn");
    let _ = fs::remove_dir_all(&folder);
    for part in ["config/test-joint", "robot-models/test-joint"] {
        fs::create_dir_all(folder.join(part)).unwrap();
    }
    let copied = |file: &str, change: &dyn Fn(String) -> String| {
        let text = fs::read_to_string(project_path(file)).unwrap();
        fs::write(folder.join(file), change(text)).unwrap();
    };
    for file in ["drives.dbc", "robot.urdf"] {
        copied(&format!("robot-models/test-joint/{file}"), &|text| text);
    }
    copied("config/test-joint/robot.toml", &|text| text);
    copied("config/test-joint/sim.toml", &|text| {
        text.replace("../../robot-models/test-joint/robot.urdf", "heavy.urdf")
    });
    let urdf = fs::read_to_string(project_path("robot-models/test-joint/robot.urdf")).unwrap();
    let (light, heavy) = ("<mass value=\"1.841\"/>", "<mass value=\"2.761\"/>");
    assert!(urdf.contains(light));
    let path = folder.join("config/test-joint/heavy.urdf");
    fs::write(path, urdf.replace(light, heavy)).unwrap();
    let motion =
        "settle_s = 0.5\njoint = [{ name = \"joint\", amplitude_deg = 70, period_s = 5.0 }]\n";
    fs::write(folder.join("motion.toml"), motion).unwrap();
    let robot = folder.join("config/test-joint/robot.toml");
    record_demo(&folder, robot.display().to_string(), 14.0, 3);
    folder
}

#[test]
fn a_payload_is_learned_from_a_recording_and_the_file_is_taken() {
    let folder = robot();
    let json = expect(
        &folder,
        "learn run.mcap -o learned --plot learned.svg --json",
        0,
    );
    let found: Value = serde_json::from_str(&json).unwrap();
    let joint = &found["joints"][0];
    let error = |key: &str| joint[key].as_f64().unwrap();
    let (before, after) = (error("model_off_rms_Nm"), error("left_rms_Nm"));
    // 0.92 kg at 0.45 m, swung: some newton metres, of which nearly all goes.
    assert!(before > 1.0 && after < 0.2 * before, "{json}");
    let picture = fs::read_to_string(folder.join("learned.svg")).unwrap();
    assert!(picture.contains("missing in the model") && picture.len() < 500_000);
    let file = joint["file"].as_str().unwrap();
    assert_eq!(file, "learned/joint.feed-forward.toml");
    assert!(fs::metadata(folder.join(file)).unwrap().len() < 200_000);

    let config = folder.join("config/test-joint/robot.toml");
    let text = fs::read_to_string(&config).unwrap();
    let key = "feed_forward = \"../../learned/joint.feed-forward.toml\"";
    let limit = "torque_limit_Nm = 37.0";
    fs::write(&config, text.replace(limit, &format!("{limit}\n{key}"))).unwrap();
    expect(&folder, "check config/test-joint/robot.toml", 0);

    let refused = expect(&folder, "learn run.mcap -o learned --joint elbow", 2);
    assert!(
        refused.contains("no such joint") && refused.contains("joint"),
        "{refused}"
    );
    let refused = expect(&folder, "learn motion.toml -o learned", 2);
    assert!(refused.contains("motion.toml"), "{refused}");
}
