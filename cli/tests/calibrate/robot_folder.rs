//! A robot's files in a folder of their own: commands run there, recordings made there, torques judged.

use cycle::ClientInput;
use plant::{CanRobot, SimParameters};
use robot_state::torque_flags::VALID;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use test_support::{project_path, read_project_file};
use torqued::bus::LockStep;
use torqued::bus::in_process::{VirtualClock, VirtualDeadline};
use torqued::control_loop::ControlLoop;
use torqued::demo::{self, DemoClient, DemoOptions, Motion};
use torqued::real_time::Pace;

/// A folder with copies of a robot's files, as they lie in the project.
pub(crate) fn folder(test: &str, robot: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("calibrate-{test}"));
    let _ = fs::remove_dir_all(&folder);
    for part in [format!("config/{robot}"), format!("robot-models/{robot}")] {
        fs::create_dir_all(folder.join(&part)).unwrap();
        for entry in fs::read_dir(project_path(&part)).unwrap() {
            let entry = entry.unwrap();
            if entry.file_type().unwrap().is_file() {
                fs::copy(entry.path(), folder.join(&part).join(entry.file_name())).unwrap();
            }
        }
    }
    folder
}

pub(crate) fn torquectl(folder: &Path, arguments: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .unwrap()
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that must end with this exit code; gives what it printed.
pub(crate) fn expect(folder: &Path, arguments: &str, code: i32) -> String {
    let output = torquectl(folder, arguments);
    let both = text(&output.stdout) + &text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments}\n{both}");
    both
}

/// A recording of a robot in a motion.
pub(crate) fn record(folder: &Path, robot: &str, motion: &str, seconds: f64, name: &str) {
    let at = |path: &str| folder.join(path);
    fs::write(at("motion.toml"), motion).unwrap();
    demo::run(&DemoOptions {
        robot: at(&format!("config/{robot}/robot.toml"))
            .display()
            .to_string(),
        uncalibrated: false,
        seconds,
        plot: None,
        joints: Vec::new(),
        json: true,
        fast: true,
        seed: Some(5),
        motion: Some(at("motion.toml")),
        harness: None,
        record: Some(at(name)),
    })
    .map_err(|failure| failure.message)
    .unwrap();
}

/// RMS of the encoder torque's error in the demo's own motion, N·m; the same over its sigma; largest torque.
pub(crate) fn judge(folder: &Path, seconds: f64) -> [f64; 3] {
    judge_of(folder, "test-joint", seconds)
}

/// The same of the first joint of a robot.
pub(crate) fn judge_of(folder: &Path, name: &str, seconds: f64) -> [f64; 3] {
    let read = |path: &str| fs::read_to_string(folder.join(path));
    let robot = robot_config::load(&format!("config/{name}/robot.toml"), &read).unwrap();
    let sim = read(&format!("config/{name}/sim.toml")).unwrap();
    let mut sim = SimParameters::parse(&sim, "").unwrap();
    sim.seed = 5;
    let urdf = read(&robot.parameters.urdf_path).unwrap();
    let clock = VirtualClock::new();
    let bus = LockStep::new(CanRobot::new(&robot, &urdf, &sim).unwrap(), &clock);
    let mut control_loop = ControlLoop::new(&robot, bus).unwrap();
    let motion = read_project_file(&test_support::judged_motion(name)).unwrap();
    let joints = robot.parameters.joints.iter();
    let joints: Vec<_> = joints
        .map(|joint| (joint.name.clone(), joint.kind))
        .collect();
    let motion = Motion::parse(&motion, "", &joints).unwrap();
    let mut client = DemoClient::new(&robot, motion);
    let mut pace = VirtualDeadline::new(&clock, 1_000_000);
    let (mut sums, mut largest, mut count) = ([0.0; 2], 0.0f64, 0.0);
    for _ in 0..(1e3 * seconds) as u64 {
        let input = ClientInput {
            reference: Some(client.reference()),
            ..ClientInput::default()
        };
        let record = control_loop.run_cycle(&pace.wait(), &input);
        client.observe(record);
        let estimate = record.cycle.estimated.joints[0].tau_encoder;
        let truth = control_loop.bus().peer().truth().joints[0].tau;
        largest = largest.max(truth.abs());
        if estimate.flags & VALID != 0 {
            let error = estimate.tau - truth;
            sums[0] += error * error;
            sums[1] += (error / estimate.sigma).powi(2);
            count += 1.0;
        }
    }
    let [rms, ratio] = sums.map(|sum| f64::sqrt(sum / count));
    [rms, ratio, largest]
}
