//! `torquectl check` as a whole process: what is accepted, and every kind of bad input.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// A copy of the repository's leg in a folder of its own, removed at the end.
struct Leg(PathBuf);

const TOML: &str = "config/leg/robot.toml";
const URDF: &str = "robot-models/leg/robot.urdf";
const SIM: &str = "config/leg/sim.toml";
const DBC: &str = "robot-models/leg/drives.dbc";

impl Leg {
    fn new(test: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
        for file in [TOML, URDF, DBC, SIM] {
            let copy = folder.join(file);
            fs::create_dir_all(copy.parent().unwrap()).unwrap();
            let original = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(file);
            fs::copy(original, copy).unwrap();
        }
        Self(folder)
    }

    /// Replaces the first occurrence of a text; the result is its line.
    fn change(&self, file: &str, from: &str, to: &str) -> usize {
        let path = self.0.join(file);
        let text = fs::read_to_string(&path).unwrap();
        let place = text
            .find(from)
            .unwrap_or_else(|| panic!("{file} lacks {from:?}"));
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        1 + text[..place].matches('\n').count()
    }

    fn check(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_torquectl"))
            .arg("check")
            .args(arguments)
            .arg(TOML)
            .current_dir(&self.0)
            .output()
            .unwrap()
    }

    /// Exit code 2, nothing on stdout, and each message on one line of stderr.
    fn refused(&self, messages: &[&[&str]]) {
        let output = self.check(&[]);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(output.stdout.is_empty());
        for parts in messages {
            let holds = |line: &str| parts.iter().all(|part| line.contains(part));
            assert!(
                stderr.lines().any(holds),
                "{parts:?} are not in one line of\n{stderr}"
            );
        }
        assert_eq!(stderr.lines().count(), messages.len(), "{stderr}");
    }
}

impl Drop for Leg {
    fn drop(&mut self) {
        let _gone = fs::remove_dir_all(&self.0);
    }
}

/// `file:line:`.
fn at(file: &str, line: usize) -> String {
    format!("{file}:{line}: ")
}

#[test]
fn a_complete_configuration_is_summed_up() {
    let leg = Leg::new("summed_up");
    let output = leg.check(&[]);
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    for part in [
        "leg: 6 joints, 2 buses, 1 F/T sensors, no IMU, fixed base",
        "vcan0",
        "vcan1",
        "hip_yaw",
        "ankle_roll",
        "±233 N·m",
        "K8/M",
        "ankle_ft",
    ] {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
}

#[test]
fn a_bus_of_simulators_is_warned_of_and_has_no_load() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let run = |arguments: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_torquectl"));
        command.args(arguments.split(' ')).current_dir(&root);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let text = run("check config/ur5-mujoco/robot.toml");
    for part in [
        "239.74.163.2:43113",
        "warning: bus arm: udp_multicast is for simulated robots",
    ] {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
    let json = run("check --json config/ur5-mujoco/robot.toml");
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["buses"][0]["kind"], "udp_multicast");
    assert!(json["buses"][0]["load_percent"].is_null());
}

