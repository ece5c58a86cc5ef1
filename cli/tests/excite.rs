//! `torquectl excite --dry-run` as a whole process: plans that a robot may follow, and those that it
//! must not, before anything moves.

use std::path::Path;
use std::process::{Command, Output};
use test_support::{TemporaryDirectory, project_path};

fn excite(plan: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_torquectl"));
    command.arg("excite").arg(plan).arg("--dry-run").args(more);
    command.output().expect("torquectl runs")
}

/// Runs a plan for the robot of the project.
fn planned(robot: &str, plan: &str, more: &[&str]) -> Output {
    let directory = TemporaryDirectory::new();
    std::fs::create_dir_all(directory.path()).expect("made");
    let path = directory.path().join("plan.toml");
    let config = project_path(&format!("config/{robot}/robot.toml"));
    std::fs::write(&path, format!("config = {config:?}\n{plan}")).expect("written");
    excite(&path, more)
}

fn refused(robot: &str, plan: &str, more: &[&str], messages: &[&[&str]]) {
    let out = planned(robot, plan, more);
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{error}");
    assert!(out.stdout.is_empty());
    for parts in messages {
        let holds = |line: &str| parts.iter().all(|part| line.contains(part));
        assert!(
            error.lines().any(holds),
            "{parts:?} are not in a line of\n{error}"
        );
    }
}

fn json(out: &Output) -> serde_json::Value {
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(0), "{error}");
    serde_json::from_slice(&out.stdout).expect("JSON")
}

const CHIRP: &str = "[[part]]\nkind = \"chirp\"\njoints = [\"knee\"]\namplitude_deg = 4\nfrom_hz = 0.3\nto_hz = 8\nduration_s = 10\n";

#[test]
fn plans_that_the_robot_must_not_follow_are_refused() {
    let sweep = "[[part]]\nkind = \"sweep\"\njoints = [\"knee\"]\nspeed_deg_per_s = 40\n";
    let far = format!("{sweep}from_deg = 0\nto_deg = 170\n");
    refused("leg", &far, &[], &[&["\"knee\"", "170", "deg"]]);
    let fast = CHIRP.replace(
        "amplitude_deg = 4",
        "amplitude_deg = 60\nconstant = \"position\"",
    );
    let pose = "pose = { knee = 60 }\n";
    refused(
        "leg",
        &format!("{pose}{fast}"),
        &[],
        &[&["\"knee\"", "velocity"], &["\"knee\"", "acceleration"]],
    );
    // Every mistake at once, with its line.
    let wrong = "[[part]]\nkind = \"chirp\"\njoints = [\"kne\"]\namplitude_deg = -4\nfrom_hz = 0.3\nspeed_deg_per_s = 3\nto_hz = 8\n";
    let messages: [&[&str]; 4] = [
        &["plan.toml:2", "no duration_s"],
        &["amplitude_deg = -4", "0.001"],
        &["speed_deg_per_s is not of a part of this kind"],
        &["no joint \"kne\"", "knee"],
    ];
    refused("leg", wrong, &[], &messages);
    refused(
        "leg",
        "[[part]]\nkind = \"dance\"\n",
        &[],
        &[&["plan.toml:3", "dance"]],
    );
    refused("leg", "", &[], &[&["no parts"]]);
    // Loads that the robot cannot carry: the arm far out with its own weight is fine, with a fast swing not.
    let joint = "[[part]]\nkind = \"growing_sine\"\njoints = [\"joint\"]\namplitude_deg = 60\nfrequency_hz = 1.2\nduration_s = 10\n";
    refused(
        "test-joint",
        joint,
        &["--no-self-distance"],
        &[&["\"joint\"", "torque"]],
    );
}

/// Both arms swing inwards until the hands meet.
#[test]
fn a_plan_in_which_the_robot_meets_itself_is_refused() {
    let hands = "pose = { left_elbow = -90, right_elbow = -90 }\n\
        [[part]]\nkind = \"poses\"\nhold_s = 1\n\
        poses = [{ left_shoulder_yaw = -60, right_shoulder_yaw = 60 }]\n";
    refused("humanoid", hands, &[], &[&["come within", "left", "right"]]);
    let out = planned("humanoid", hands, &["--no-self-distance"]);
    let text = String::from_utf8_lossy(&out.stdout);
    assert!(text.contains("self-distance: NOT checked"), "{text}");
    let apart = hands.replace("-60", "10").replace("60", "-10");
    let found = json(&planned("humanoid", &apart, &["--json"]));
    assert!(
        found["self_distance"]["least_m"].as_f64().is_some(),
        "{found}"
    );
}

