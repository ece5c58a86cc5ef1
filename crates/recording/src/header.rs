//! Header of a recorded run: the robot, the program, the configuration's files.

use std::collections::BTreeMap;
use std::io;

use problem::{Problem, Problems};
use robot_config::Robot;
use robot_state::{
    Content, Event, JointKind, MAX_FT_SENSORS, MAX_FURTHER_IMUS, MAX_JOINTS, Reference, Settings,
    SharedRecord, layout_hash,
};
use sha2::{Digest, Sha256};

use crate::compact::Counts;

/// Name of the metadata record in the file.
pub(crate) const METADATA: &str = "torqued";
/// The message's own layout; the records' layouts have hashes.
const MESSAGE_VERSION: u64 = 1;
/// Between names in one text.
const SEPARATOR: char = '\n';

/// A file of the robot's configuration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttachedFile {
    /// Its path, as the configuration's reader asked for it.
    pub path: String,
    /// Its text.
    pub text: String,
}

impl AttachedFile {
    /// SHA-256 of the text, hexadecimal.
    #[must_use]
    pub fn hash(&self) -> String {
        let digest = Sha256::digest(self.text.as_bytes());
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// How the run that was recorded had started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Start {
    /// The fault that was latched before the first cycle.
    pub fault: Option<Event>,
    /// Difference of Unix time and the cycles' stamps, ns.
    pub unix_offset_ns: i64,
}

/// Origin of a recorded run.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// The robot's name.
    pub robot: String,
    /// Version of the program that recorded.
    pub version: String,
    /// Period of the cycles, s.
    pub period_s: f64,
    /// Names of the joints, in the order of the records.
    pub joints: Vec<String>,
    /// Their kinds, and with them the units of what the records have of them.
    pub kinds: Vec<JointKind>,
    /// Names of the F/T sensors, in the order of the records.
    pub sensors: Vec<String>,
    /// Frames of the IMUs, in the order of the records.
    pub imus: Vec<String>,
    /// Names of the contact sets.
    pub contact_sets: Vec<String>,
    /// Names of the buses.
    pub buses: Vec<String>,
    /// How the run had started.
    pub start: Start,
    /// What is recorded of every cycle.
    pub content: Content,
    /// Cycles for each message of a recording of torques; 1 of any other one.
    pub every: u32,
    /// Occasion of a black box; none of any other recording.
    pub black_box: Option<Event>,
    /// The files of the configuration; the first is the one that names the others.
    pub files: Vec<AttachedFile>,
}

impl Header {
    /// Of a robot that was loaded from these files.
    #[must_use]
    pub fn new(robot: &Robot, files: Vec<AttachedFile>, start: Start) -> Self {
        let parameters = &robot.parameters;
        let sensors = parameters.ft_sensors.iter();
        Self {
            robot: parameters.name.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            period_s: parameters.timing.sample_period,
            joints: parameters.joints.iter().map(|j| j.name.clone()).collect(),
            kinds: parameters.joints.iter().map(|j| j.kind).collect(),
            sensors: sensors.map(|ft| ft.sensor.name.clone()).collect(),
            imus: (parameters.imus.iter())
                .map(|imu| imu.frame.clone())
                .collect(),
            contact_sets: (robot_config::contact_names(parameters).into_iter())
                .map(str::to_owned)
                .collect(),
            buses: parameters.buses.iter().map(|b| b.name.clone()).collect(),
            start,
            content: Content::All,
            every: 1,
            black_box: None,
            files,
        }
    }

    /// Joints and sensors.
    #[must_use]
    pub fn counts(&self) -> Counts {
        Counts {
            joints: self.joints.len(),
            sensors: self.sensors.len(),
            further_imus: self.imus.len().saturating_sub(1),
        }
    }

    /// The kind of a joint.
    #[must_use]
    pub fn kind(&self, joint: usize) -> JointKind {
        self.kinds.get(joint).copied().unwrap_or_default()
    }

    /// The text of the file at that path.
    #[must_use]
    pub fn text(&self, path: &str) -> Option<&str> {
        let file = self.files.iter().find(|file| file.path == path);
        file.map(|file| file.text.as_str())
    }

    /// That the recording holds what every cycle was given.
    ///
    /// # Errors
    /// It holds torques alone.
    pub fn demand_inputs(&self) -> Result<(), Problem> {
        match self.content {
            Content::All | Content::Frames => Ok(()),
            Content::Torques => Err(Problem::new(
                "the recording holds torques alone, not what they were computed from",
                "a recording with --content all or frames",
            )),
        }
    }

