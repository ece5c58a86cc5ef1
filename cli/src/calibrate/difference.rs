//! `torquectl calibrate diff`: parameters of two calibrations side by side, with their intervals.

use super::adopt::Configuration;
use super::sensors::carrier;
use super::store::Calibration;
use crate::output::finish_or_refuse;
use clap::Args;
use joint_file::JointFile;
use problem::{Problem, Problems};
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use terminal::TextTable;

const HELP: &str = "\
A and B are each a folder of `torquectl calibrate` or a robot's configuration. Intervals are 95 %;
a difference that both intervals together do not cover is marked.

Examples:
  torquectl calibrate diff config/leg/robot.toml calibrated
  torquectl calibrate diff calibrated-monday calibrated-friday --json";

/// Compare two calibrations, parameter by parameter.
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct DiffArguments {
    /// A folder of joint files, or a configuration
    a: PathBuf,
    /// Another one
    b: PathBuf,
    /// Only this joint, F/T sensor or kind of drive; may be repeated
    #[arg(long, value_name = "NAME")]
    part: Vec<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &DiffArguments) -> ExitCode {
    finish_or_refuse(difference(arguments))
}

/// A parameter and half the width of its 95 % interval; none where the file has none.
type Known = (f64, Option<f64>);

/// Standard deviations of half a 95 % interval.
const HALF_WIDTH: f64 = 1.96;

fn difference(arguments: &DiffArguments) -> Result<String, Problems> {
    let [mut a, mut b] = [parts(&arguments.a)?, parts(&arguments.b)?];
    // A configuration has every part; a calibration only those that it is of.
    if !arguments.a.is_dir() {
        a.retain(|name, _| b.contains_key(name) || !name.contains(' '));
    }
    if !arguments.b.is_dir() {
        b.retain(|name, _| a.contains_key(name) || !name.contains(' '));
    }
    let mut names: Vec<&String> = a.keys().chain(b.keys()).collect();
    names.sort();
    names.dedup();
    let is = |name: &str, part: &str| name.rsplit(' ').next() == Some(part);
    let unknown = |part: &&String| !names.iter().any(|name| is(name, part));
    if let Some(unknown) = arguments.part.iter().find(unknown) {
        let known = problem::listed(names.iter().map(|name| name.as_str()));
        return Err(Problem::new(format!("--part: there is no part {unknown:?}"), known).into());
    }
    names.retain(|name| {
        arguments.part.is_empty() || arguments.part.iter().any(|part| is(name, part))
    });
    let mut out = String::new();
    let mut all = serde_json::Map::new();
    for name in names {
        let (old, new) = (a.get(name), b.get(name));
        let missing = |file: &Path| format!("{name}: not in {}\n", file.display());
        match (old, new) {
            (None, _) => out += &missing(&arguments.a),
            (_, None) => out += &missing(&arguments.b),
            (Some(old), Some(new)) => {
                let _ = writeln!(out, "{name}\n{}", table(old, new));
            }
        }
        let value = |known: Option<&Parameters>| {
            known.map(|all| {
                let each = all.iter().map(|(key, (value, width))| {
                    (key.clone(), json!({"value": value, "interval": width}))
                });
                serde_json::Value::Object(each.collect())
            })
        };
        all.insert(name.clone(), json!({"a": value(old), "b": value(new)}));
    }
    Ok(if arguments.json {
        format!("{}\n", serde_json::Value::Object(all))
    } else {
        out
    })
}

/// Parameters by name and unit.
type Parameters = BTreeMap<String, Known>;

/// The parts of a folder or a configuration.
fn parts(path: &Path) -> Result<BTreeMap<String, Parameters>, Problems> {
    let named = |all: BTreeMap<&'static str, Known>| -> Parameters {
        all.into_iter()
            .map(|(key, x)| (key.to_owned(), x))
            .collect()
    };
    if path.is_dir() {
        let calibration = Calibration::read(path)?;
        let manifest = &calibration.manifest;
        let mut all = BTreeMap::new();
        for joint in &manifest.joints {
            let Some((file, text)) = joint
                .file
                .as_ref()
                .and_then(|f| Some((f, calibration.files.get(f)?)))
            else {
                continue;
            };
            let shown = path.join(file).display().to_string();
            let file = JointFile::parse(text, &shown, &|path| terminal::read_text(path))?;
            all.insert(joint.name.clone(), named(parameters(&file)));
        }
        for sensor in manifest.sensors.iter().filter(|s| s.why.is_none()) {
            let values = sensor
                .mass
                .iter()
                .chain(&sensor.centre)
                .chain(&sensor.offset);
            let known = values.map(|[value, width]| (*value, Some(*width)));
            let keys = OF_SENSOR.map(str::to_owned).into_iter();
            all.insert(
                format!("F/T sensor {}", sensor.name),
                keys.zip(known).collect(),
            );
        }
        for drive in manifest.drives.iter().filter(|d| !d.keys.is_empty()) {
            let keys = drive.keys.iter();
            let known = keys.map(|key| (key.address.clone(), (key.value[0], Some(key.value[1]))));
            all.insert(format!("drive {}", drive.name), known.collect());
        }
        return Ok(all);
    }
    let configuration = Configuration::read(path)?;
    let robot = &configuration.robot;
    let joints = robot.parameters.joints.iter();
    let mut all: BTreeMap<String, Parameters> = joints
        .filter_map(|j| {
            Some((
                j.name.clone(),
                named(parameters(j.calibration.as_ref()?.file())),
            ))
        })
        .collect();
    let signs = configuration.identity.signs(robot);
    for (ft, sign) in robot.parameters.ft_sensors.iter().zip(signs) {
        let link = carrier(&robot.model, &ft.sensor.frame);
        let Some(link) = link.map(|k| &robot.model.frames()[k]) else {
            continue;
        };
        let centre = link.inertia.center();
        let offset = ft.conditioning.offset.map(|x| sign * x);
        let values = [link.inertia.mass]
            .into_iter()
            .chain(centre.iter().copied())
            .chain(offset);
        let keys = OF_SENSOR.map(str::to_owned).into_iter();
        all.insert(
            format!("F/T sensor {}", ft.sensor.name),
            keys.zip(values.map(|x| (x, None))).collect(),
        );
    }
    for name in configuration.identity.drives.keys() {
        let mut own = Parameters::new();
        for key in OF_DRIVE {
            let address = format!("drive.{name}.{key}");
            if let Some(value) = configuration.value(&address)?.and_then(|v| v.as_float()) {
                own.insert(address, (value, None));
            }
        }
        all.insert(format!("drive {name}"), own);
    }
    Ok(all)
}

