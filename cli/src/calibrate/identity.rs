//! Identity of a joint, by which a calibration belongs to it: wiring and data sheet of its encoders and motor.

use problem::Problem;
use robot_config::Robot;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

/// Keys of `[[joint]]`, and of its `[drive.NAME]`, on which a joint file's numbers depend.
const OF_JOINT: [&str; 4] = ["drive", "motor_angle", "link_angle", "current"];
const OF_DRIVE: [&str; 4] = [
    "gear_ratio",
    "torque_constant_Nm_per_A",
    "motor_counts_per_turn",
    "link_counts_per_turn",
];
/// The same of drives of prismatic joints.
const OF_SCREW: [&str; 2] = ["lead_mm_per_turn", "link_counts_per_mm"];
/// Keys of `[[ft_sensor]]` on which its offset and what is beyond it depend.
const OF_SENSOR: [&str; 6] = [
    "frame",
    "force",
    "torque",
    "sign",
    "calibration",
    "temperature_gain_per_K",
];

/// A robot as calibrations know it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Identity {
    /// The robot's name.
    pub(crate) robot: String,
    /// By joint: its keys and their values.
    pub(crate) joints: BTreeMap<String, Keys>,
    /// By F/T sensor.
    pub(crate) sensors: BTreeMap<String, Keys>,
    /// By kind of drive.
    pub(crate) drives: BTreeMap<String, Keys>,
}

/// Keys and their values.
pub(crate) type Keys = BTreeMap<String, String>;

impl Identity {
    /// Of a configuration's text.
    ///
    /// # Errors
    /// Text that is no configuration.
    pub(crate) fn new(text: &str, file: &str) -> Result<Self, Problem> {
        let table: toml::Table = toml::from_str(text)
            .map_err(|e| Problem::new(e.message(), "a robot's configuration").at(file, 0))?;
        let at = |path: [&str; 2]| table.get(path[0])?.get(path[1]);
        let shown =
            |value: Option<&toml::Value>| value.map_or_else(String::new, ToString::to_string);
        let rate = shown(at(["loop", "rate_hz"]));
        let mut joints = BTreeMap::new();
        let listed = table.get("joint").and_then(toml::Value::as_array);
        for joint in listed.into_iter().flatten() {
            let Some(name) = joint.get("name").and_then(toml::Value::as_str) else {
                continue;
            };
            let drive = joint.get("drive").and_then(toml::Value::as_str);
            let drive = drive.and_then(|drive| at(["drive", drive]));
            let own = OF_JOINT.map(|key| (key.to_owned(), shown(joint.get(key))));
            let value = |key: &str| drive.and_then(|drive| drive.get(key));
            let screw = OF_SCREW.into_iter().filter(|key| value(key).is_some());
            let of_drive = OF_DRIVE.into_iter().chain(screw);
            let of_drive = of_drive.map(|key| (key.to_owned(), shown(value(key))));
            let rate = ("rate_hz".to_owned(), rate.clone());
            joints.insert(
                name.to_owned(),
                own.into_iter().chain(of_drive).chain([rate]).collect(),
            );
        }
        let of = |table: Option<&toml::Value>, keys: &[&str]| -> Keys {
            let each = keys.iter();
            each.map(|key| ((*key).to_owned(), shown(table.and_then(|t| t.get(key)))))
                .collect()
        };
        let listed = table.get("ft_sensor").and_then(toml::Value::as_array);
        let sensors = listed.into_iter().flatten().filter_map(|sensor| {
            let name = sensor.get("name").and_then(toml::Value::as_str)?;
            Some((name.to_owned(), of(Some(sensor), &OF_SENSOR)))
        });
        let sensors = sensors.collect();
        let listed = table.get("drive").and_then(toml::Value::as_table);
        let drives = listed.into_iter().flatten();
        let drives = drives.map(|(name, drive)| (name.clone(), of(Some(drive), &OF_DRIVE)));
        let drives = drives.collect();
        Ok(Self {
            sensors,
            drives,
            robot: at(["robot", "name"])
                .and_then(toml::Value::as_str)
                .unwrap_or_default()
                .to_owned(),
            joints,
        })
    }

    /// A hash of one joint's keys; none if there is no such joint.
    pub(crate) fn hash(&self, joint: &str) -> Option<String> {
        hash(self.joints.get(joint))
    }

    /// The keys `sign` of a robot's F/T sensors, in its order.
    pub(crate) fn signs(&self, robot: &Robot) -> Vec<f64> {
        let sensors = robot.parameters.ft_sensors.iter();
        let sign = |name: &String| self.sensors.get(name)?.get("sign")?.parse().ok();
        sensors
            .map(|ft| sign(&ft.sensor.name).unwrap_or(1.0))
            .collect()
    }

    /// A hash of one F/T sensor's keys; none if there is no such sensor.
    pub(crate) fn of_sensor(&self, sensor: &str) -> Option<String> {
        hash(self.sensors.get(sensor))
    }

    /// A hash of the keys of one kind of drive; none if there is no such kind.
    pub(crate) fn of_drive(&self, drive: &str) -> Option<String> {
        hash(self.drives.get(drive))
    }

    /// Differences of another robot from this one, in words; empty for the same one.
    pub(crate) fn differences(&self, other: &Self) -> Vec<String> {
        let mut found = Vec::new();
        if self.robot != other.robot {
            found.push(format!("robot {:?}, not {:?}", other.robot, self.robot));
        }
        differences("joint", &self.joints, &other.joints, &mut found);
        differences("ft_sensor", &self.sensors, &other.sensors, &mut found);
        found
    }
}

fn hash(keys: Option<&Keys>) -> Option<String> {
    let keys = keys?;
    let mut digest = Sha256::new();
    for (key, value) in keys {
        digest.update(format!("{key}={value}\n"));
    }
    let bytes = digest.finalize();
    Some(bytes.iter().take(16).map(|b| format!("{b:02x}")).collect())
}

/// Differences of parts from others of the same names.
fn differences(
    kind: &str,
    ours: &BTreeMap<String, Keys>,
    theirs: &BTreeMap<String, Keys>,
    found: &mut Vec<String>,
) {
    for (name, keys) in ours {
        let Some(other) = theirs.get(name) else {
            found.push(format!("no {kind} {name:?}"));
            continue;
        };
        let differ = keys
            .iter()
            .filter(|(key, value)| other.get(*key) != Some(value));
        found.extend(differ.map(|(key, value)| {
            let other = other.get(key).map_or("", String::as_str);
            format!("{kind} {name}: {key} = {other}, not {value}")
        }));
    }
    let more = theirs.keys().filter(|name| !ours.contains_key(*name));
    found.extend(more.map(|name| format!("a {kind} {name:?} more")));
}
