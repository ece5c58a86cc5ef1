//! `torqued run --simulate`: a process of its own without CAN, seen by a client through shared memory.

use crate::common;

use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use common::RunDir;
use robot_state::{Mode, RobotState, torque_flags};
use test_support::{TemporaryDirectory, project_path};
use torqued_client::{Client, Commander, Timing};

fn torqued(arguments: &[&str], run: &RunDir) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_torqued"));
    command
        .arg("run")
        .args(arguments)
        .env("TORQUED_RUN_DIR", run.directory.path())
        .env("STATE_DIRECTORY", run.directory.path().join("state"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

fn refused(arguments: &[&str]) -> Output {
    torqued(arguments, &RunDir::new())
        .output()
        .expect("torqued runs")
}

#[test]
fn a_client_reads_the_torques_of_a_robot_that_is_simulated_in_the_daemon() {
    let run = RunDir::new();
    let config = project_path("config/leg/robot.toml");
    // Ends by itself, should the test fail.
    let arguments = [config.as_str(), "--simulate", "--seconds", "60", "--json"];
    let daemon = torqued(&arguments, &run).spawn().expect("torqued runs");
    let deadline = Instant::now() + Duration::from_secs(30);
    let client = Client::connect_at(&run.location, "leg", Duration::from_secs(30));
    let mut client = client.expect("a daemon");
    let estimated = client
        .records(Duration::from_secs(10))
        .map(|record| record.expect("a record").cycle)
        .take_while(|_| Instant::now() < deadline)
        .find(|cycle| {
            let valid = |torque: &robot_state::TorqueEstimate| {
                torque.flags & torque_flags::VALID != 0 && torque.sigma > 0.0
            };
            cycle.state == RobotState::Holding.number()
                && (cycle.estimated.joints[..6].iter()).all(|j| valid(&j.tau_whole_body))
        })
        .expect("the simulated leg is held, and its torques are valid");
    // The knee carries the shank: a few N·m, and the two estimates agree.
    let knee = &estimated.estimated.joints[3];
    let (a, b) = (knee.tau_encoder.tau, knee.tau_whole_body.tau);
    assert!(b.abs() > 1.0 && (a - b).abs() < 4.0, "{a} {b}");

    // Sent to a pose, it goes there and holds.
    let mut commander = Commander::connect(&mut client).expect("the lease");
    let ready = commander.hold_until_ready(Duration::from_secs(10));
    ready.expect("followed");
    let target = estimated.measured.joints[3].q + 0.1;
    let mut shown = Duration::ZERO;
    let arrived = commander.go_to(
        |reference| reference.joints[3].q_d = target,
        |left| {
            shown = shown.max(left);
            true
        },
    );
    assert!(arrived.expect("followed") && shown > Duration::from_millis(100));

    // Along a trajectory, by a client that does nothing for a tenth of a second now and then.
    let start = commander.reference().joints;
    let mut asked = 0;
    let followed = commander.follow(
        Timing {
            duration: Duration::from_secs(2),
            spacing: Duration::from_millis(5),
        },
        |t, joints| {
            asked += 1;
            if asked % 50 == 0 {
                std::thread::sleep(Duration::from_millis(120));
            }
            for (joint, start) in joints.iter_mut().zip(&start) {
                joint.q_d = start.q_d;
            }
            // From rest to rest, back and forth.
            let (s, k, size) = (t / 2.0, 0.5, 0.1 * 64.0);
            let (u, du, ddu) = (s * (1.0 - s), k * (1.0 - 2.0 * s), -2.0 * k * k);
            joints[3].q_d += size * u * u * u;
            joints[3].dq_d = size * 3.0 * u * u * du;
            joints[3].ddq_d = size * (6.0 * u * du * du + 3.0 * u * u * ddu);
        },
        |_| true,
    );
    assert_eq!(followed, Ok(true));
    commander.close().expect("given back");
    client.latest().expect("records");
    let record = client.next_record(Duration::from_secs(2)).expect("one");
    let q = record.cycle.measured.joints[3].q;
    assert!((q - target).abs() < 0.1f64.to_radians(), "{q} {target}");

    // A joint is let go, and held again where it then is.
    let mut commander = Commander::connect(&mut client).expect("the lease");
    let ready = commander.hold_until_ready(Duration::from_secs(10));
    ready.expect("followed");
    for _ in 0..50 {
        commander.let_go(&[3]).expect("let go");
        std::thread::sleep(Duration::from_millis(5));
    }
    let status = commander.status().expect("a status");
    assert_eq!(status.mode, Mode::Passive.number());
    commander.close().expect("given back");

    let signalled = Command::new("kill").arg(daemon.id().to_string()).status();
    assert!(signalled.expect("kill runs").success());
    let out = daemon.wait_with_output().expect("ended");
    let text = String::from_utf8_lossy(&out.stdout);
    assert_eq!(out.status.code(), Some(0), "{text}");
    assert!(
        text.contains("\"fault\":0") && text.contains("\"skipped_cycles\":0"),
        "{text}"
    );
    // A tare of the simulated robot must never be taken for one of the real robot.
    let state = run.directory.path().join("state");
    assert!(state.join("leg-simulated").is_dir() && !state.join("leg").exists());
}

#[test]
fn the_demo_runs_a_robot_by_its_path_and_moves_its_joints_without_a_motion_file() {
    let directory = TemporaryDirectory::new();
    for file in ["config/leg/robot.toml", "config/leg/sim.toml"]
        .into_iter()
        .chain(["robot-models/leg/robot.urdf", "robot-models/leg/drives.dbc"])
    {
        let copy = directory.path().join(file);
        std::fs::create_dir_all(copy.parent().expect("a folder")).expect("made");
        std::fs::copy(project_path(file), copy).expect("copied");
    }
    let demo = |robot: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_torqued"));
        command.args([
            "demo",
            "--fast",
            "--seconds",
            "4",
            "--json",
            "--robot",
            robot,
        ]);
        command
            .current_dir(directory.path())
            .output()
            .expect("runs")
    };
    let out = demo("config/leg/robot.toml");
    let text = String::from_utf8_lossy(&out.stdout);
    assert_eq!(out.status.code(), Some(0), "{text}");
    assert!(
        text.contains("\"robot\":\"leg\"") && text.contains("\"fault\":0"),
        "{text}"
    );

    // An operator has to enable it: the demo has nobody else, and moves it all the same.
    let path = directory.path().join("config/leg/robot.toml");
    let config = std::fs::read_to_string(&path).expect("read");
    let by_operator = config.replace("enable = \"automatic\"", "enable = \"operator\"");
    assert_ne!(by_operator, config);
    std::fs::write(&path, by_operator).expect("written");
    let largest = |text: &[u8]| {
        let report: serde_json::Value = serde_json::from_slice(text).expect("JSON");
        assert_eq!(report["fault"], 0, "{report}");
        report["joints"][2]["largest_torque"].as_f64()
    };
    let at_once = largest(text.as_bytes()).expect("a number");
    let enabled = largest(&demo("config/leg/robot.toml").stdout).expect("a number");
    assert!(
        (enabled - at_once).abs() < 0.05 * at_once,
        "{enabled}, {at_once}"
    );

    // Of a joint without a link-side encoder there is no torque from encoders, and nothing breaks.
    let out = demo("hrp2-like");
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
    assert_eq!((out.status.code(), &report["fault"]), (Some(0), &0.into()));
    let knee = &report["joints"][3];
    assert!(knee["encoder"].is_null(), "{knee}");
    let largest = knee["largest_torque"].as_f64().expect("a number");
    for source in ["whole_body", "delay_compensated"] {
        let rms = knee[source]["rms"].as_f64().expect("a number");
        assert!(rms < 0.05 * largest, "{source}: {rms} of {largest}");
    }

    let out = demo("arm");
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{error}");
    assert!(
        error.contains("\"arm\"") && error.contains("the path of a robot.toml"),
        "{error}"
    );
}

#[test]
fn a_missing_or_wrong_simulation_file_is_named_and_nothing_starts() {
    let config = project_path("config/leg/robot.toml");
    let out = refused(&[&config, "--simulate", "/nowhere/sim.toml"]);
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{error}");
    assert!(
        error.contains("/nowhere/sim.toml: cannot be read"),
        "{error}"
    );

    let out = refused(&[&config, "--simulate", &config]);
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{error}");
    assert!(error.contains("leg/robot.toml:"), "{error}");
}

#[test]
fn a_torque_loop_that_check_refuses_is_not_started_unless_its_margins_are_accepted() {
    let directory = TemporaryDirectory::new();
    let shipped = project_path("config/leg/robot.toml");
    let text = std::fs::read_to_string(&shipped).expect("read");
    // Damping far beyond what the loop bears.
    let stiff = text.replace("K_d_Nms_per_rad = 98.0", "K_d_Nms_per_rad = 1960.0");
    assert_ne!(stiff, text);
    let models = project_path("robot-models");
    let stiff = stiff.replace("../../robot-models", &models);
    std::fs::create_dir_all(directory.path()).expect("made");
    let config = directory.path().join("robot.toml");
    std::fs::write(&config, stiff).expect("written");
    let sim = project_path("config/leg/sim.toml");
    let path = config.to_string_lossy();
    let arguments = [&*path, "--simulate", &sim, "--seconds", "0.1"];

    let out = refused(&arguments);
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{error}");
    // Word for word what `torquectl check` refuses: every joint that it names, and nothing else.
    let read = |path: &str| std::fs::read_to_string(path);
    let robot = robot_config::load(&path, &read).expect("a configuration");
    let expected = robot_config::torque_loops::refused_loops(&robot, &path);
    assert!(!expected.is_empty());
    for problem in &expected {
        assert!(error.contains(&problem.to_string()), "{problem}: {error}");
    }
    assert_eq!(
        error.matches("at least 30 degrees and 6 dB").count(),
        expected.len()
    );
    assert!(error.contains("--accept-margins"), "{error}");

    let accepted = refused(&[&arguments[..], &["--accept-margins"]].concat());
    let error = String::from_utf8_lossy(&accepted.stderr);
    // A loop that rings may have latched a fault, but it was started.
    assert!(error.contains("accepted: "), "{error}");
    assert!(matches!(accepted.status.code(), Some(0 | 1)), "{error}");
    assert!(!accepted.stdout.is_empty(), "{error}");
}

#[test]
fn the_demo_shows_the_calibration_that_a_robot_comes_with() {
    let errors = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_torqued"));
        command.args([
            "demo",
            "--robot",
            "leg",
            "--fast",
            "--seconds",
            "12",
            "--json",
        ]);
        let out = command.args(more).output().expect("runs");
        let report: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
        assert_eq!((out.status.code(), &report["fault"]), (Some(0), &0.into()));
        let joints = report["joints"].as_array().expect("joints");
        let rms = |j: &serde_json::Value| j["encoder"]["rms"].as_f64().expect("a number");
        joints.iter().map(rms).collect::<Vec<f64>>()
    };
    let (nominal, calibrated) = (errors(&["--uncalibrated"]), errors(&[]));
    for (nominal, calibrated) in nominal.iter().zip(&calibrated) {
        assert!(
            *calibrated < 0.4 * nominal,
            "{calibrated} N·m, of data sheets {nominal}"
        );
    }
}

