//! `torquectl calibrate payload`: mass, centre of mass and inertia of what a link carries.

use super::loads::{Cuts, Reading};
use super::runs::{RecordedRun, urdf};
use super::sensors::channels;
use super::shown::with_interval;
use crate::output::{apart, finish_or_refuse};
use crate::reference::robot::with_payload;
use clap::{Args, ValueEnum};
use dynamics::{Inertia, Model};
use identification::drive::Value;
use identification::load::motion::Cut;
use identification::load::{Channel, Knowledge, Load, checks, identify};
use problem::{Problem, Problems, listed};
use robot_config::Robot;
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

const HELP: &str = "\
The recordings are the daemon's own, of the robot carrying the payload: poses that turn the link against
gravity by 60 degrees or more, each held for a second or two, or slow motion through them. Wrenches of the
F/T sensor before the link are used, or, without one, the torques of the joints before it, from encoders and
current. Recordings of the same robot without the payload (--empty) determine the offsets apart from it: then
one pose shows the mass. What the poses do not determine is named.

The result is printed as the option --payload of other commands takes it. -o writes the robot's URDF with the
payload as a link of its own, fixed to LINK.

Examples:
  torquectl calibrate payload run.mcap --link right_hand
  torquectl calibrate payload run.mcap --empty before.mcap --link flange -o with-gripper.urdf
  torquectl calibrate payload run.mcap --link flange --from joints --json

Exit codes:
  0  identified
  2  bad input: recordings that show no payload at this link, or do not determine its mass";

/// Standard deviations of a payload's mass and centre of mass before it is identified, kg and m.
const MASS_SIGMA: f64 = 2.0;
const CENTRE_SIGMA: f64 = 0.2;
/// Offset of a joint's torque before: its friction and hysteresis, share of the torque limit.
const JOINT_OFFSET: f64 = 0.05;
/// Deviation of a torque from encoders that its published one is not below, share of the torque limit.
const JOINT_SIGMA: f64 = 1e-3;
/// Standard deviations of half a 95 % interval.
const HALF_WIDTH: f64 = 1.96;

