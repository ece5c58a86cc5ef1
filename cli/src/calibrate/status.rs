//! `torquectl calibrate status`: which joints are calibrated, how old that is, and whether it still is of
//! this robot.

use super::adopt::Configuration;
use super::store::{Calibration, Manifest};
use crate::BAD_INPUT;
use crate::output::finish;
use crate::units::{cell, keys};
use clap::Args;
use jiff::Timestamp;
use problem::{Allowed, Problem, Problems};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::ExitCode;
use terminal::TextTable;
use torqued_client::robot_state::JointKind;

/// Exit code where a calibration is missing, old or of another robot.
const WANTED: u8 = 1;
const HOURS_A_DAY: f64 = 24.0;

const HELP: &str = "\
A calibration is old after --days, missing where a joint names no joint file, and of another robot where
drive, encoders, their directions and zeros, or the rate have changed since. F/T sensors and drives that no
calibration has are as configured, and so are joints that no joint file can be of, as they are without
a link-side encoder; where their keys are others than the calibration set, they are changed since.

Examples:
  torquectl calibrate status config/leg/robot.toml
  torquectl calibrate status config/leg/robot.toml --days 30 --json

Exit codes:
  0  every joint is calibrated, or as configured
  1  some are not, or their calibration is old or of another robot
  2  bad input: a configuration with problems";