/// Parameters of an F/T sensor, in their order.
const OF_SENSOR: [&str; 10] = [
    "mass beyond kg",
    "its centre x m",
    "its centre y m",
    "its centre z m",
    "offset fx N",
    "offset fy N",
    "offset fz N",
    "offset tx N·m",
    "offset ty N·m",
    "offset tz N·m",
];
/// Keys of a drive that recordings show.
const OF_DRIVE: [&str; 7] = [
    "rotor_inertia_kg_m2",
    "friction.coulomb_Nm",
    "friction.viscous_Nms_per_rad",
    "motor.K_tau_rad_per_Nm",
    "motor.K_v_s",
    "motor.dead_zone_rad",
    "motor.integral_time_ms",
];

/// Compared values of a joint, by name and unit.
fn parameters(joint: &JointFile) -> BTreeMap<&'static str, Known> {
    let mut all = BTreeMap::new();
    // The standard deviation of a parameter is the root of its directions' squares.
    let width = |directions: &[Vec<f64>], at: usize| {
        let entries = directions.iter().filter_map(|d| d.get(at));
        (!directions.is_empty()).then(|| HALF_WIDTH * entries.map(|x| x * x).sum::<f64>().sqrt())
    };
    if let Some(gear) = &joint.hysteresis {
        let directions = &gear.uncertainty;
        let springs =
            gear.wind_up.len() + gear.slipping.len() + gear.creeping.len() + gear.bearing.len();
        let (viscous, skew) = (2 + springs, 4 + springs);
        all.insert("stiffness N·m/rad", (gear.linear, width(directions, 0)));
        let friction: f64 = gear
            .bearing
            .iter()
            .map(|(limit, stiffness)| limit * stiffness)
            .sum();
        all.insert("bearing friction N·m", (friction, None));
        all.insert(
            "bearing viscous N·m·s/rad",
            (gear.bearing_viscous, width(directions, viscous)),
        );
        let hysteresis: f64 = gear
            .slipping
            .iter()
            .map(|(limit, stiffness)| limit * stiffness)
            .sum();
        all.insert("hysteresis N·m", (hysteresis, None));
        let encoders = joint.encoders.clone().unwrap_or_default();
        let per_ms = width(directions, skew).map(|w| 1e3 * w);
        all.insert("skew ms", (1e3 * encoders.skew, per_ms));
        let error = joint.kinematic_error.clone().unwrap_or_default();
        let micro = |at: usize| width(directions, at).map(|w| 1e6 * w);
        all.insert("zero urad", (1e6 * error.a0, micro(skew + 1)));
        let first = |list: &[(f64, f64)]| list.first().map_or(0.0, |(a, b)| 1e6 * a.hypot(*b));
        all.insert(
            "link's first harmonic urad",
            (first(&error.link), micro(skew + 2)),
        );
        all.insert(
            "motor's first harmonic urad",
            (first(&error.motor), micro(skew + 6)),
        );
    }
    if let Some(current) = &joint.current {
        let directions = &current.uncertainty;
        all.insert(
            "torque per current N·m/A",
            (current.k_1, width(directions, 0)),
        );
        all.insert("motor friction N·m", (current.k_3, width(directions, 3)));
        all.insert(
            "motor viscous N·m·s/rad",
            (current.k_2, width(directions, 2)),
        );
        all.insert("friction under load", (current.k_4, width(directions, 5)));
        all.insert(
            "rotor inertia kg·m²",
            (current.inertia, width(directions, 4)),
        );
        all.insert("current offset A", (current.offset, None));
    }
    all
}

fn table(a: &Parameters, b: &Parameters) -> String {
    let heading = ["", "A", "±", "B", "±", ""];
    let mut cells = vec![heading.map(str::to_owned).to_vec()];
    let mut keys: Vec<_> = a.keys().chain(b.keys()).collect();
    keys.sort();
    keys.dedup();
    for key in keys {
        let shown = |known: Option<&Known>| match known {
            None => ["-".to_owned(), String::new()],
            Some((value, width)) => [number(*value), width.map_or_else(String::new, number)],
        };
        let (old, new) = (a.get(key.as_str()), b.get(key.as_str()));
        let beyond = match (old, new) {
            (Some((a, Some(wide_a))), Some((b, Some(wide_b)))) => {
                (a - b).abs() > wide_a.hypot(*wide_b)
            }
            _ => false,
        };
        let mut row = vec![key.to_string()];
        row.extend(shown(old).into_iter().chain(shown(new)));
        row.push(if beyond { "differs" } else { "" }.to_owned());
        cells.push(row);
    }
    TextTable(cells).to_string()
}

/// Four significant digits.
fn number(x: f64) -> String {
    let digits = if x == 0.0 {
        0.0
    } else {
        x.abs().log10().floor()
    };
    let decimals = (3.0 - digits).clamp(0.0, 8.0) as usize;
    format!("{x:.decimals$}")
}
