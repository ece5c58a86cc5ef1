//! A robot's configuration: TOML, URDF and DBC files to validated parameters in SI units.
//!
//! Inside there are no degrees, counts or file names. Every problem is reported with its file, its
//! line, its key and what is allowed, as many at once as are independent. Files are read through
//! the function that the caller hands over, and in no other way.
#![deny(unsafe_code)]

mod contacts;
mod drives;
mod external_torque;
pub mod feed_forward;
mod filters;
mod frames;
mod general;
mod joints;
mod liveness;
mod parameters;
mod paths;
mod reader;
mod recorder;
mod safety;
mod sampling;
mod sensors;
mod settings;
pub mod slots;
mod standing;
mod tare;
pub mod torque_loops;
mod units;
mod well_posed;
mod whole_body;
mod wiring;

pub use joints::{hold_loop, motor_side_loop, predictive_loop};
pub use parameters::*;
pub use problem::{Problem, Problems};
pub use sampling::{Sampled, Sampling};
pub use settings::{Setting, Source};
pub use whole_body::{FilterGains, contact_names, whole_body_parameters};

use can_codec::{Frame, Table};
pub use drives_of_makers::canopen::bring_up::Plan;
use drives_of_makers::family::translation::Actuator;
use dynamics::{Base, Model};
use reader::{Diagnostics, Section};
use toml::de::DeTable;
use wiring::Wiring;

/// A robot, ready to run.
#[derive(Debug, Clone)]
pub struct Robot {
    /// The configuration's parameters, in SI units.
    pub parameters: Parameters,
    /// The rigid bodies.
    pub model: Model,
    /// From received frames to the receive [`slots`].
    pub receive: Table,
    /// From the send [`slots`] to sent frames.
    pub send: Table,
    /// The frames that start a cycle, one for each bus.
    pub sync: Vec<Frame>,
    /// Drives whose frames no DBC file describes; CANopen drives are set up before the first cycle.
    pub nodes: Nodes,
}

/// Drives of a robot whose frames no DBC file describes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Nodes {
    /// The set-up of each CANopen drive.
    pub plans: Vec<Plan>,
    /// Actuators with frames of their makers' own.
    pub actuators: Vec<Actuator>,
    /// Shortest time after which a CANopen drive counts the daemon as lost, s.
    pub heartbeat: f64,
    /// All of them as bought and mounted.
    pub mounted: Vec<MountedDrive>,
}

impl Robot {
    /// For each message of the receive table: true if a cycle waits for it after SYNC, because it
    /// carries a signal that is sampled at SYNC.
    #[must_use]
    pub fn answers(&self) -> Vec<bool> {
        let p = &self.parameters;
        let answered = |slot: usize| match slots::source(slot) {
            slots::Source::Imu(i) => p.imus.get(i).is_none_or(|imu| imu.sampling.answers()),
            slots::Source::Ft(s) => p.ft_sensors.get(s).is_none_or(|ft| ft.sampling.answers()),
            slots::Source::Joint(j) => p.joints.get(j).is_none_or(|j| j.sampling.answers()),
        };
        (0..self.receive.message_count())
            .map(|message| {
                let mut slots = self.receive.slots(message);
                slots.any(|slot| !slots::is_reported(slot) && answered(slot))
            })
            .collect()
    }
}

/// Reads the text of the file at a path.
pub type Read<'a> = &'a dyn Fn(&str) -> std::io::Result<String>;

/// Access to the files that the configuration names.
struct Files<'a> {
    config: &'a str,
    read: Read<'a>,
}

/// Loads the configuration at `path` and the files that it names, each through `read`.
///
/// # Errors
/// Every problem that keeps the robot from being described completely, in the order of files and
/// lines.
pub fn load(path: &str, read: Read<'_>) -> Result<Robot, Problems> {
    load_with_settings(path, read).map(|(robot, _)| robot)
}

