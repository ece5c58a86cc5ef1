//! `torquectl reference`: every joint's torque from the rigid-body model, for fits of joints that
//! have no torque sensor.

pub(crate) mod robot;
pub(crate) mod torques;

use crate::output::{apart, finish_or_refuse, read_input};
use crate::whole_body::of_robot::sensors_text;
use clap::Args;
use problem::{Problem, Problems};
use robot::{Payload, ReferenceRobot};
use std::fmt::Write as _;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use torques::{RobotLog, Torques};

/// Compute torque references of all joints from URDF, motion, F/T sensors and IMU
#[derive(Args)]
#[command(after_long_help = FORMAT)]
pub(crate) struct ReferenceArguments {
    /// The robot's URDF file
    #[arg(long)]
    urdf: PathBuf,
    /// The robot's sensors and contacts (TOML, see `torquectl whole-body --help`), or its robot.toml; without it the
    /// root link stands still, and nothing touches the robot
    #[arg(long)]
    sensors: Option<PathBuf>,
    /// Known payload: LINK=kg[,x,y,z], centre of mass in the link's frame, m
    #[arg(long)]
    payload: Vec<Payload>,
    /// The logs of the whole robot (CSV, see --help); each may have encoder zeros of its own
    #[arg(long = "log", required = true, num_args = 1..)]
    logs: Vec<PathBuf>,
    /// Window of the centred filters, ms
    #[arg(long, default_value_t = 20.0)]
    window_ms: f64,
    /// Write references though a channel is not what it claims to be, or an F/T sensor contradicts the part beyond it
    /// that nothing touches
    #[arg(long)]
    accept: bool,
    /// Folder for the references; made if it is not there
    #[arg(short, long)]
    out: PathBuf,
}

const FORMAT: &str = "\
The logs have columns t (s, at a steady rate) and, for every moving joint of the URDF,
  JOINT.q                   rad, as the URDF counts it; or, where the encoder's zero is unknown,
  JOINT.angle               the controller's angle, used by the model in place of q
  JOINT.theta, JOINT.i      rad and A, passed on, as is JOINT.tau_feedforward (N·m) where it is there
and SENSOR.fx .. SENSOR.tz of every F/T sensor (N, N·m, tared), imu.gx .. imu.az of the IMU (rad/s,
m/s^2). `torquectl import` writes such logs.

All signals pass the same centred filter, so the reference has no delay; it lacks what is faster than
the window: of windows from 10 to 80 ms, 20 ms left the least error on the simulated leg, whose
position-controlled gears swing at 10 to 20 Hz. Ends of a log without a full window are left out. Sigma holds the sensors' noise and the
model's masses, as the sensors' file states them (2 % without a file), the accelerations' noise, and
what the filter may have removed.

What an F/T sensor reads is compared with the weight and motion of the part beyond it that nothing
touches. A residual beyond three standard deviations (of noise and masses, 2 % at least) is refused
with the mistake that explains it: signs, axes of the base, order of the axes, offset, scale, turned axes,
another reference point, delay; --accept takes the log as it stands. Wraps of angles are taken out, samples
that no neighbour confirms bridged, each said; a reading that was kept is refused, so is a zero that is lost.

Writes OUT/LOG.JOINT.csv with t,theta,q,i,tau_sensor,sigma_sensor[,tau_feedforward] for joints with theta and i, and
OUT/LOG.torques.csv with JOINT.tau and JOINT.sigma of all. A reference is no better than masses,
payload and F/T offsets: a payload that is 1 % off makes it 1 % off.

Examples:
  torquectl reference --urdf arm.urdf --payload flange=3.5,0,0,0.08 --log logs/sweep.csv -o references
  torquectl reference --urdf leg.urdf --sensors leg.toml --log stand.csv walk.csv -o references
  torquectl fit all --joint knee.toml --no-load turn.csv --training references/stand.knee.csv -o fitted.toml";

pub(crate) fn run(arguments: &ReferenceArguments) -> ExitCode {
    finish_or_refuse(reference(arguments))
}

