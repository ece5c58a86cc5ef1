//! What makes a joint the one that a calibration is of: wiring and data sheet of its encoders and motor.

use problem::Problem;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

/// Keys of `[[joint]]`, and of its `[drive.NAME]`, on which a joint file's numbers depend.
const OF_JOINT: [&str; 4] = ["drive", "motor_angle", "link_angle", "current"];
const OF_DRIVE: [&str; 5] = [
    "gear_ratio",
    "torque_constant_Nm_per_A",
    "rotor_inertia_kg_m2",
    "motor_counts_per_turn",
    "link_counts_per_turn",
];

/// A robot as calibrations know it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Identity {
    /// The robot's name.
    pub(crate) robot: String,
    /// By joint: its keys and their values.
    pub(crate) joints: BTreeMap<String, BTreeMap<String, String>>,
}

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
            let of_drive = OF_DRIVE.map(|key| {
                (
                    key.to_owned(),
                    shown(drive.and_then(|drive| drive.get(key))),
                )
            });
            let rate = ("rate_hz".to_owned(), rate.clone());
            joints.insert(
                name.to_owned(),
                own.into_iter().chain(of_drive).chain([rate]).collect(),
            );
        }
        Ok(Self {
            robot: at(["robot", "name"])
                .and_then(toml::Value::as_str)
                .unwrap_or_default()
                .to_owned(),
            joints,
        })
    }

    /// A hash of one joint's keys; none if there is no such joint.
    pub(crate) fn hash(&self, joint: &str) -> Option<String> {
        let keys = self.joints.get(joint)?;
        let mut digest = Sha256::new();
        for (key, value) in keys {
            digest.update(format!("{key}={value}\n"));
        }
        let bytes = digest.finalize();
        Some(bytes.iter().take(16).map(|b| format!("{b:02x}")).collect())
    }

    /// Differences of another robot from this one, in words; empty for the same one.
    pub(crate) fn differences(&self, other: &Self) -> Vec<String> {
        let mut found = Vec::new();
        if self.robot != other.robot {
            found.push(format!("robot {:?}, not {:?}", other.robot, self.robot));
        }
        for (name, keys) in &self.joints {
            let Some(theirs) = other.joints.get(name) else {
                found.push(format!("no joint {name:?}"));
                continue;
            };
            let differ = keys
                .iter()
                .filter(|(key, value)| theirs.get(*key) != Some(value));
            found.extend(differ.map(|(key, value)| {
                let other = theirs.get(key).map_or("", String::as_str);
                format!("joint {name}: {key} = {other}, not {value}")
            }));
        }
        let more = other
            .joints
            .keys()
            .filter(|name| !self.joints.contains_key(*name));
        found.extend(more.map(|name| format!("a joint {name:?} more")));
        found
    }
}