/// As [`load`]; also every key that was asked for, with its value and where that comes from.
///
/// # Errors
/// As [`load`].
pub fn load_with_settings(path: &str, read: Read<'_>) -> Result<(Robot, Vec<Setting>), Problems> {
    let text = read(path).map_err(|error| unreadable(path, &error))?;
    let diagnostics = Diagnostics::new(path, &text);
    let (table, errors) = DeTable::parse_recoverable(&text);
    for error in &errors {
        let place = error.span().map_or(0, |span| span.start);
        diagnostics.at(place, error.message().replace('\n', ", "), "TOML");
    }
    let robot = if errors.is_empty() {
        robot(
            &diagnostics,
            Section::root(&diagnostics, table.get_ref()),
            path,
            read,
        )
    } else {
        None
    };
    let any = diagnostics.any();
    let settings = diagnostics.take_settings();
    robot
        .filter(|_| !any)
        .map(|robot| (robot, settings))
        .ok_or_else(|| Problems(diagnostics.into_problems()))
}

fn robot(
    diagnostics: &Diagnostics<'_>,
    root: Section<'_, '_>,
    path: &str,
    read: Read<'_>,
) -> Option<Robot> {
    let named = general::robot(&root, path);
    let timing = general::timing(&root);
    let buses = general::buses(&root, path);
    let filters = filters::filters(&root, timing.sample_period);
    let feedback = general::feedback(&root, timing.sample_period);
    let cross_check = general::cross_check(&root);
    let safety = safety::safety(&root, timing.sample_period);
    let files = Files { config: path, read };
    let drives = drives::read(&root, timing.sample_period, &files);

    let model = named.as_ref().and_then(|named| {
        general::read_file(diagnostics, &root, "robot", &named.urdf_path, read)
            .and_then(|urdf| model(diagnostics, &urdf, &named.urdf_path, named.base))
    });
    let mut wiring = Wiring::read(diagnostics, &root, &buses, read);
    let surroundings = joints::Surroundings {
        drives: &drives,
        model: model.as_ref(),
        timing: &timing,
        feedback: &feedback,
        files: &files,
    };
    let joints = joints::read(&root, &surroundings, &mut wiring);
    let ft_sensors = sensors::ft_sensors(&root, timing.sample_period, &mut wiring);
    let imus = sensors::imus(&root, timing.sample_period, &mut wiring);
    let sound = model.as_ref().filter(|_| !diagnostics.any());
    let frames = frames::read(&root, sound, &joints, &ft_sensors);
    let whole_body = contacts::whole_body(&root, &ft_sensors);
    let external_torque = external_torque::external_torque(&root, timing.sample_period);
    let tare = tare::tare(&root, timing.sample_period);
    let recorder = recorder::recorder(&root, timing.sample_period);
    let tables = wiring.compile();
    let nodes = wiring.take_nodes();
    let (readable, again) = (!diagnostics.any(), root.again());
    root.finish();

    let (named, model) = (named?, model?);
    let (receive, send, sync) = tables?;
    let mut parameters = Parameters {
        name: named.name,
        urdf_path: named.urdf_path,
        base: named.base,
        timing,
        buses: buses.into_iter().map(|bus| bus.parameters).collect(),
        filters,
        whole_body,
        external_torque,
        tare,
        cross_check,
        safety,
        torque_law: feedback.torque_law,
        k_f: feedback.k_f,
        motion: feedback.motion,
        modes: feedback.modes,
        joints,
        ft_sensors,
        imus,
        frames,
        recorder,
    };
    if readable {
        joints::choose_designs(&mut parameters);
    }
    joints::choose_feedback(&mut parameters);
    if readable {
        joints::check_torque_source(&again, &parameters);
        well_posed::check(&again, &model, &parameters);
    }
    Some(Robot {
        parameters,
        model,
        receive,
        send,
        sync,
        nodes,
    })
}

fn model(diagnostics: &Diagnostics<'_>, urdf: &str, path: &str, base: Base) -> Option<Model> {
    Model::from_urdf(urdf, &paths::shown(path), base)
        .map_err(|problem| diagnostics.note(problem))
        .ok()
}

fn unreadable(path: &str, error: &std::io::Error) -> Problem {
    Problem {
        file: paths::shown(path),
        line: 0,
        reason: format!("cannot be read: {error}"),
        allowed: "a readable text file in UTF-8".to_owned(),
    }
}