fn reference(arguments: &ReferenceArguments) -> Result<String, Problems> {
    let urdf = read_input(&arguments.urdf)?;
    let sensors = arguments.sensors.as_deref();
    let sensors = sensors.map(sensors_text).transpose()?;
    let robot = ReferenceRobot::new(
        (&urdf, &arguments.urdf.display().to_string()),
        sensors
            .as_ref()
            .map(|(text, file)| (text.as_str(), file.as_str())),
        &arguments.payload,
    )?;
    let mut files = Vec::new();
    let (mut report, mut problems) = (String::new(), Vec::new());
    for path in &arguments.logs {
        let log = RobotLog::read(path, arguments.accept)?;
        let signals = log.signals(&robot.joints, &robot.sensors)?;
        let window = 1e-3 * arguments.window_ms;
        let torques = Torques::new(&robot, &signals, window)?;
        let _ = writeln!(report, "{}: {} rows", path.display(), torques.rows().len());
        for (sensor, verdict) in torques::untouched(&robot, &signals, window)? {
            let name = robot.sensors.ft_sensors[sensor].name.get_ref();
            if let Some(problem) = verdict.problem(name).filter(|_| !arguments.accept) {
                problems.push(problem.at(path.display().to_string(), 0));
            }
            let _ = writeln!(report, "  F/T sensor {name}: {}", verdict.line());
        }
        let all = (0..robot.joints.len()).map(|joint| torques.of(joint));
        let all = all.collect::<Result<Vec<_>, _>>()?;
        for (of_joint, name) in all.iter().zip(&robot.joints) {
            let (low, high, sigma) = range(of_joint, torques.rows());
            let _ = writeln!(
                report,
                "  {name}: {low:.3} to {high:.3} N·m, sigma {sigma:.3} N·m RMS"
            );
        }
        let stem = path
            .file_stem()
            .map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        files.extend(texts(&robot, &log, (&all, torques.rows()), &stem));
    }
    if !problems.is_empty() {
        return Err(Problems(problems));
    }
    let unwritable = |e, path: &Path| Problem::unwritable(path.display(), &e);
    std::fs::create_dir_all(&arguments.out).map_err(|e| unwritable(e, &arguments.out))?;
    for (name, _) in &files {
        apart(&arguments.out.join(name), &arguments.logs)?;
    }
    for (name, text) in &files {
        let path = arguments.out.join(name);
        terminal::write_file(&path, text)?;
    }
    let _ = writeln!(
        report,
        "written: {} files in {}",
        files.len(),
        arguments.out.display()
    );
    Ok(report)
}

/// Torques of a joint and their sigmas, by row.
type OfJoint = [Vec<f64>; 2];

/// Smallest and largest torque of a joint, and its RMS sigma.
fn range([tau, sigma]: &OfJoint, rows: Range<usize>) -> (f64, f64, f64) {
    let (mut low, mut high, mut square, count) = (f64::MAX, f64::MIN, 0.0, rows.len());
    for i in rows {
        (low, high) = (low.min(tau[i]), high.max(tau[i]));
        square += sigma[i] * sigma[i];
    }
    (low, high, (square / count.max(1) as f64).sqrt())
}

/// The files of one log: names and texts.
fn texts(
    robot: &ReferenceRobot,
    log: &RobotLog,
    (torques, rows): (&[OfJoint], Range<usize>),
    stem: &str,
) -> Vec<(String, String)> {
    let mut all = "t".to_owned();
    robot.joints.iter().for_each(|name| {
        let _ = write!(all, ",{name}.tau,{name}.sigma");
    });
    all.push('\n');
    for i in rows.clone() {
        let _ = write!(all, "{}", log.t[i]);
        for [tau, sigma] in torques {
            let _ = write!(all, ",{},{}", tau[i], sigma[i]);
        }
        all.push('\n');
    }
    let mut files = vec![(format!("{stem}.torques.csv"), all)];
    for ([tau, sigma], name) in torques.iter().zip(&robot.joints) {
        let Some([theta, q, current]) = log.drive(name) else {
            continue;
        };
        let feed_forward = log.feed_forward(name);
        let further = feed_forward.map_or("", |_| ",tau_feedforward");
        let mut text = format!("t,theta,q,i,tau_sensor,sigma_sensor{further}\n");
        for i in rows.clone() {
            let _ = write!(
                text,
                "{},{},{},{},{},{}",
                log.t[i], theta[i], q[i], current[i], tau[i], sigma[i]
            );
            if let Some(model) = feed_forward {
                let _ = write!(text, ",{}", model[i]);
            }
            text.push('\n');
        }
        files.push((format!("{stem}.{name}.csv"), text));
    }
    files
}