#[test]
fn json_gives_loads_and_gains_in_both_forms() {
    let output = Leg::new("json").check(&["--json"]);
    assert!(output.status.success(), "{output:?}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["joints"].as_array().unwrap().len(), 6);
    // SYNC, three states of 8 bytes: 55 + 3 (55 + 80) us; a frame of 8 bytes with set-points: 135 us;
    // one of 3 bytes with control words: 85 us.
    let bus = &json["buses"][0];
    assert_eq!(bus["frames_received_per_cycle"], 3);
    assert_eq!(bus["frames_sent_per_cycle"], 3);
    assert!((bus["answers_us"].as_f64().unwrap() - 460.0).abs() < 1e-6);
    assert!((bus["load_percent"].as_f64().unwrap() - 68.0).abs() < 1e-6);
    let joint = &json["joints"][0];
    let gain = |group: &str, key: &str| joint[group][key].as_f64().unwrap();
    let k_tau = 0.000212;
    let k6 = k_tau * (1.0 + gain("gains", "K_p")) * gain("gains", "K_s_Nm_per_rad");
    assert!((gain("equivalent_gains", "K6") - k6).abs() < 1e-12);
    let k9 = -k_tau * gain("gains", "K_p");
    assert!((gain("equivalent_gains", "K9_per_JT_rad_per_Nm") - k9).abs() < 1e-12);
}

#[test]
fn half_the_bitrate_doubles_the_load_and_is_refused_with_the_rate_that_fits() {
    let output = Leg::new("bitrate").check(&["--bitrate", "500000"]);
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    let text = String::from_utf8(output.stderr).unwrap();
    for part in [
        "bus a: its frames take 1360 us",
        "136 %",
        "loop.rate_hz = 500",
    ] {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
}

#[test]
fn an_ft_sensor_with_nothing_beyond_it_is_warned_of() {
    let leg = Leg::new("massless");
    let urdf = "robot-models/leg/robot.urdf";
    let mass = |leg: &Leg| {
        let output = leg.check(&["--json"]);
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let beyond = json["ft_sensors"][0]["mass_beyond_kg"].as_f64().unwrap();
        (beyond, json["warnings"].to_string())
    };
    let (beyond, warnings) = mass(&leg);
    assert!((beyond - 1.2).abs() < 1e-9, "{beyond}");
    assert!(!warnings.contains("nothing beyond"), "{warnings}");
    leg.change(
        urdf,
        "<parent link=\"ankle_ft\"/>",
        "<parent link=\"ankle_roll_link\"/>",
    );
    let (beyond, warnings) = mass(&leg);
    assert!(beyond.abs() < 1e-9, "{beyond}");
    assert!(
        warnings.contains("ankle: nothing beyond it has a mass"),
        "{warnings}"
    );
}

#[test]
fn unknown_key() {
    let leg = Leg::new("unknown_key");
    let line = leg.change(TOML, "priority = 80", "priorty = 80");
    leg.refused(&[&[
        &at(TOML, line),
        "loop.priorty: unknown key",
        "allowed: ",
        "priority",
    ]]);
}

#[test]
fn joint_that_the_urdf_lacks() {
    let leg = Leg::new("no_joint");
    let line = leg.change(TOML, "name = \"knee\"", "name = \"elbow\"");
    leg.refused(&[
        &[
            &at(TOML, line),
            "joint.name (elbow)",
            "no moving joint elbow",
            "allowed: ",
            "knee",
        ],
        &["the URDF's joint knee has no table"],
    ]);
}

#[test]
fn signal_and_message_that_the_dbc_lacks() {
    let leg = Leg::new("no_signal");
    let line = leg.change(TOML, "KNEE_STATE.link_angle", "KNEE_STATE.link_angel");
    let other = leg.change(TOML, "KNEE_STATE.motor_angle", "KNIE_STATE.motor_angle");
    leg.refused(&[
        &[
            &at(TOML, line),
            "joint.link_angle.signal (knee)",
            "has no signal link_angel",
            "allowed: link_angle, motor_angle, current",
        ],
        &[
            &at(TOML, other),
            "has no message KNIE_STATE",
            "allowed: SYNC, ",
        ],
    ]);
}

#[test]
fn overlapping_signals() {
    let leg = Leg::new("overlap");
    let line = leg.change(DBC, "motor_angle : 19|16", "motor_angle : 18|16");
    leg.refused(&[&[
        &at(DBC, line),
        "HIP_YAW_STATE.motor_angle overlaps signal link_angle",
        "allowed: ",
    ]]);
}

#[test]
fn duplicate_id_in_one_file() {
    let leg = Leg::new("duplicate_id");
    let line = leg.change(DBC, "BO_ 258 ", "BO_ 257 ");
    leg.refused(&[&[
        &at(DBC, line),
        "HIP_ROLL_STATE has CAN id 257 (0x101) like message HIP_YAW_STATE",
        "allowed: one message for each id",
    ]]);
}

#[test]
fn duplicate_id_in_two_files_of_a_bus() {
    let leg = Leg::new("duplicate_id_two_files");
    let one = "dbc = \"../../robot-models/leg/drives.dbc\"";
    let two = "dbc = [\"../../robot-models/leg/drives.dbc\", \"extra.dbc\"]";
    leg.change(TOML, one, two);
    fs::write(
        leg.0.join("config/leg/extra.dbc"),
        "VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: A\n\nBO_ 385 OTHER: 8 A\n SG_ x : 0|8@1+ (1,0) [0|0] \"\" A\n",
    )
    .unwrap();
    leg.refused(&[&[
        &at("config/leg/extra.dbc", 9),
        "message OTHER has CAN id 385 (0x181) like message ANKLE_FT_F",
        "on the same bus",
        "allowed: ",
    ]]);
}

#[test]
fn gains_that_are_not_numbers() {
    let leg = Leg::new("nan");
    let line = leg.change(TOML, "K_d_Nms_per_rad = 23.6", "K_d_Nms_per_rad = nan");
    let other = leg.change(TOML, "K_s_Nm_per_rad = 16667.0", "K_s_Nm_per_rad = -inf");
    leg.refused(&[
        &[
            &at(TOML, line),
            "joint.gains.K_d_Nms_per_rad (hip_yaw): NaN is not allowed; allowed: a finite number >= 0",
        ],
        &[
            &at(TOML, other),
            "joint.gains.K_s_Nm_per_rad (hip_roll): -inf is not allowed",
        ],
    ]);
}

#[test]
fn urdf_with_a_zero_axis() {
    let leg = Leg::new("zero_axis");
    let line = leg.change(URDF, "<axis xyz=\"0 0 1\"", "<axis xyz=\"0 0 0\"");
    leg.refused(&[&[&at(URDF, line), "axis", "allowed: "]]);
}

#[test]
fn urdf_with_negative_mass() {
    let leg = Leg::new("negative_mass");
    let line = leg.change(URDF, "<mass value=\"", "<mass value=\"-");
    leg.refused(&[&[&at(URDF, line), "mass", "allowed: "]]);
}

#[test]
fn interface_that_cannot_exist() {
    let leg = Leg::new("interface");
    let line = leg.change(TOML, "\"vcan0\"", "\"vcan/0\"");
    leg.refused(&[&[
        &at(TOML, line),
        "bus.interface (a)",
        "vcan/0",
        "allowed: 1 to 15 bytes",
    ]]);
}

#[test]
fn one_interface_for_two_buses() {
    let leg = Leg::new("same_interface");
    let line = leg.change(TOML, "\"vcan1\"", "\"vcan0\"");
    leg.refused(&[&[
        &at(TOML, line),
        "bus.interface (b)",
        "a second bus is on vcan0",
        "allowed: ",
    ]]);
}

#[test]
fn two_joints_with_one_signal() {
    let leg = Leg::new("same_signal");
    let line = leg.change(TOML, "HIP_ROLL_STATE.current", "HIP_YAW_STATE.current");
    leg.refused(&[&[
        &at(TOML, line),
        "joint.current.signal (hip_roll)",
        "HIP_YAW_STATE.current is used by joint.current.signal (hip_yaw) already",
        "allowed: ",
    ]]);
}

#[test]
fn unknown_drive_bus_and_word() {
    let leg = Leg::new("unknown_names");
    let drive = leg.change(TOML, "drive = \"knee\"", "drive = \"nee\"");
    let bus = leg.change(
        TOML,
        "frame = \"ankle_ft\"\nbus = \"b\"",
        "frame = \"ankle_ft\"\nbus = \"c\"",
    );
    let word = leg.change(TOML, "real_time = \"try\"", "real_time = \"maybe\"");
    leg.refused(&[
        &[
            &at(TOML, drive),
            "there is no [drive.nee]",
            "allowed: ankle_pitch, ankle_roll",
        ],
        &[
            &at(TOML, bus + 1),
            "there is no [[bus]] \"c\"",
            "allowed: a, b",
        ],
        &[
            &at(TOML, word),
            "loop.real_time: \"maybe\"",
            "allowed: \"try\" or \"require\"",
        ],
    ]);
}

#[test]
fn numbers_out_of_range_and_wrong_counts() {
    let leg = Leg::new("ranges");
    let rate = leg.change(
        TOML,
        "gather_deadline_us = 750.0",
        "gather_deadline_us = 1750.0",
    );
    let pole = leg.change(TOML, "low_pass_pole = 0.95", "low_pass_pole = 1.0");
    let axes = leg.change(TOML, "\"ANKLE_FT_F.fy\", ", "");
    let tare = leg.change(TOML, "offset = [0.0, ", "offset = [");
    leg.refused(&[
        &[
            &at(TOML, rate),
            "loop.gather_deadline_us: 1750 is not allowed",
            "below the period of 1000 us",
        ],
        &[
            &at(TOML, pole),
            "drive.compliance.low_pass_pole (hip_yaw): 1.0",
            "from 0 to below 1",
        ],
        &[
            &at(TOML, axes),
            "ft_sensor.force (ankle): 2 values",
            "allowed: three signals",
        ],
        &[
            &at(TOML, tare),
            "ft_sensor.offset (ankle): 5 values",
            "allowed: 6 numbers",
        ],
    ]);
}

#[test]
fn missing_key_and_missing_files() {
    let leg = Leg::new("missing");
    let joint = leg.change(TOML, "torque_limit_Nm = 57.0\n", "");
    leg.change(TOML, "leg/robot.urdf", "leg/none.urdf");
    let dbc = leg.change(TOML, "leg/drives.dbc", "leg/none.dbc");
    leg.refused(&[
        // The table's own line: `[[joint]]` stands four lines above the missing key.
        &[
            &at(TOML, joint - 4),
            "joint.torque_limit_Nm (hip_yaw): the key is missing",
            "> 0",
        ],
        &[
            "robot-models/leg/none.urdf",
            "cannot be read",
            "robot.urdf",
            "allowed: ",
        ],
        &[
            &at(TOML, dbc),
            "bus.dbc",
            "robot-models/leg/none.dbc cannot be read",
            "allowed: ",
        ],
    ]);
}

#[test]
fn configuration_that_is_no_toml_or_is_not_there() {
    let leg = Leg::new("syntax");
    let line = leg.change(TOML, "name = \"leg\"", "name = \"leg");
    leg.refused(&[&[&at(TOML, line)]]);
    fs::remove_file(leg.0.join(TOML)).unwrap();
    leg.refused(&[&[TOML, "cannot be read", "allowed: "]]);
}

#[test]
fn every_command_has_help() {
    for command in ["check", "watch", "dynamics"] {
        let output = Command::new(env!("CARGO_BIN_EXE_torquectl"))
            .args([command, "--help"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{command}: {output:?}");
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(text.contains("Usage: torquectl "), "{command}: {text}");
    }
    let wrong = Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .arg("chek")
        .output()
        .unwrap();
    assert_eq!(wrong.status.code(), Some(2));
}

#[test]
fn a_reader_may_leave_early() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .args(["check", "config/humanoid/robot.toml"])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!((output.status.code(), errors.as_ref()), (Some(0), ""));
}

#[test]
fn a_mistake_in_the_simulated_robots_parameters_is_named() {
    let leg = Leg::new("simulation");
    assert_eq!(leg.check(&[]).status.code(), Some(0));
    let line = leg.change(SIM, "substep_us = 100", "substep_us = -100");
    leg.refused(&[&[&format!("{SIM}:{line}"), "substep_us", "> 0"]]);
    fs::remove_file(leg.0.join(SIM)).unwrap();
    assert_eq!(leg.check(&[]).status.code(), Some(0));
}