#[test]
fn the_humanoid_of_the_demo_bows_in_mode_stand() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_torqued"));
    let out = command.args(["demo", "--fast", "--seconds", "6", "--json"]);
    let out = out.output().expect("runs");
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
    assert_eq!((out.status.code(), &report["fault"]), (Some(0), &0.into()));
    let events = report["events"].as_object().expect("events");
    // A mode that is refused, or that ends, leaves a robot that only holds.
    assert!(
        events.keys().all(|event| event == "torque_limit"),
        "{events:?}"
    );
    let joints = report["joints"].as_array().expect("joints");
    let largest = |name: &str| {
        let joint = joints.iter().find(|joint| joint["name"] == name);
        joint.and_then(|joint| joint["largest_torque"].as_f64())
    };
    // Upright 5 N·m.
    for hip in ["left_hip_pitch", "right_hip_pitch"] {
        assert!(largest(hip) > Some(20.0), "{hip}: {:?} N·m", largest(hip));
    }
}

#[test]
fn the_demo_refuses_to_stand_without_a_floor() {
    let mut command = Command::new(env!("CARGO_BIN_EXE_torqued"));
    let out = command.args(["demo", "--fast", "--harness", "chest_pitch_link"]);
    let out = out.output().expect("runs");
    let error = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{error}");
    assert!(
        error.contains("--harness") && error.contains("--motion"),
        "{error}"
    );
}