/// Show what is calibrated, how old it is, and what is missing.
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct StatusArguments {
    /// The robot's configuration
    config: PathBuf,
    /// Age from which a calibration is old, days
    #[arg(long, default_value_t = 180.0, value_parser = days)]
    days: f64,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

fn days(text: &str) -> Result<f64, Problem> {
    const ALLOWED: Allowed = Allowed::Within(0.0, 36_500.0);
    let days = text.parse().ok().filter(|days| ALLOWED.admits(*days));
    days.ok_or_else(|| Problem::new("not a number of days", ALLOWED.to_string()))
}

/// The calibration of a joint, an F/T sensor or a kind of drive.
struct State {
    /// joint, ft_sensor, drive.
    kind: &'static str,
    name: String,
    /// calibrated, by hand, as configured, missing, old, changed since, of another robot.
    state: &'static str,
    made: String,
    /// Figures and remarks.
    held_out: Option<(f64, f64)>,
    /// Sources of a joint's torques.
    joint: JointKind,
    undetermined: Vec<String>,
}

pub(crate) fn run(arguments: &StatusArguments) -> ExitCode {
    let states = match states(arguments) {
        Ok(states) => states,
        Err(problems) => {
            eprintln!("{problems}");
            return ExitCode::from(BAD_INPUT);
        }
    };
    let text = if arguments.json {
        format!("{}\n", Value::Array(states.iter().map(object).collect()))
    } else {
        table(&states)
    };
    let good = states
        .iter()
        .all(|s| ["calibrated", "by hand", "as configured"].contains(&s.state));
    match (finish(&text), good) {
        (ExitCode::SUCCESS, false) => ExitCode::from(WANTED),
        (code, _) => code,
    }
}

fn states(arguments: &StatusArguments) -> Result<Vec<State>, Problems> {
    let configuration = Configuration::read(&arguments.config)?;
    let adopted = configuration.adopted()?;
    let joints = configuration.robot.parameters.joints.iter();
    let state = |joint: &robot_config::JointParameters| {
        let mut state = State {
            kind: "joint",
            name: joint.name.clone(),
            state: "missing",
            made: String::new(),
            held_out: None,
            undetermined: Vec::new(),
            joint: joint.kind,
        };
        let Some(file) = adopted.get(&joint.name) else {
            if !joint.has_link_encoder {
                state.state = "as configured";
            }
            return state;
        };
        let path = configuration.resolved(file);
        let folder = path.parent().map(Calibration::read);
        // A joint file that was fitted by hand stands in no calibration.
        let Some(Ok(calibration)) = folder else {
            state.state = "by hand";
            return state;
        };
        let manifest = calibration.manifest;
        let Some(entry) = manifest
            .joints
            .iter()
            .find(|entry| entry.name == joint.name)
        else {
            state.state = "by hand";
            return state;
        };
        let same = configuration.identity.hash(&joint.name).as_ref() == Some(&entry.identity);
        let old = age_days(&manifest.made).is_none_or(|age| age > arguments.days);
        state.state = match (same, old) {
            (false, _) => "of another robot",
            (true, true) => "old",
            (true, false) => "calibrated",
        };
        state.made.clone_from(&manifest.made);
        state.held_out = entry.held_out_rms.zip(entry.largest);
        state.undetermined.clone_from(&entry.undetermined);
        state
    };
    let mut all: Vec<State> = joints.map(state).collect();
    all.extend(others(&configuration, arguments.days)?);
    Ok(all)
}

/// F/T sensors and drives, by the newest calibration that has them.
fn others(configuration: &Configuration, days: f64) -> Result<Vec<State>, Problem> {
    let folders = configuration.committed();
    let read = folders.iter().rev().map(|folder| Calibration::read(folder));
    let manifests: Vec<Manifest> = read
        .flatten()
        .map(|calibration| calibration.manifest)
        .collect();
    let identity = &configuration.identity;
    let mut all = Vec::new();
    for ft in &configuration.robot.parameters.ft_sensors {
        let name = &ft.sensor.name;
        let found = manifests.iter().find_map(|manifest| {
            let own = manifest
                .sensors
                .iter()
                .find(|s| s.name == *name && s.why.is_none())?;
            Some((manifest, &own.identity, own.undetermined.clone()))
        });
        let same = |theirs: &String| identity.of_sensor(name).as_ref() == Some(theirs);
        let state = other("ft_sensor", name, found, same, (configuration, days))?;
        all.push(state);
    }
    for name in identity.drives.keys() {
        let found = manifests.iter().find_map(|manifest| {
            let own = manifest
                .drives
                .iter()
                .find(|d| d.name == *name && !d.keys.is_empty())?;
            Some((manifest, &own.identity, Vec::new()))
        });
        let same = |theirs: &String| identity.of_drive(name).as_ref() == Some(theirs);
        let state = other("drive", name, found, same, (configuration, days))?;
        all.push(state);
    }
    Ok(all)
}

fn other(
    kind: &'static str,
    name: &str,
    found: Option<(&Manifest, &String, Vec<String>)>,
    same: impl Fn(&String) -> bool,
    (configuration, days): (&Configuration, f64),
) -> Result<State, Problem> {
    let mut state = State {
        kind,
        name: name.to_owned(),
        state: "as configured",
        made: String::new(),
        held_out: None,
        undetermined: Vec::new(),
        joint: JointKind::default(),
    };
    let Some((manifest, identity, undetermined)) = found else {
        return Ok(state);
    };
    let mut unchanged = true;
    let prefix = format!("{kind}.{name}.");
    let settings = manifest.settings.iter();
    for (address, value) in settings.filter(|(address, _)| address.starts_with(&prefix)) {
        unchanged &= configuration.value(address)?.as_ref() == Some(value);
    }
    let old = age_days(&manifest.made).is_none_or(|age| age > days);
    state.state = match (same(identity), unchanged, old) {
        (false, ..) => "of another robot",
        (true, false, _) => "changed since",
        (true, true, true) => "old",
        (true, true, false) => "calibrated",
    };
    state.made.clone_from(&manifest.made);
    state.undetermined = undetermined;
    Ok(state)
}

fn age_days(made: &str) -> Option<f64> {
    let made: Timestamp = made.parse().ok()?;
    let age = Timestamp::now().duration_since(made);
    Some(age.as_secs_f64() / 3600.0 / HOURS_A_DAY)
}

fn object(state: &State) -> Value {
    let object = json!({
        "kind": state.kind,
        "name": state.name,
        "state": state.state,
        "made": state.made,
        "held_out_rms_Nm": state.held_out.map(|(rms, _)| rms),
        "largest_Nm": state.held_out.map(|(_, largest)| largest),
        "undetermined": state.undetermined,
    });
    keys(state.joint, object)
}

fn table(states: &[State]) -> String {
    let heading = ["", "state", "made", "held out RMS N·m", "%", "undetermined"];
    let mut cells = vec![heading.map(str::to_owned).to_vec()];
    for state in states {
        let [rms, share] = match state.held_out {
            Some((rms, largest)) => [
                cell(state.joint, format!("{rms:.3}"), "N·m"),
                format!("{:.2}", 100.0 * rms / largest.max(1e-9)),
            ],
            None => [String::new(), String::new()],
        };
        cells.push(vec![
            match state.kind {
                "joint" => state.name.clone(),
                kind => format!("{kind} {}", state.name),
            },
            state.state.to_owned(),
            state.made.clone(),
            rms,
            share,
            state.undetermined.join(", "),
        ]);
    }
    TextTable(cells).to_string()
}