    /// Loads the robot from the recording's own files.
    ///
    /// # Errors
    /// Those of [`robot_config::load`]; the recording has no configuration.
    pub fn load_robot(&self) -> Result<Robot, Problems> {
        let Some(first) = self.files.first() else {
            let reason = "the recording has no configuration";
            return Err(Problem::new(reason, "a recording by torqued").into());
        };
        let read = |path: &str| {
            let text = self.text(path).map(str::to_owned);
            text.ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "not in the recording"))
        };
        robot_config::load(&first.path, &read)
    }

    /// A hash of the layouts of message and records: another one is of another version.
    #[must_use]
    pub fn layout() -> u64 {
        let layouts = [
            MESSAGE_VERSION,
            layout_hash::<SharedRecord>(),
            layout_hash::<Reference>(),
            layout_hash::<Settings>(),
        ];
        (layouts.into_iter()).fold(0, |hash: u64, own| hash.rotate_left(17) ^ own)
    }

    pub(crate) fn to_metadata(&self) -> BTreeMap<String, String> {
        let names = |names: &[String]| names.join(&SEPARATOR.to_string());
        let pairs = [
            ("layout", format!("{:016x}", Self::layout())),
            ("robot", self.robot.clone()),
            ("version", self.version.clone()),
            // As bits: the same number when read.
            ("period_bits", self.period_s.to_bits().to_string()),
            ("joints", names(&self.joints)),
            (
                "joint_kinds",
                names(
                    &self
                        .kinds
                        .iter()
                        .map(|kind| kind.name().to_owned())
                        .collect::<Vec<_>>(),
                ),
            ),
            ("sensors", names(&self.sensors)),
            ("imus", names(&self.imus)),
            ("contact_sets", names(&self.contact_sets)),
            ("buses", names(&self.buses)),
            (
                "start_fault",
                self.start.fault.map_or(0, Event::number).to_string(),
            ),
            ("unix_offset_ns", self.start.unix_offset_ns.to_string()),
            ("content", self.content.name().to_owned()),
            ("every", self.every.to_string()),
            (
                "black_box",
                self.black_box.map_or(0, Event::number).to_string(),
            ),
            (
                "files",
                names(
                    &self
                        .files
                        .iter()
                        .map(|f| f.path.clone())
                        .collect::<Vec<_>>(),
                ),
            ),
        ];
        let own = pairs.map(|(key, value)| (key.to_owned(), value));
        let hashes = self.files.iter();
        let hashes = hashes.map(|file| (format!("sha256 {}", file.path), file.hash()));
        own.into_iter().chain(hashes).collect()
    }

    /// The header, still without the files' texts, and the layout's hash; `None` if something is
    /// missing.
    pub(crate) fn from_metadata(metadata: &BTreeMap<String, String>) -> Option<(Self, u64)> {
        let text = |key: &str| metadata.get(key).cloned();
        let names = |key: &str| -> Option<Vec<String>> {
            let names = metadata.get(key)?.split(SEPARATOR);
            Some(
                names
                    .filter(|name| !name.is_empty())
                    .map(str::to_owned)
                    .collect(),
            )
        };
        let fault: u32 = text("start_fault")?.parse().ok()?;
        let black_box = text("black_box").and_then(|number| number.parse().ok());
        let files = names("files")?;
        let (joints, sensors, imus) = (names("joints")?, names("sensors")?, names("imus")?);
        let most = 1 + MAX_FURTHER_IMUS;
        if joints.len() > MAX_JOINTS || sensors.len() > MAX_FT_SENSORS || imus.len() > most {
            return None;
        }
        // Runs without kinds are of robots whose joints are all revolute.
        let kind = |name: &String| {
            let named = |kind: &JointKind| kind.name() == name;
            JointKind::ALL.into_iter().find(named).unwrap_or_default()
        };
        let kinds = names("joint_kinds").unwrap_or_default();
        let header = Self {
            kinds: kinds.iter().map(kind).collect(),
            robot: text("robot")?,
            version: text("version")?,
            period_s: f64::from_bits(text("period_bits")?.parse().ok()?),
            joints,
            sensors,
            imus,
            contact_sets: names("contact_sets")?,
            buses: names("buses")?,
            start: Start {
                fault: Event::from_number(fault),
                unix_offset_ns: text("unix_offset_ns")?.parse().ok()?,
            },
            // Runs without it hold everything.
            content: text("content")
                .map_or(Some(Content::All), |name| Content::from_name(&name))?,
            every: text("every").map_or(Some(1), |n| n.parse().ok().filter(|n| *n > 0))?,
            black_box: black_box.and_then(Event::from_number),
            files: (files.into_iter())
                .map(|path| AttachedFile {
                    path,
                    text: String::new(),
                })
                .collect(),
        };
        Some((
            header,
            u64::from_str_radix(metadata.get("layout")?, 16).ok()?,
        ))
    }
}
