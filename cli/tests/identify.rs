//! `torquectl identify drive` as a whole process, on a recording that the daemon's loop made of the
//! simulated test joint.

use crate::common;

use common::{expect, record_demo};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use test_support::project_path;

/// A slow swing with sines up to 22 Hz.
const MOTION: &str = "settle_s = 0.5\njoint = [\n\
    { name = \"joint\", amplitude_deg = 8, period_s = 2.7 },\n\
    { name = \"joint\", amplitude_deg = 2, period_s = 0.41 },\n\
    { name = \"joint\", amplitude_deg = 0.5, period_s = 0.153 },\n\
    { name = \"joint\", amplitude_deg = 0.2, period_s = 0.083 },\n\
    { name = \"joint\", amplitude_deg = 0.1, period_s = 0.0453 },\n]\n";

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("identify");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

fn record(folder: &Path) {
    fs::write(folder.join("motion.toml"), MOTION).unwrap();
    record_demo(
        folder,
        project_path("config/test-joint/robot.toml"),
        13.0,
        8,
    );
}

#[test]
fn a_drive_is_identified_from_the_daemons_recording() {
    let folder = folder();
    record(&folder);
    let json = expect(
        &folder,
        "identify drive run.mcap --joint joint --model asymmetric --json -o joint.toml --report joint.html",
        0,
    );
    let found: Value = serde_json::from_str(&json).unwrap();
    let parameters = found["parameters"].as_array().unwrap();
    let near = |name: &str, truth: f64, share: f64| {
        let row = parameters
            .iter()
            .find(|p| p["name"].as_str().unwrap().starts_with(name));
        let value = row.unwrap()["value"].as_f64().unwrap();
        assert!(
            (value / truth - 1.0).abs() < share,
            "{name} {value}, true: {truth}\n{json}"
        );
    };
    near("stiffness", 8350.0, 0.15);
    near("damping", 58.0, 0.15);
    near("dead zone", 57.6, 0.2);
    near("rotor inertia", 11.4, 0.15);
    near("delay", 1.2, 0.2 / 1.2);
    let [newton, program] = ["newton", "quadratic_program"].map(|way| {
        found["motor"][way]["constants"][0]["value"]
            .as_f64()
            .unwrap()
    });
    assert!((newton / program - 1.0).abs() < 0.2, "{newton} {program}");
    let keys = fs::read_to_string(folder.join("joint.toml")).unwrap();
    let keys: toml::Table = keys.parse().unwrap();
    assert!(
        keys["drive"]["joint"]["motor"]["K_tau_rad_per_Nm"]
            .as_float()
            .unwrap()
            > 0.0,
        "{keys}"
    );
    let html = fs::read_to_string(folder.join("joint.html")).unwrap();
    assert!(html.matches("<svg").count() == 1 && html.ends_with("</body></html>\n"));
    for model in ["least-squares", "piecewise", "two-stage"] {
        let text = expect(
            &folder,
            &format!("identify drive run.mcap --joint joint --model {model}"),
            0,
        );
        assert!(
            text.contains("95 % interval") && text.contains("K_tau"),
            "{text}"
        );
    }
    let refused = expect(&folder, "identify drive run.mcap --joint knee", 2);
    assert!(
        refused.contains("no joint \"knee\"; allowed: joint"),
        "{refused}"
    );
    let none = expect(&folder, "identify drive motion.toml --joint joint", 2);
    assert!(none.contains("motion.toml"), "{none}");
}

/// `--config` plans a motion within every limit, of that joint alone, wherever the joint stands.
#[test]
fn the_motion_of_a_joint_is_planned() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let config = project_path("config/leg/robot.toml");
    for (joint, from) in [("knee", 0.0), ("knee", 130.0), ("ankle_roll", -18.0)] {
        let arguments = format!(
            "identify drive --joint {joint} --config {config} --dry-run --json --from {joint}={from}"
        );
        let plan: Value = serde_json::from_str(&expect(folder, &arguments, 0)).unwrap();
        let moving = |row: &&Value| row["velocity_share"].as_f64().unwrap() > 0.0;
        let moving: Vec<&Value> = plan["joints"]
            .as_array()
            .unwrap()
            .iter()
            .filter(moving)
            .collect();
        assert_eq!(moving.len(), 1, "{plan}");
        assert_eq!(moving[0]["joint"], joint);
        let number = |key: &str| moving[0][key].as_f64().unwrap();
        // Of the swing's 0.06 rad: it grows, and is faded out before it is largest.
        let way = 0.5 * (number("most_rad") - number("least_rad"));
        assert!((0.03..0.06).contains(&way), "{plan}");
        assert!(
            number("velocity_share") < 0.25 && number("torque_share") < 0.9,
            "{plan}"
        );
        assert!(plan["duration_s"].as_f64().unwrap() > 12.0);
    }
    let refused = |arguments: &str| {
        let arguments = format!("identify drive {arguments} --config {config} --dry-run");
        expect(folder, &arguments, 2)
    };
    let unknown = refused("--joint kne");
    assert!(
        unknown.contains("no joint \"kne\"; allowed: ") && unknown.contains("knee"),
        "{unknown}"
    );
    let beyond = refused("--joint knee --pose knee=170");
    assert!(
        beyond.contains("knee") && beyond.contains("allowed: 0.5 to 149.5 deg"),
        "{beyond}"
    );
    let nothing = expect(folder, "identify drive --joint knee", 2);
    assert!(nothing.contains("RUN.mcap"), "{nothing}");
}

/// A screw: its stiffness in N/m, its keys in m and N.
#[test]
fn a_prismatic_drive_is_identified_in_its_units() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("identify-prismatic");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    let motion = MOTION
        .replace("\"joint\"", "\"lift\"")
        .replace("_deg", "_mm");
    fs::write(folder.join("motion.toml"), motion).unwrap();
    let robot = project_path("config/lift-gripper/robot.toml");
    record_demo(&folder, robot, 13.0, 8);
    let json = expect(
        &folder,
        "identify drive run.mcap --joint lift --json -o lift.toml --report lift.html",
        0,
    );
    let found: Value = serde_json::from_str(&json).unwrap();
    let parameters = found["parameters"].as_array().unwrap();
    let row = |name: &str| {
        let row = parameters.iter().find(|p| p["name"] == name).unwrap();
        (
            row["value"].as_f64().unwrap(),
            row["unit"].as_str().unwrap(),
        )
    };
    // Of config/lift-gripper/sim.toml: the controller's gain as a stiffness, its dead zone, the rotor.
    for (name, truth, unit) in [
        ("stiffness k_d", 1.4997e6, "N/m"),
        ("damping d_d", 12_938.0, "N·s/m"),
        ("dead zone", 6.0, "um"),
        ("rotor inertia, motor side", 20.0, "kg·mm²"),
    ] {
        let (value, own) = row(name);
        assert_eq!(own, unit);
        let share = value / truth - 1.0;
        assert!(share.abs() < 0.2, "{name} {value}, true: {truth}\n{json}");
    }
    let keys = fs::read_to_string(folder.join("lift.toml")).unwrap();
    assert!(keys.contains("K_tau_m_per_N = 0.0000013"), "{keys}");
    assert!(keys.contains("dead_zone_m = "), "{keys}");
    assert!(!keys.contains("_rad_per_Nm"), "{keys}");
    let page = fs::read_to_string(folder.join("lift.html")).unwrap();
    assert!(page.contains("position of the joint, mm"));
}
