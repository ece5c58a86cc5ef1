//! `torquectl calibrate diff`: parameters of two calibrations side by side, with their intervals.

use super::adopt::Configuration;
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
A and B are each a folder of `torquectl calibrate joints` or a robot's configuration. Intervals are 95 %;
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
    /// Only this joint; may be repeated
    #[arg(long, value_name = "NAME")]
    joint: Vec<String>,
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
    let [a, b] = [joints(&arguments.a)?, joints(&arguments.b)?];
    let mut names: Vec<&String> = a.keys().chain(b.keys()).collect();
    names.sort();
    names.dedup();
    if let Some(unknown) = arguments.joint.iter().find(|name| !names.contains(name)) {
        let known = problem::listed(names.iter().map(|name| name.as_str()));
        return Err(Problem::new(format!("--joint: there is no joint {unknown:?}"), known).into());
    }
    names.retain(|name| arguments.joint.is_empty() || arguments.joint.contains(name));
    let mut out = String::new();
    let mut all = serde_json::Map::new();
    for name in names {
        let [old, new] = [a.get(name), b.get(name)].map(|joint| joint.map(parameters));
        let missing = |file: &Path| format!("{name}: not in {}\n", file.display());
        match (&old, &new) {
            (None, _) => out += &missing(&arguments.a),
            (_, None) => out += &missing(&arguments.b),
            (Some(old), Some(new)) => {
                let _ = writeln!(out, "{name}\n{}", table(old, new));
            }
        }
        let value = |known: &Option<BTreeMap<&'static str, Known>>| {
            known.as_ref().map(|all| {
                let each = all.iter().map(|(key, (value, width))| {
                    (
                        (*key).to_owned(),
                        json!({"value": value, "interval": width}),
                    )
                });
                serde_json::Value::Object(each.collect())
            })
        };
        all.insert(name.clone(), json!({"a": value(&old), "b": value(&new)}));
    }
    Ok(match arguments.json {
        true => format!("{}\n", serde_json::Value::Object(all)),
        false => out,
    })
}

/// The joint files of a folder or a configuration.
fn joints(path: &Path) -> Result<BTreeMap<String, JointFile>, Problems> {
    if path.is_dir() {
        let calibration = Calibration::read(path)?;
        let parsed = calibration.manifest.joints.iter().filter_map(|joint| {
            let file = joint.file.as_ref()?;
            let shown = path.join(file).display().to_string();
            let text = calibration.files.get(file)?;
            Some(
                JointFile::parse(text, &shown, &|path| std::fs::read_to_string(path))
                    .map(|file| (joint.name.clone(), file)),
            )
        });
        return Ok(parsed.collect::<Result<_, _>>()?);
    }
    let configuration = Configuration::read(path)?;
    let joints = configuration.robot.parameters.joints.into_iter();
    Ok(joints
        .filter_map(|j| Some((j.name, j.calibration?)))
        .collect())
}

/// What is compared, by name and unit.
fn parameters(joint: &JointFile) -> BTreeMap<&'static str, Known> {
    let mut all = BTreeMap::new();
    // The standard deviation of a parameter is the root of its directions' squares.
    let width = |directions: &[Vec<f64>], at: usize| {
        let entries = directions.iter().filter_map(|d| d.get(at));
        (!directions.is_empty()).then(|| HALF_WIDTH * entries.map(|x| x * x).sum::<f64>().sqrt())
    };
    if let Some(gear) = &joint.hysteresis {
        let directions = &gear.uncertainty;
        let springs = gear.wind_up.len() + gear.slipping.len() + gear.bearing.len();
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

fn table(a: &BTreeMap<&'static str, Known>, b: &BTreeMap<&'static str, Known>) -> String {
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
        let (old, new) = (a.get(*key), b.get(*key));
        let beyond = match (old, new) {
            (Some((a, Some(wide_a))), Some((b, Some(wide_b)))) => {
                (a - b).abs() > wide_a.hypot(*wide_b)
            }
            _ => false,
        };
        let mut row = vec![(*key).to_owned()];
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
