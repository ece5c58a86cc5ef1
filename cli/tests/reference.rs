//! `torquectl reference` as a whole process, judged on the simulated leg and humanoid against their
//! true torques: masses of every link off by 1 %, noise and bias of the F/T sensors, IMU and
//! encoders on, contacts as stated.

use dynamics::Base;
use plant::{Plan, SimParameters, SimRobot};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use test_support::{project_path, read_project_file, read_with_drives_always_on};

fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("reference-{test}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

fn torquectl(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Logs a robot whose joints swing about their start; its truth, by joint and row.
struct Swing {
    log: String,
    joints: Vec<String>,
    truth: Vec<Vec<f64>>,
    sensors: String,
    urdf: String,
}

impl Swing {
    fn new(robot: &str, seconds: f64, contacts: &str, swing: impl Fn(&str, f64) -> f64) -> Self {
        let path = format!("config/{robot}/robot.toml");
        let robot_file = robot_config::load(&path, &read_with_drives_always_on).unwrap();
        let sim_path = format!("config/{robot}/sim.toml");
        let sim = SimParameters::parse(&read_project_file(&sim_path).unwrap(), &sim_path).unwrap();
        let p = &robot_file.parameters;
        let urdf_text = read_project_file(&p.urdf_path).unwrap();
        let plan = Plan::of(&robot_file).unwrap();
        let mut plant = SimRobot::new(&plan, &urdf_text, &p.urdf_path, &sim).unwrap();
        let joints: Vec<String> = plan.joints.iter().map(|j| j.name.clone()).collect();
        let start: Vec<f64> = (0..joints.len()).map(|j| plant.set_point(j)).collect();
        let mut log = "t".to_owned();
        for joint in &joints {
            write!(log, ",{joint}.theta,{joint}.q,{joint}.i,{joint}.true").unwrap();
        }
        for ft in &p.ft_sensors {
            let name = &ft.sensor.name;
            for axis in ["fx", "fy", "fz", "tx", "ty", "tz"] {
                write!(log, ",{name}.{axis}").unwrap();
            }
        }
        if !plant.readings().imus.is_empty() {
            log += ",imu.gx,imu.gy,imu.gz,imu.ax,imu.ay,imu.az";
        }
        log.push('\n');
        let mut truth = vec![Vec::new(); joints.len()];
        for k in 0..(seconds / plan.period) as usize {
            let t = k as f64 * plan.period;
            let begun = (t / 1.5).min(1.0);
            for (j, name) in joints.iter().enumerate() {
                plant.command(j, start[j] + begun * begun * swing(name, t));
            }
            plant.advance();
            let r = plant.readings();
            write!(log, "{:.3}", t).unwrap();
            for (j, truth) in r.joints.iter().zip(&plant.truth().joints) {
                write!(log, ",{},{},{},{}", j.theta, j.q, j.current, truth.tau).unwrap();
            }
            let six = r.ft.iter().flat_map(|w| w.to_array());
            for x in six.chain(r.imus.iter().flatten().copied()) {
                write!(log, ",{x}").unwrap();
            }
            log.push('\n');
            for (of_joint, joint) in truth.iter_mut().zip(&plant.truth().joints) {
                of_joint.push(joint.tau);
            }
        }
        // The sensors as the robot's data sheet has them; masses within 1 %.
        let mut sensors = "model_sigma_per_cent = 1\n".to_owned();
        match (p.base, p.imus.first()) {
            (Base::Floating, Some(imu)) => {
                let frame = &imu.frame;
                let noise = "sigma_m_per_s2 = 0.02\nsigma_rad_per_s2 = 0.05";
                writeln!(sensors, "[imu]\nframe = \"{frame}\"\n{noise}").unwrap();
            }
            _ => writeln!(sensors, "[fixed_base]\nlink = \"base_link\"").unwrap(),
        }
        for ft in &p.ft_sensors {
            let (name, frame) = (&ft.sensor.name, &ft.sensor.frame);
            writeln!(
                sensors,
                "[[ft_sensor]]\nname = \"{name}\"\nframe = \"{frame}\"\nsigma_N = {}\nsigma_Nm = {}",
                ft.sensor.sigma_force, ft.sensor.sigma_torque
            )
            .unwrap();
        }
        sensors += contacts;
        Self {
            log,
            joints,
            truth,
            sensors,
            urdf: project_path(&p.urdf_path),
        }
    }

    /// Runs the command; for each joint RMS torque, RMS error, RMS of error over sigma.
    fn judge(&self, test: &str) -> Vec<(String, [f64; 3])> {
        let folder = folder(test);
        fs::write(folder.join("swing.csv"), &self.log).unwrap();
        fs::write(folder.join("sensors.toml"), &self.sensors).unwrap();
        let arguments = [
            "reference",
            "--urdf",
            &self.urdf,
            "--sensors",
            "sensors.toml",
            "--log",
            "swing.csv",
            "-o",
            "out",
        ];
        let output = torquectl(&folder, &arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{errors}");
        let text = fs::read_to_string(folder.join("out/swing.torques.csv")).unwrap();
        let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        let rows: Vec<Vec<f64>> = text
            .lines()
            .skip(1)
            .map(|line| line.split(',').map(|x| x.parse().unwrap()).collect())
            .collect();
        let figures = |(name, truth): (&String, &Vec<f64>)| {
            let at = header
                .iter()
                .position(|h| *h == format!("{name}.tau"))
                .unwrap();
            let mut sums = [0.0; 3];
            for row in &rows {
                let truth = truth[(1e3 * row[0]).round() as usize];
                let error = row[at] - truth;
                sums[0] += truth * truth;
                sums[1] += error * error;
                sums[2] += (error / row[at + 1]).powi(2);
            }
            (
                name.clone(),
                sums.map(|sum| (sum / rows.len() as f64).sqrt()),
            )
        };
        assert!(
            rows.len() + 200 > self.truth[0].len(),
            "ends alone are left out"
        );
        let of_knee = folder.join(format!("out/swing.{}.csv", self.joints[0]));
        let of_knee = fs::read_to_string(of_knee).unwrap();
        assert!(of_knee.starts_with("t,theta,q,i,tau_sensor,sigma_sensor\n"));
        self.joints.iter().zip(&self.truth).map(figures).collect()
    }
}

/// Every joint: an error small beside its torque (what is left is the gears' swinging at 10 to 20 Hz,
/// which the window damps), and a sigma that covers it.
fn assert_covered(figures: &[(String, [f64; 3])], floor: f64) {
    let table: String = figures
        .iter()
        .map(|(name, [rms, error, ratio])| {
            format!("{name}: {rms:.3} N·m RMS, error {error:.4} N·m, error / sigma {ratio:.2}\n")
        })
        .collect();
    let ratios = figures.iter().map(|(_, [.., ratio])| *ratio);
    let worst = ratios.clone().fold(0.0, f64::max);
    let mut sorted: Vec<f64> = ratios.collect();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    for (name, [rms, error, _]) in figures {
        assert!(*error < 0.1 * rms + floor, "{name}\n{table}");
    }
    assert!(worst < 2.0, "covered\n{table}");
    assert!(median > 0.2, "sigma is no excuse\n{table}");
}

#[test]
fn a_leg_on_a_stand() {
    let contacts = "[[contact]]\nlink = \"base_link\"\ntype = \"full_wrench\"\n\
                    [[contact]]\nlink = \"foot\"\ntype = \"none\"\n";
    let swing = |name: &str, t: f64| {
        let pace = 0.25 + 0.03 * name.len() as f64;
        0.25 * (TAU * pace * t).sin() + 0.03 * (TAU * 2.0 * t).sin()
    };
    let leg = Swing::new("leg", 10.0, contacts, swing);
    assert_covered(&leg.judge("leg"), 0.02);

    // Nothing touches the foot: its sensor cannot have the other sign.
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("reference-leg");
    let reversed = leg
        .sensors
        .replace("[[ft_sensor]]\n", "[[ft_sensor]]\nsign = -1\n");
    fs::write(folder.join("sensors.toml"), reversed).unwrap();
    let mut arguments = vec![
        "reference",
        "--urdf",
        &leg.urdf,
        "--sensors",
        "sensors.toml",
    ];
    arguments.extend(["--log", "swing.csv", "-o", "reversed"]);
    let output = torquectl(&folder, &arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{errors}");
    assert!(
        errors.contains("explained if all six signs are reversed"),
        "{errors}"
    );
    assert!(!folder.join("reversed").exists());
    arguments.push("--accept");
    assert!(torquectl(&folder, &arguments).status.success());
}

#[test]
fn a_humanoid_on_its_feet() {
    let contacts: String = [
        ("left_foot", "full_wrench"),
        ("right_foot", "full_wrench"),
        ("left_hand", "none"),
        ("right_hand", "none"),
        ("chest_pitch_link", "none"),
    ]
    .iter()
    .map(|(link, kind)| format!("[[contact]]\nlink = \"{link}\"\ntype = \"{kind}\"\n"))
    .collect();
    let swing = |name: &str, t: f64| {
        let arm = ["shoulder", "elbow", "wrist"]
            .iter()
            .any(|part| name.contains(part));
        let pace = 0.3 + 0.02 * name.len() as f64;
        if arm {
            0.2 * (TAU * pace * t).sin()
        } else {
            0.0
        }
    };
    let figures = Swing::new("humanoid", 6.0, &contacts, swing).judge("humanoid");
    assert_covered(&figures, 0.1);
}

#[test]
fn bad_input_is_named() {
    let folder = folder("bad");
    let urdf = project_path("robot-models/test-joint/robot.urdf");
    let joint = "joint";
    let mut log = format!("t,{joint}.q\n");
    for k in 0..400 {
        writeln!(
            log,
            "{},{}",
            1e-3 * f64::from(k),
            (1e-2 * f64::from(k)).sin()
        )
        .unwrap();
    }
    let refused = |log: &str, more: &[&str], expected: &str| {
        fs::write(folder.join("run.csv"), log).unwrap();
        let arguments = [
            "reference",
            "--urdf",
            &urdf,
            "--log",
            "run.csv",
            "-o",
            "out",
        ];
        let output = torquectl(&folder, &[&arguments[..], more].concat());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{expected}: {message}");
        assert!(message.contains(expected), "{expected}\n{message}");
        assert!(!folder.join("out").exists());
    };
    refused(
        &log.replace(".q", ".p"),
        &[],
        "run.csv:1: column `joint.q` is missing",
    );
    refused(&log.replacen("\n0.2,", "\n0.2005,", 1), &[], "is not 0.001");
    refused(
        &log,
        &["--window-ms", "900"],
        "a window of 900.0 ms on 400 rows",
    );
    refused(&log, &["--payload", "link=-1"], "a mass > 0");
    refused(&log, &["--payload", "nowhere=1"], "no link \"nowhere\"");
    fs::write(folder.join("run.csv"), &log).unwrap();
    let arguments = [
        "reference",
        "--urdf",
        &urdf,
        "--log",
        "run.csv",
        "-o",
        "out",
    ];
    let output = torquectl(&folder, &arguments);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}