#[test]
fn a_plan_is_drawn_and_its_needs_are_shown() {
    let directory = TemporaryDirectory::new();
    std::fs::create_dir_all(directory.path()).expect("made");
    let plot = directory.path().join("plan.svg");
    let plot_argument = plot.to_str().expect("UTF-8");
    let arguments = ["--json", "--plot", plot_argument, "--from", "knee=30"];
    let found = json(&planned("leg", CHIRP, &arguments));
    let knee = &found["joints"][3];
    assert_eq!(knee["joint"], "knee");
    let number = |key: &str| knee[key].as_f64().expect("a number");
    let degrees = |key: &str| number(key).to_degrees();
    let way = (30.0 - degrees("least_rad")).max(degrees("most_rad") - 30.0);
    assert!((3.6..4.6).contains(&way), "{knee}");
    // 4 degrees at 0.3 Hz, with the same velocity all the way up.
    let limit = 4.0f64;
    let velocity = number("velocity_share") * limit;
    let wanted = 4f64.to_radians() * std::f64::consts::TAU * 0.3;
    assert!(
        (velocity / wanted - 1.0).abs() < 0.15,
        "{velocity} {wanted}"
    );
    assert!(
        std::fs::read_to_string(plot)
            .expect("a picture")
            .contains("<svg")
    );
}

/// Screws move by mm, and are refused in mm and N.
#[test]
fn prismatic_joints_are_planned_in_their_units() {
    let directory = TemporaryDirectory::new();
    std::fs::create_dir_all(directory.path()).expect("made");
    let plot = directory.path().join("plan.svg");
    let plan = project_path("config/lift-gripper/excite.toml");
    let arguments = ["--json", "--plot", plot.to_str().expect("UTF-8")];
    let found = json(&excite(Path::new(&plan), &arguments));
    let lift = &found["joints"][0];
    let number = |key: &str| lift[key].as_f64().expect("a number");
    assert!((number("least_m") + 0.15).abs() < 1e-3, "{lift}");
    assert!((number("most_m") - 0.15).abs() < 1e-3, "{lift}");
    // The weight that the lift carries: of its limit of 600 N.
    assert!((0.2..0.6).contains(&number("torque_share")), "{lift}");
    assert!(found["joints"][1]["most_rad"].as_f64().is_some(), "{found}");
    let picture = std::fs::read_to_string(plot).expect("a picture");
    assert!(picture.contains("of prismatic joints mm/s"));
    let chirp = CHIRP.replace("knee", "lift").replace("_deg", "_mm");
    let most = |size: &str| {
        let plan = chirp.replace("amplitude_mm = 4", size);
        let out = planned("lift-gripper", &plan, &["--json", "--no-self-distance"]);
        let lift = &json(&out)["joints"][0];
        let end = |key: &str| lift[key].as_f64().expect("a number");
        end("most_m").max(-end("least_m"))
    };
    let way = most("amplitude_mm = 4");
    assert!((0.0036..0.0046).contains(&way), "{way}");
    let long = chirp.replace("amplitude_mm = 4", "amplitude_mm = 400");
    refused(
        "lift-gripper",
        &long,
        &["--no-self-distance"],
        &[
            &["\"lift\" goes", "mm, ", "-199.1 to 199.1 mm"],
            &["\"lift\"", "velocity", "mm/s", "225"],
            &["\"lift\"", "force of", " N "],
        ],
    );
    let degrees = chirp.replace("amplitude_mm", "amplitude_deg");
    refused(
        "lift-gripper",
        &degrees,
        &[],
        &[
            &["has no amplitude_mm"],
            &["amplitude_deg", "prismatic", "amplitude_mm"],
        ],
    );
    let both = chirp.replace("[\"lift\"]", "[\"lift\", \"boom\"]");
    refused(
        "lift-gripper",
        &both,
        &[],
        &[&["revolute and prismatic joints"]],
    );
}

/// The search lowers the condition number, and finds the same for the same seed.
#[test]
fn a_multisine_is_chosen_for_its_condition_number() {
    let plan = "pose = { hip_pitch = -20, knee = 40 }\n[[part]]\nkind = \"multisine\"\n\
        joints = [\"hip_roll\", \"hip_pitch\", \"knee\"]\nfrequency_hz = 0.2\nharmonics = 4\ntries = 120\n";
    let choice = |more: &str| {
        let found = json(&planned(
            "leg",
            &format!("{plan}{more}"),
            &["--json", "--no-self-distance"],
        ));
        let choice = found["multisines"][0].clone();
        let number = |key: &str| choice[key].as_f64().expect("a number");
        (number("condition_before"), number("condition_after"))
    };
    let (before, after) = choice("seed = 3\n");
    assert!(after < 0.7 * before, "{before} {after}");
    assert_eq!(choice("seed = 3\n"), (before, after));
    assert_ne!(choice("seed = 4\n").1, after);
}

/// The shipped plans may be followed from their robots' start poses.
#[test]
fn the_shipped_plans_are_sound() {
    for plan in [
        "config/leg/excite.toml",
        "config/humanoid/excite-arms.toml",
        "config/lift-gripper/excite.toml",
    ] {
        let out = excite(Path::new(&project_path(plan)), &["--json"]);
        let found = json(&out);
        assert!(
            found["self_distance"]["least_m"].as_f64().is_some(),
            "{found}"
        );
        assert!(found["duration_s"].as_f64().is_some_and(|s| s < 600.0));
    }
}
