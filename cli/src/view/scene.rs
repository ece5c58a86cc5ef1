//! What does not change from record to record: names, limits, and the robot's drawing.

use super::row::{JOINT_SIGNALS, LOOP_SIGNALS, width};
use problem::Problem;
use recording::Header;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::io;
use std::path::Path;
use torqued_client::robot_state::{Description, Event, Mode, RobotState};

/// URDF of a robot, and the links at whose frames its F/T sensors' wrenches are.
pub(super) struct Drawn {
    urdf: String,
    sensor_links: Vec<String>,
    /// Joints' limits, where no daemon describes them: torque, lowest and highest position.
    limits: Vec<[f64; 3]>,
}

/// What the page shows all of.
pub(super) struct Scene {
    pub(super) joints: usize,
    pub(super) sensors: usize,
    pub(super) json: Value,
}

impl Scene {
    /// Of a running robot.
    pub(super) fn of_robot(robot: &Description, drawn: Option<Drawn>, control: bool) -> Self {
        let joints = (0..robot.joint_count as usize).map(|j| {
            json!({
                "name": robot.joint_names[j].as_str(),
                "prismatic": robot.joint_kind(j).units("N·m") != "N·m",
                "torque_limit": robot.torque_limits[j],
                "position_min": robot.position_min[j],
                "position_max": robot.position_max[j],
            })
        });
        let sensors = robot.ft_names.iter().take(robot.ft_count as usize);
        let sensors = sensors.map(|name| name.as_str().to_owned());
        let base = json!({
            "robot": robot.robot.as_str(),
            "rate_hz": robot.rate_hz,
            "live": true,
            "control": control,
        });
        Self::new(base, joints.collect(), sensors.collect(), drawn.as_ref())
    }

    /// Of a recorded run.
    pub(super) fn of_run(header: &Header, drawn: Option<&Drawn>, base: Value) -> Self {
        let joints = header.joints.iter().zip(&header.kinds).enumerate();
        let joints = joints.map(|(j, (name, kind))| {
            let limits = drawn.and_then(|drawn| drawn.limits.get(j));
            json!({
                "name": name,
                "prismatic": kind.units("N·m") != "N·m",
                "torque_limit": limits.map(|l| l[0]),
                "position_min": limits.map(|l| l[1]),
                "position_max": limits.map(|l| l[2]),
            })
        });
        Self::new(base, joints.collect(), header.sensors.clone(), drawn)
    }

    fn new(
        mut base: Value,
        joints: Vec<Value>,
        sensors: Vec<String>,
        drawn: Option<&Drawn>,
    ) -> Self {
        let (count, sensor_count) = (joints.len(), sensors.len());
        let named = |name: &str, number: u32| (number.to_string(), Value::from(name));
        let states = RobotState::ALL.iter();
        let states = states.map(|s| named(s.name(), s.number())).collect();
        let modes = Mode::ALL.iter();
        let modes = modes.map(|m| named(m.name(), m.number())).collect();
        base["joints"] = joints.into();
        base["sensors"] = sensors.into();
        base["sensor_links"] = drawn.map_or(Value::Null, |d| d.sensor_links.clone().into());
        base["urdf"] = drawn.map_or(Value::Null, |d| d.urdf.clone().into());
        base["joint_signals"] = JOINT_SIGNALS.to_vec().into();
        base["loop_signals"] = LOOP_SIGNALS.to_vec().into();
        base["width"] = width(count, sensor_count).into();
        base["states"] = Value::Object(states);
        base["modes"] = Value::Object(modes);
        Self {
            joints: count,
            sensors: sensor_count,
            json: base,
        }
    }
}

/// The drawing of the robot that a configuration describes.
pub(super) fn drawn_from_files(config: &Path) -> Result<Drawn, Problem> {
    let read = |path: &str| terminal::read_text(path);
    drawn(&config.display().to_string(), &read)
}

/// The drawing of the robot whose configuration a recorded run has with it; none where it cannot be read.
pub(super) fn drawn_from_run(header: &Header) -> Option<Drawn> {
    let files: HashMap<&str, &str> = (header.files.iter())
        .map(|file| (file.path.as_str(), file.text.as_str()))
        .collect();
    let read = |path: &str| {
        let text = files.get(path).map(|text| (*text).to_owned());
        text.ok_or_else(|| io::Error::from(io::ErrorKind::NotFound))
    };
    drawn(&header.files.first()?.path, &read).ok()
}

fn drawn(path: &str, read: &dyn Fn(&str) -> io::Result<String>) -> Result<Drawn, Problem> {
    let robot = robot_config::load(path, read).map_err(|problems| {
        Problem::new(
            problems.to_string(),
            "a configuration that `torquectl check` passes",
        )
    })?;
    let urdf = read(&robot.parameters.urdf_path).map_err(|e| {
        Problem::new(e.to_string(), "a URDF").at(robot.parameters.urdf_path.clone(), 0)
    })?;
    let parameters = &robot.parameters;
    let sensors = parameters.ft_sensors.iter();
    let limits = parameters.joints.iter().map(|joint| {
        let limits = &joint.limits;
        [limits.torque, limits.position_min, limits.position_max]
    });
    Ok(Drawn {
        urdf,
        sensor_links: sensors.map(|ft| ft.sensor.frame.clone()).collect(),
        limits: limits.collect(),
    })
}

/// An event as the page lists it.
pub(super) fn event(t: f64, event: Event, subjects: &str, times: u64) -> Value {
    let reaction = event.reaction();
    json!({
        "t": t,
        "number": event.number(),
        "name": event.name(),
        "cause": event.cause(),
        "config_key": event.config_key(),
        "reaction": reaction.name(),
        "latches": reaction.latches(),
        "subject": subjects,
        "times": times,
    })
}
