//! proven.toml: which joints have shown what, by which tables of the configuration.

use jiff::Timestamp;
use problem::Problem;
use robot_config::Robot;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

/// A joint's small motion, as it was seen; rad or m.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Proven {
    pub(crate) asked: f64,
    pub(crate) motor: f64,
    pub(crate) link: Option<f64>,
    /// What the current has shown, in words.
    pub(crate) current: &'static str,
}

impl Proven {
    pub(super) fn json(&self) -> Value {
        json!({
            "asked": self.asked,
            "by_motor_side_encoder": self.motor,
            "by_link_side_encoder": self.link,
            "current": self.current,
        })
    }
}

/// The file.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    joint: BTreeMap<String, Entry>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// Of the joint's table and its drive's.
    tables_sha256: String,
    /// Time of the proof.
    at: String,
    /// Way asked for, and those seen, rad or m.
    asked: f64,
    by_motor_side_encoder: f64,
    by_link_side_encoder: Option<f64>,
    current: String,
}

/// What a configuration's joints have shown so far.
pub(super) struct Proof {
    path: PathBuf,
    tables: toml::Table,
    file: File,
}

const NAME: &str = "proven.toml";
const HEAD: &str = "\
# Written by `torquectl prove`: joints that have moved as the configuration says.
# A joint counts while its table and its drive's are the ones of the hash.

";

fn path_beside(config: &Path) -> PathBuf {
    config.with_file_name(NAME)
}

fn read_file(path: &Path) -> Result<Option<File>, Problem> {
    let name = path.display().to_string();
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(Problem::unreadable(&name, &e)),
    };
    let parsed = toml::from_str(&text);
    parsed.map(Some).map_err(|e| {
        let reason = format!("is not what `torquectl prove` writes: {}", e.message());
        Problem::new(reason, "such a file, or none").at(name, 0)
    })
}

fn tables(config: &Path) -> Result<toml::Table, Problem> {
    let name = config.display().to_string();
    let text = terminal::read_text(&name).map_err(|e| Problem::unreadable(&name, &e))?;
    text.parse()
        .map_err(|_| Problem::new("is no TOML", "").at(name, 0))
}

/// Hash of the joint's table and of its drive's.
fn hash(tables: &toml::Table, joint: &str, drive: &str) -> String {
    let joints = tables.get("joint").and_then(toml::Value::as_array);
    let named =
        |table: &&toml::Value| table.get("name").and_then(toml::Value::as_str) == Some(joint);
    let joint = joints.and_then(|joints| joints.iter().find(named));
    let drive = tables.get("drive").and_then(|drives| drives.get(drive));
    let mut hash = Sha256::new();
    for part in [joint, drive] {
        hash.update(part.map(ToString::to_string).unwrap_or_default());
        hash.update([0]);
    }
    hash.finalize()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}

impl Proof {
    /// What is there already beside a configuration.
    pub(super) fn read(config: &Path) -> Result<Self, Problem> {
        let path = path_beside(config);
        Ok(Self {
            tables: tables(config)?,
            file: read_file(&path)?.unwrap_or_default(),
            path,
        })
    }

    pub(super) fn take(&mut self, robot: &Robot, j: usize, proven: &Proven) {
        let joint = &robot.parameters.joints[j];
        let entry = Entry {
            tables_sha256: hash(&self.tables, &joint.name, &joint.drive),
            at: Timestamp::now().to_string(),
            asked: proven.asked,
            by_motor_side_encoder: proven.motor,
            by_link_side_encoder: proven.link,
            current: proven.current.to_owned(),
        };
        self.file.joint.insert(joint.name.clone(), entry);
    }

    pub(super) fn write(&self) -> Result<(), Problem> {
        if self.file.joint.is_empty() {
            return Ok(());
        }
        let name = self.path.display().to_string();
        let text = toml::to_string(&self.file).unwrap_or_default();
        let written = std::fs::write(&self.path, format!("{HEAD}{text}"));
        written.map_err(|e| {
            Problem::new(format!("cannot be written: {e}"), "a folder that can").at(name, 0)
        })
    }
}

/// Joints of a robot that was proven once, and of which this no longer holds; none where it never was.
///
/// # Errors
/// A file that `torquectl prove` has not written.
pub(crate) fn outdated(config: &Path, robot: &Robot) -> Result<Vec<String>, Problem> {
    let Some(file) = read_file(&path_beside(config))? else {
        return Ok(Vec::new());
    };
    let tables = tables(config)?;
    let joints = robot.parameters.joints.iter();
    let holds = |name: &str, drive: &str| {
        let entry = file.joint.get(name);
        entry.is_some_and(|entry| entry.tables_sha256 == hash(&tables, name, drive))
    };
    let changed = joints.filter(|joint| !holds(&joint.name, &joint.drive));
    Ok(changed.map(|joint| joint.name.clone()).collect())
}
