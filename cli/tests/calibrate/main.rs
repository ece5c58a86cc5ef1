//! `torquectl calibrate` as a whole process: from recordings that the daemon's loop made of the simulated
//! test joint to joint files in its configuration, judged on another motion against the true torque.

mod robot_folder;

use std::fs;
use std::path::Path;
use std::process::Command;

use robot_folder::{expect, folder, judge, judge_of, record, text};

const SWEEPS: &str = "settle_s = 1.0\njoint = [\n\
    { name = \"joint\", amplitude_deg = 160, period_s = 21 },\n\
    { name = \"joint\", amplitude_deg = -140, period_s = 15 },\n\
    { name = \"joint\", amplitude_deg = 20, period_s = 2.3 },\n]\n";

#[test]
fn a_joint_is_calibrated_from_its_own_recording_adopted_and_taken_back() {
    let folder = folder("joint", "test-joint");
    let config = "config/test-joint/robot.toml";
    record(&folder, "test-joint", SWEEPS, 60.0, "sweeps.mcap");
    let before = judge(&folder, 10.0);
    assert!(expect(&folder, &format!("calibrate status {config}"), 1).contains("missing"));

    let made = format!("calibrate sweeps.mcap --config {config} -o made --report made.html");
    let shown = expect(&folder, &made, 0);
    assert!(
        shown.contains("held out") && shown.contains("written: made"),
        "{shown}"
    );
    let page = fs::read_to_string(folder.join("made.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("SHA-256"));
    // Twice into one folder: refused, and the first stays.
    let kept = fs::read_to_string(folder.join("made/joint.toml")).unwrap();
    assert!(expect(&folder, &made, 2).contains("is there already"));
    assert_eq!(
        kept,
        fs::read_to_string(folder.join("made/joint.toml")).unwrap()
    );

    let original = fs::read_to_string(folder.join(config)).unwrap();
    expect(&folder, &format!("calibrate commit {config} made"), 0);
    let committed = fs::read_to_string(folder.join(config)).unwrap();
    let line = committed
        .lines()
        .find(|line| line.starts_with("calibration"));
    assert!(
        line.is_some_and(|line| line.contains("calibrations/")),
        "{committed}"
    );
    let without: Vec<&str> = committed.lines().filter(|l| Some(*l) != line).collect();
    assert_eq!(
        without,
        original.lines().collect::<Vec<_>>(),
        "nothing else changes"
    );
    assert!(expect(&folder, &format!("calibrate status {config}"), 0).contains("calibrated"));
    assert!(expect(&folder, &format!("calibrate status {config} --days 0"), 1).contains("old"));
    let shown = expect(&folder, &format!("calibrate diff {config} made"), 0);
    assert!(
        shown.contains("stiffness") && !shown.contains("differs"),
        "{shown}"
    );

    let after = judge(&folder, 10.0);
    let [rms, ratio, largest] = after;
    assert!(rms < 0.02 * largest, "{before:?} {after:?}");
    assert!(rms < 0.6 * before[0], "{before:?} {after:?}");
    assert!((0.4..1.6).contains(&ratio), "{after:?}");

    // An encoder that was set anew is of another robot.
    let moved = committed.replace("offset_deg = -180.0", "offset_deg = -179.0");
    assert_ne!(moved, committed);
    fs::write(folder.join(config), &moved).unwrap();
    let status = expect(&folder, &format!("calibrate status {config}"), 1);
    assert!(status.contains("of another robot"), "{status}");
    let refusal = expect(&folder, &format!("calibrate commit {config} made"), 2);
    assert!(refusal.contains("zeros"), "{refusal}");
    assert_eq!(fs::read_to_string(folder.join(config)).unwrap(), moved);

    fs::write(folder.join(config), &committed).unwrap();
    expect(&folder, &format!("calibrate rollback {config}"), 0);
    assert_eq!(fs::read_to_string(folder.join(config)).unwrap(), original);
    let refusal = expect(&folder, &format!("calibrate rollback {config}"), 2);
    assert!(
        refusal.contains("no calibration was committed"),
        "{refusal}"
    );
    // And once more, twice: back is the one before.
    expect(&folder, &format!("calibrate commit {config} made"), 0);
    let first = fs::read_to_string(folder.join(config)).unwrap();
    expect(&folder, &format!("calibrate commit {config} made"), 0);
    assert_ne!(fs::read_to_string(folder.join(config)).unwrap(), first);
    expect(&folder, &format!("calibrate rollback {config}"), 0);
    assert_eq!(fs::read_to_string(folder.join(config)).unwrap(), first);
}

#[test]
fn what_cannot_be_calibrated_is_named_and_leaves_nothing() {
    let folder = folder("refusals", "test-joint");
    record(&folder, "test-joint", SWEEPS, 12.0, "run.mcap");
    let whole = fs::read(folder.join("run.mcap")).unwrap();

    // Cut off: what is whole is used, and it is said so; without a cycle it is refused.
    fs::write(folder.join("cut.mcap"), &whole[..whole.len() * 3 / 4]).unwrap();
    let shown = expect(&folder, "calibrate cut.mcap -o cut", 0);
    assert!(
        shown.contains("cut.mcap: the file ends too early"),
        "{shown}"
    );
    fs::write(folder.join("stub.mcap"), &whole[..200]).unwrap();
    let shown = expect(&folder, "calibrate stub.mcap -o stub", 2);
    assert!(shown.contains("stub.mcap"), "{shown}");
    fs::write(folder.join("log.csv"), "t,q\n0,0\n").unwrap();
    assert!(expect(&folder, "calibrate log.csv -o csv", 2).contains("not an MCAP file"));
    expect(&folder, "calibrate none.mcap -o none", 2);

    // A joint that never moves, and carries one torque.
    record(&folder, "test-joint", "settle_s = 1.0\n", 4.0, "rest.mcap");
    let shown = expect(&folder, "calibrate rest.mcap -o rest", 2);
    assert!(shown.contains("joint: never moves"), "{shown}");
    // Neither a column nor a sensor that the robot does not have.
    let spoken = ["tau_sensor", "`i`", "`q`", "`theta`"];
    assert!(spoken.iter().all(|name| !shown.contains(name)), "{shown}");

    // Another robot: the same joint with another gear.
    let config = folder.join("config/test-joint/robot.toml");
    let original = fs::read_to_string(&config).unwrap();
    fs::write(
        &config,
        original.replace("gear_ratio = 100.0", "gear_ratio = 120.0"),
    )
    .unwrap();
    let path = "config/test-joint/robot.toml";
    let shown = expect(
        &folder,
        &format!("calibrate run.mcap --config {path} -o other"),
        2,
    );
    assert!(shown.contains("gear_ratio = 100.0, not 120.0"), "{shown}");
    record(&folder, "test-joint", SWEEPS, 3.0, "other.mcap");
    let shown = expect(&folder, "calibrate run.mcap other.mcap -o mixed", 2);
    assert!(
        shown.contains("other.mcap: is a recording of another robot"),
        "{shown}"
    );
    fs::write(&config, &original).unwrap();

    // A full disk, and an end by force, leave the configuration that there was.
    let full = Command::new("bash")
        .args([
            "-c",
            &format!("trap '' XFSZ; ulimit -f 2; exec \"$0\" calibrate commit {path} cut"),
        ])
        .arg(env!("CARGO_BIN_EXE_torquectl"))
        .current_dir(&folder)
        .output()
        .unwrap();
    let shown = text(&full.stderr);
    assert_eq!(full.status.code(), Some(2), "{shown}");
    assert!(shown.contains("cannot be written"), "{shown}");
    assert_eq!(fs::read_to_string(&config).unwrap(), original);
    let mut killed = Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .args(["calibrate", "run.mcap", "-o", "killed"])
        .current_dir(&folder)
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(300));
    killed.kill().unwrap();
    assert!(!killed.wait().unwrap().success());
    assert_eq!(fs::read_to_string(&config).unwrap(), original);

    // A full disk: files of at most two blocks can be written.
    let full = Command::new("bash")
        .args([
            "-c",
            "trap '' XFSZ; ulimit -f 2; exec \"$0\" calibrate run.mcap -o full",
        ])
        .arg(env!("CARGO_BIN_EXE_torquectl"))
        .current_dir(&folder)
        .output()
        .unwrap();
    let shown = text(&full.stderr);
    assert_eq!(full.status.code(), Some(2), "{shown}");
    assert!(shown.contains("full: cannot be written"), "{shown}");
    let left = fs::read_dir(&folder).unwrap();
    let left = left.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
    let mut left: Vec<String> = left.collect();
    left.sort();
    let files = [
        "config",
        "cut",
        "cut.mcap",
        "log.csv",
        "motion.toml",
        "other.mcap",
        "rest.mcap",
        "robot-models",
        "run.mcap",
        "stub.mcap",
    ];
    assert_eq!(left, files, "nothing half-written is left");
}

const LIFTING: &str = "settle_s = 1.0\njoint = [\n\
    { name = \"lift\", amplitude_mm = 150, period_s = 19 },\n\
    { name = \"lift\", amplitude_mm = 10, period_s = 2.9 },\n\
    { name = \"boom\", amplitude_deg = 60, period_s = 31 },\n\
    { name = \"boom\", amplitude_deg = -45, period_s = 23 },\n]\n";

#[test]
fn a_prismatic_joint_is_calibrated_in_newtons() {
    let folder = folder("prismatic", "lift-gripper");
    let config = "config/lift-gripper/robot.toml";
    record(&folder, "lift-gripper", LIFTING, 60.0, "run.mcap");
    let before = judge_of(&folder, "lift-gripper", 10.0);
    // The finger does not move.
    let made = "calibrate run.mcap -o made --only joints --report made.html";
    let shown = expect(&folder, made, 1);
    let finger = shown
        .lines()
        .find(|line| line.starts_with("finger: not calibrated"));
    assert!(
        finger.is_some_and(|line| line.contains("forces times 0.1 m")),
        "{shown}"
    );
    let lift = shown.lines().find(|line| line.trim().starts_with("lift "));
    let lift = lift.unwrap_or_default();
    // The largest force and the RMS on the part that was held out.
    assert!(lift.matches(" N ").count() == 2, "{shown}");
    expect(&folder, &format!("calibrate commit {config} made"), 0);
    let status = expect(&folder, &format!("calibrate status {config} --json"), 1);
    assert!(status.contains("held_out_rms_N\""), "{status}");
    let after = judge_of(&folder, "lift-gripper", 10.0);
    let [rms, ratio, largest] = after;
    assert!(rms < 0.035 * largest, "{before:?} {after:?}");
    assert!(rms < 0.8 * before[0], "{before:?} {after:?}");
    assert!((0.6..1.6).contains(&ratio), "{after:?}");
    // Logs of a joint that slides are not those of one that turns.
    fs::write(folder.join("log.csv"), "t,theta,q,i\n0,0,0,0\n").unwrap();
    let refused = "estimate --joint made/lift.toml --log log.csv";
    assert!(expect(&folder, refused, 2).contains("prismatic"));
}

const LEG: &str = "settle_s = 1.0\njoint = [\n\
    { name = \"hip_yaw\", amplitude_deg = 20, period_s = 13 },\n\
    { name = \"hip_roll\", amplitude_deg = 25, period_s = 17 },\n\
    { name = \"hip_pitch\", amplitude_deg = -60, period_s = 19 },\n\
    { name = \"knee\", amplitude_deg = 60, period_s = 11 },\n\
    { name = \"ankle_pitch\", amplitude_deg = 45, period_s = 7 },\n\
    { name = \"ankle_roll\", amplitude_deg = 20, period_s = 5 },\n]\n";
const OTHER: &str = "settle_s = 1.0\njoint = [\n\
    { name = \"hip_pitch\", amplitude_deg = -70, period_s = 12 },\n\
    { name = \"knee\", amplitude_deg = 80, period_s = 9 },\n\
    { name = \"ankle_pitch\", amplitude_deg = -30, period_s = 5 },\n\
    { name = \"ankle_roll\", amplitude_deg = -15, period_s = 4 },\n\
    { name = \"hip_roll\", amplitude_deg = -15, period_s = 7 },\n]\n";

/// The number before ` ±` behind a key of calibration.toml's `[[ft_sensor]]`.
fn entry(folder: &Path, calibration: &str, key: &str) -> Vec<[f64; 2]> {
    let text = fs::read_to_string(folder.join(calibration).join("calibration.toml")).unwrap();
    let table: toml::Table = toml::from_str(&text).unwrap();
    let value = &table["ft_sensor"][0][key];
    let pair = |v: &toml::Value| [0, 1].map(|k| v[k].as_float().unwrap());
    if value[0].is_array() {
        value.as_array().unwrap().iter().map(pair).collect()
    } else {
        vec![pair(value)]
    }
}

#[test]
fn joints_that_do_not_move_are_named_and_get_no_joint_file() {
    let folder = folder("rest", "leg");
    record(&folder, "leg", "settle_s = 1.0\n", 12.0, "rest.mcap");
    let shown = expect(&folder, "calibrate rest.mcap --untouched -o rest", 1);
    for joint in "hip_yaw hip_roll hip_pitch knee ankle_pitch ankle_roll".split(' ') {
        let named = format!("{joint}: not calibrated: ");
        assert!(shown.contains(&named), "{joint}: {shown}");
    }
    // The F/T sensor's offset is known at rest too; its mass and centre are not.
    assert!(shown.contains("gravity turned by") && shown.contains("undetermined"));
    let files = fs::read_dir(folder.join("rest")).unwrap();
    let files = files.map(|entry| entry.unwrap().file_name());
    assert_eq!(files.collect::<Vec<_>>(), ["calibration.toml"]);
}

#[test]
fn an_ft_sensor_and_a_payload_are_found_adopted_and_taken_back() {
    let folder = folder("sensor", "leg");
    let at = |path: &str| folder.join(path);
    let config = "config/leg/robot.toml";
    let urdf = fs::read_to_string(at("robot-models/leg/robot.urdf")).unwrap();
    // The true foot is heavier than the URDF's and lies elsewhere, and the sensor was never tared.
    let (foot, true_foot) = (
        "<origin xyz=\"0.0133333333 0 -0.0308333333\" rpy=\"0 0 0\"/>\n      <mass value=\"1.2\"/>",
        "<origin xyz=\"0.02 0.006 -0.025\" rpy=\"0 0 0\"/>\n      <mass value=\"1.35\"/>",
    );
    let truth = urdf.replace(foot, true_foot);
    assert_ne!(truth, urdf);
    fs::write(at("config/leg/true.urdf"), &truth).unwrap();
    let sim = fs::read_to_string(at("config/leg/sim.toml")).unwrap();
    let sim = sim.replace("inertia_error_per_cent = 1", "inertia_error_per_cent = 0");
    let sim = sim
        .replace("bias_N = 0.05", "bias_N = 8")
        .replace("bias_Nm = 0.002", "bias_Nm = 0.4");
    let with = |urdf: &str| {
        let sim = sim.replace("../../robot-models/leg/robot.urdf", urdf);
        fs::write(at("config/leg/sim.toml"), sim).unwrap();
    };
    with("true.urdf");
    record(&folder, "leg", LEG, 26.0, "run.mcap");
    let refusal = expect(&folder, "calibrate run.mcap --only ft -o sensor", 2);
    assert!(refusal.contains("--untouched"), "{refusal}");
    let shown = expect(
        &folder,
        "calibrate run.mcap --only ft --untouched -o sensor --report sensor.html",
        0,
    );
    assert!(shown.contains("mass of foot"), "{shown}");
    assert!(
        fs::read_to_string(at("sensor.html"))
            .unwrap()
            .contains("F/T sensors")
    );
    let [mass, width] = entry(&folder, "sensor", "mass_kg")[0];
    assert!(
        (mass - 1.35).abs() < 0.015 && (mass - 1.35).abs() < 2.0 * width,
        "{mass} ± {width}\n{shown}"
    );
    for ([x, width], truth) in entry(&folder, "sensor", "centre_m")
        .iter()
        .zip([0.02, 0.006, -0.025])
    {
        assert!(
            (x - truth).abs() < 0.002 && width < &0.004,
            "{x} ± {width}, true {truth}\n{shown}"
        );
    }
    let original = fs::read_to_string(at(config)).unwrap();
    expect(&folder, &format!("calibrate commit {config} sensor"), 0);
    let committed = fs::read_to_string(at(config)).unwrap();
    assert!(
        committed.contains("urdf = \"calibrations/") && !committed.contains("offset = [0.0, 0.0")
    );
    let status = expect(&folder, &format!("calibrate status {config}"), 1);
    assert!(
        status.contains("ft_sensor ankle") && status.contains("calibrated"),
        "{status}"
    );

    // With it the sensor shows nothing that the model lacks, in another motion too.
    record(&folder, "leg", OTHER, 18.0, "again.mcap");
    expect(
        &folder,
        "calibrate again.mcap --only ft --untouched -o again",
        0,
    );
    let offsets = [
        entry(&folder, "sensor", "offset"),
        entry(&folder, "again", "offset"),
    ];
    for (k, ([a, _], [b, _])) in offsets[0].iter().zip(&offsets[1]).enumerate() {
        assert!(
            (a - b).abs() < if k < 3 { 0.15 } else { 0.01 },
            "{k}: {a} {b}"
        );
    }
    let [again, _] = entry(&folder, "again", "mass_kg")[0];
    assert!((again - mass).abs() < 0.01, "{mass} {again}");
    let shown = expect(&folder, &format!("calibrate diff {config} again"), 0);
    assert!(
        shown.contains("F/T sensor ankle") && shown.contains("mass beyond"),
        "{shown}"
    );

    // A payload on the foot: by the sensor, and by the torques of the joints.
    let load = "<link name=\"load\"><inertial><origin xyz=\"0.03 0.01 -0.06\"/><mass value=\"1.5\"/>\
        <inertia ixx=\"0.002\" iyy=\"0.002\" izz=\"0.002\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>\
        <joint name=\"load\" type=\"fixed\"><parent link=\"foot\"/><child link=\"load\"/></joint></robot>";
    fs::write(
        at("config/leg/loaded.urdf"),
        truth.replace("</robot>", load),
    )
    .unwrap();
    with("loaded.urdf");
    record(&folder, "leg", LEG, 26.0, "loaded.mcap");
    let payload = |options: &str| -> (f64, [f64; 3]) {
        let text = expect(
            &folder,
            &format!("calibrate payload loaded.mcap --link foot --untouched {options}"),
            0,
        );
        let option = text
            .lines()
            .find_map(|l| l.strip_prefix("--payload foot="))
            .expect(&text);
        let numbers: Vec<f64> = option.split(',').map(|x| x.parse().unwrap()).collect();
        (numbers[0], [numbers[1], numbers[2], numbers[3]])
    };
    let (mass, centre) = payload("-o loaded-model.urdf");
    assert!((mass - 1.5).abs() < 0.02, "{mass}");
    for (x, truth) in centre.iter().zip([0.03, 0.01, -0.06]) {
        assert!((x - truth).abs() < 0.003, "{centre:?}");
    }
    assert!(
        fs::read_to_string(at("loaded-model.urdf"))
            .unwrap()
            .contains("__payload")
    );
    let (mass, _) = payload("--from joints --empty again.mcap");
    assert!((mass - 1.5).abs() < 0.25, "{mass}");
    let refusal = expect(
        &folder,
        "calibrate payload again.mcap --link foot --untouched --empty again.mcap",
        2,
    );
    assert!(refusal.contains("no payload"), "{refusal}");

    // Back, to the last byte; and what was of another robot.
    expect(&folder, &format!("calibrate rollback {config}"), 0);
    assert_eq!(fs::read_to_string(at(config)).unwrap(), original);
    fs::write(at(config), original.replace("sign = 1", "sign = -1")).unwrap();
    let refusal = expect(&folder, &format!("calibrate commit {config} sensor"), 2);
    assert!(refusal.contains("F/T sensor ankle"), "{refusal}");
    let heavier = urdf.replace("<mass value=\"0.6\"/>", "<mass value=\"0.7\"/>");
    fs::write(at(config), &original).unwrap();
    fs::write(at("robot-models/leg/robot.urdf"), heavier).unwrap();
    let refusal = expect(&folder, &format!("calibrate commit {config} sensor"), 2);
    assert!(refusal.contains("the URDF has changed"), "{refusal}");
    assert_eq!(fs::read_to_string(at(config)).unwrap(), original);
}