/// Identify a payload: mass, centre of mass and inertia
#[derive(Args)]
#[command(after_help = HELP)]
pub(super) struct PayloadArguments {
    /// Recordings of the robot with the payload
    #[arg(required = true, value_name = "RUN.mcap")]
    runs: Vec<PathBuf>,
    /// The link that carries it
    #[arg(long)]
    link: String,
    /// Recordings of the robot without it; may be repeated
    #[arg(long, value_name = "RUN.mcap")]
    empty: Vec<PathBuf>,
    /// Source to identify it from [default: the F/T sensor, where there is one before the link]
    #[arg(long, value_enum)]
    from: Option<From>,
    /// Nothing but the payload touched what is beyond, whatever the contact sets of the recordings say
    #[arg(long)]
    untouched: bool,
    /// Write the URDF with the payload
    #[arg(short, long, value_name = "FILE.urdf")]
    output: Option<PathBuf>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum From {
    Ft,
    Joints,
}

pub(super) fn run(arguments: &PayloadArguments) -> ExitCode {
    finish_or_refuse(payload(arguments))
}

fn payload(arguments: &PayloadArguments) -> Result<String, Problems> {
    if let Some(output) = &arguments.output {
        apart(output, &arguments.runs)?;
        apart(output, &arguments.empty)?;
    }
    let read = |paths: &[PathBuf]| -> Result<Vec<RecordedRun>, Problems> {
        paths
            .iter()
            .map(|path| RecordedRun::read(path, &[]))
            .collect()
    };
    let (runs, empty) = (read(&arguments.runs)?, read(&arguments.empty)?);
    let all: Vec<&RecordedRun> = runs.iter().chain(&empty).collect();
    super::everything::one_robot(&all, None)?;
    for run in &all {
        run.notes
            .iter()
            .for_each(|note| eprintln!("{}: {note}", run.file));
    }
    let robot = &runs[0].robot;
    let Some(carrier) = robot.model.frame_index(&arguments.link) else {
        let names = robot.model.frames().iter().map(|f| f.name.as_str());
        let reason = format!("--link: no link {:?}", arguments.link);
        return Err(Problem::new(reason, listed(names)).into());
    };
    let before = before(robot, carrier, arguments.from)?;
    let (cuts, channels, sensor) = (before.cuts, before.channels, before.sigma);
    let places: Vec<String> = cuts.iter().map(|(_, r)| name(robot, *r)).collect();
    let mass_beyond = cuts[0].0.mass_beyond(&robot.model);
    let cuts = Cuts {
        cuts,
        carrier,
        empty: &empty,
        untouched: arguments.untouched,
    };
    let gathered = cuts.samples(&runs)?;
    if let Some(sigma) = sensor {
        let loaded = |s: &&_| carries(s);
        let loaded: Vec<_> = gathered.samples.iter().filter(loaded).cloned().collect();
        checks::wiring(&loaded, None, sigma).map_err(|p| p.of(places[0].as_str()))?;
        if !empty.is_empty() {
            let without = Cuts {
                cuts: cuts.cuts.clone(),
                carrier,
                empty: &[],
                untouched: arguments.untouched,
            };
            let samples = without.samples(&empty)?.samples;
            checks::wiring(&samples, Some(mass_beyond), sigma)
                .map_err(|p| p.of(places[0].as_str()))?;
        }
    }
    let known = Knowledge {
        channels,
        inertia: Inertia::zero(),
        mass_sigma: MASS_SIGMA,
        centre_sigma: CENTRE_SIGMA,
        sensor: false,
        angle_sigma: 0.0,
    };
    let load = identify(&known, &gathered.samples, gathered.seconds)?;
    if !load.mass.determined {
        let reason = format!(
            "gravity turns by {:.0} degrees in the axes of {}: mass and offsets cannot be separated",
            load.turned.to_degrees(),
            arguments.link
        );
        let allowed = "poses that turn it by 60 degrees or more, or a recording without the payload (--empty)";
        return Err(Problem::new(reason, allowed).into());
    }
    if load.mass.value < 2.0 * load.mass.sigma {
        let reason = format!(
            "the recordings show no payload: {}",
            with_interval(interval(&load.mass))
        );
        return Err(
            Problem::new(reason, "a mass that the interval does not reach zero from").into(),
        );
    }
    let option = option(&arguments.link, &load);
    if let Some(path) = &arguments.output {
        let text = with_payload(urdf(&runs[0].header, robot), &arguments.link, &load.inertia);
        let name = path.display().to_string();
        Model::from_urdf(&text, &name, robot.model.base())?;
        terminal::write_file(path, &text)?;
    }
    Ok(if arguments.json {
        format!("{:#}\n", object(&load, &places, &option))
    } else {
        shown(&load, &places, &option)
    })
}

/// A sample of a run with the payload.
fn carries(sample: &identification::load::Sample) -> bool {
    sample
        .columns
        .iter()
        .any(|row| row.iter().any(|x| *x != 0.0))
}

/// Part of the robot before a link.
struct Before {
    cuts: Vec<(Cut, Reading)>,
    channels: Vec<Channel>,
    /// Deviation of a force, N, where it is a sensor.
    sigma: Option<f64>,
}

/// The nearest F/T sensor before a link, or the joints before it.
fn before(robot: &Robot, carrier: usize, from: Option<From>) -> Result<Before, Problem> {
    let model = &robot.model;
    let sensors = robot.parameters.ft_sensors.iter().enumerate();
    let cuts = sensors.filter_map(|(s, ft)| {
        let cut = Cut::before_link(model, model.frame_index(&ft.sensor.frame)?);
        cut.has_beyond(carrier).then_some((s, ft, cut))
    });
    // The nearest one has the least beyond it.
    let mass = |cut: &Cut| cut.mass_beyond(model);
    let nearest = cuts.min_by(|a, b| mass(&a.2).total_cmp(&mass(&b.2)));
    match (nearest, from) {
        (Some((s, ft, cut)), None | Some(From::Ft)) => {
            let sigma = ft.sensor.sigma_force;
            Ok(Before {
                cuts: vec![(cut, Reading::Sensor(s))],
                channels: channels(robot, ft),
                sigma: Some(sigma),
            })
        }
        (None, Some(From::Ft)) => {
            let reason = "--from ft: no F/T sensor is before this link";
            Err(Problem::new(reason, "--from joints"))
        }
        _ => {
            let joints = robot.parameters.joints.iter().enumerate();
            let (mut cuts, mut channels) = (Vec::new(), Vec::new());
            for (j, joint) in joints {
                let cut = Cut::at_joint(model, joint.model_index);
                if !cut.has_beyond(carrier) || !joint.has_link_encoder {
                    continue;
                }
                cuts.push((cut, Reading::Joint(j)));
                channels.push(Channel {
                    name: joint.name.clone(),
                    unit: "N·m",
                    sigma: JOINT_SIGMA * joint.limits.torque,
                    offset_sigma: JOINT_OFFSET * joint.limits.torque,
                });
            }
            if cuts.is_empty() {
                Err(Problem::new(
                    "no F/T sensor and no joint with a link-side encoder is before this link",
                    "a link that a joint moves",
                ))
            } else {
                Ok(Before {
                    cuts,
                    channels,
                    sigma: None,
                })
            }
        }
    }
}

fn name(robot: &Robot, reading: Reading) -> String {
    let p = &robot.parameters;
    match reading {
        Reading::Sensor(s) => format!("F/T sensor {}", p.ft_sensors[s].sensor.name),
        Reading::Joint(j) => format!("joint {}", p.joints[j].name),
    }
}

fn interval(value: &Value) -> [f64; 2] {
    [value.value, HALF_WIDTH * value.sigma]
}

/// As `--payload` takes it.
fn option(link: &str, load: &Load) -> String {
    let [x, y, z] = load.centre.map(|c| c.value);
    format!("{link}={:.4},{x:.4},{y:.4},{z:.4}", load.mass.value)
}

fn shown(load: &Load, places: &[String], option: &str) -> String {
    let mut text = format!(
        "from {}: {} samples, gravity turned by {:.0} degrees, condition number {:.0}\n",
        places.join(", "),
        load.samples,
        load.turned.to_degrees(),
        load.condition
    );
    let centre = load.centre.iter().map(|c| with_interval(interval(c)));
    let _ = writeln!(text, "mass    {} kg", with_interval(interval(&load.mass)));
    let _ = writeln!(text, "centre  {} m", centre.collect::<Vec<_>>().join(", "));
    if load.central.iter().all(|i| i.determined) {
        let each = load.central.iter().map(|i| with_interval(interval(i)));
        let each = each.collect::<Vec<_>>().join(", ");
        let _ = writeln!(text, "inertia about it, xx xy yy xz yz zz: {each} kg·m²");
    }
    if !load.undetermined.is_empty() {
        let _ = writeln!(text, "undetermined: {}", load.undetermined.join(", "));
    }
    for (unit, [_, tared, found]) in &load.rms {
        let _ = writeln!(
            text,
            "held out: RMS {found:.3} {unit}, by offsets alone {tared:.3} {unit}"
        );
    }
    let _ = writeln!(text, "--payload {option}");
    text
}

fn object(load: &Load, places: &[String], option: &str) -> serde_json::Value {
    let value = |v: &Value| {
        let [value, width] = interval(v);
        json!({"value": value, "interval": width, "determined": v.determined})
    };
    let rms = load.rms.iter().map(
        |(unit, [_, tared, found])| json!({"unit": unit, "offsets_alone": tared, "found": found}),
    );
    json!({
        "from": places,
        "mass_kg": value(&load.mass),
        "centre_m": load.centre.iter().map(value).collect::<Vec<_>>(),
        "inertia_kg_m2": load.central.iter().map(value).collect::<Vec<_>>(),
        "undetermined": load.undetermined,
        "condition": load.condition,
        "gravity_turned_deg": load.turned.to_degrees(),
        "samples": load.samples,
        "held_out_rms": rms.collect::<Vec<_>>(),
        "payload": option,
    })
}
