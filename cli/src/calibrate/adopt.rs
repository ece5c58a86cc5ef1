//! A calibration becomes a robot's own: its files beside the configuration, the keys of the configuration
//! that it sets, and the way back.

use super::identity::Identity;
use super::store::Calibration;
use jiff::Timestamp;
use problem::{Problem, Problems};
use robot_config::Robot;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Folder of calibrations beside a configuration.
const FOLDER: &str = "calibrations";
/// The file in an adopted folder that says what the keys were before.
const BEFORE: &str = "before.toml";
/// Its name after a rollback.
const TAKEN_BACK: &str = "taken-back.toml";
/// Key of a joint that names its joint file.
const OF_JOINT: &str = "calibration";
/// Address of the key that names the URDF.
const URDF: &str = "robot.urdf";

/// A robot's configuration as a text that is changed.
pub(crate) struct Configuration {
    pub(crate) path: PathBuf,
    text: String,
    pub(crate) robot: Robot,
    pub(crate) identity: Identity,
}

/// Values of keys by their address, as TOML; none where there is no such key.
///
/// An address is `table.key`, with a part's name behind the table for tables that are lists:
/// `joint.knee.calibration`, `ft_sensor.ankle.offset`, `drive.knee.motor.K_v_s`.
pub(crate) type Values = BTreeMap<String, Option<String>>;

/// Values of the keys before a commit.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Before {
    /// File name of the configuration.
    config: String,
    /// Keys that there were not.
    absent: Vec<String>,
    /// Keys that there were.
    was: BTreeMap<String, String>,
}

/// Where a key's value stands in a text, or where a new key of the same part may be put.
enum Place {
    Value(Range<usize>),
    Line(usize),
}

impl Configuration {
    /// Reads a configuration.
    ///
    /// # Errors
    /// Everything that is wrong with it.
    pub(crate) fn read(path: &Path) -> Result<Self, Problems> {
        let shown = path.to_string_lossy();
        let robot = robot_config::load(&shown, &|path| terminal::read_text(path))?;
        let text = terminal::read_text(path).map_err(|e| Problem::unreadable(&shown, &e))?;
        Ok(Self {
            identity: Identity::new(&text, &shown)?,
            path: path.to_path_buf(),
            text,
            robot,
        })
    }

    /// The keys `calibration`, by joint.
    pub(crate) fn adopted(&self) -> Result<BTreeMap<String, String>, Problem> {
        let mut all = BTreeMap::new();
        for joint in &self.robot.parameters.joints {
            let address = format!("joint.{}.{OF_JOINT}", joint.name);
            if let Some(file) = self
                .value(&address)?
                .and_then(|v| v.as_str().map(str::to_owned))
            {
                all.insert(joint.name.clone(), file);
            }
        }
        Ok(all)
    }

    /// A key's value.
    pub(crate) fn value(&self, address: &str) -> Result<Option<toml::Value>, Problem> {
        let raw = match place(&self.text, address).map_err(|p| self.in_file(p))? {
            Some(Place::Value(span)) => &self.text[span],
            _ => return Ok(None),
        };
        let parsed: toml::Table = toml::from_str(&format!("x = {raw}"))
            .map_err(|e| self.in_file(Problem::new(e.message(), "")))?;
        Ok(parsed.get("x").cloned())
    }

    fn in_file(&self, problem: Problem) -> Problem {
        problem.or_at(&self.path.display().to_string(), 0)
    }

    /// A path that a key names.
    pub(crate) fn resolved(&self, file: &str) -> PathBuf {
        self.folder().join(file)
    }

    fn folder(&self) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).to_path_buf()
    }

    /// The calibrations that were committed to this configuration and not taken back, the newest last.
    pub(crate) fn committed(&self) -> Vec<PathBuf> {
        let own = |folder: &PathBuf| {
            let text = terminal::read_text(folder.join(BEFORE)).ok();
            let before = text.and_then(|text| toml::from_str::<Before>(&text).ok());
            before.is_some_and(|before| before.config == self.file_name())
        };
        let entries = std::fs::read_dir(self.folder().join(FOLDER));
        let entries = entries.into_iter().flatten().flatten();
        let mut folders: Vec<PathBuf> = entries.map(|e| e.path()).filter(own).collect();
        // Names are dates, and numbers behind them.
        folders.sort();
        folders
    }

    fn file_name(&self) -> String {
        let name = self.path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// The text with other values, and what these keys were before.
    fn with(&self, values: &Values) -> Result<(String, Before), Problem> {
        let mut text = self.text.clone();
        let mut before = Before {
            config: self.file_name(),
            absent: Vec::new(),
            was: BTreeMap::new(),
        };
        for (address, wanted) in values {
            let key = address.rsplit('.').next().unwrap_or(address);
            match (place(&text, address)?, wanted) {
                (Some(Place::Value(span)), wanted) => {
                    before
                        .was
                        .insert(address.clone(), text[span.clone()].to_owned());
                    match wanted {
                        Some(value) => text.replace_range(span, value),
                        None => {
                            let begin = text[..span.start].rfind('\n').map_or(0, |at| at + 1);
                            let end = text[span.end..].find('\n');
                            let end = end.map_or(text.len(), |at| span.end + at + 1);
                            text.replace_range(begin..end, "");
                        }
                    }
                }
                (Some(Place::Line(at)), Some(value)) => {
                    before.absent.push(address.clone());
                    text.insert_str(at, &format!("\n{key} = {value}"));
                }
                (Some(Place::Line(_)), None) => before.absent.push(address.clone()),
                (None, _) => {
                    let reason = format!("there is no place for {address}");
                    return Err(self.in_file(Problem::new(reason, "a part of this robot")));
                }
            }
        }
        Ok((text, before))
    }

    /// Writes the configuration, at once, if it is sound.
    fn write(&self, text: &str) -> Result<(), Problems> {
        let own = self.path.to_string_lossy();
        robot_config::load(&own, &|path| {
            if path == own {
                Ok(text.to_owned())
            } else {
                terminal::read_text(path)
            }
        })?;
        Ok(terminal::write_file(&self.path, text)?)
    }
}

/// Where an address stands in a text; none where there is no such part.
fn place(text: &str, address: &str) -> Result<Option<Place>, Problem> {
    let table = DeTable::parse(text).map_err(|e| Problem::new(e.message(), ""))?;
    let Some((kind, rest)) = address.split_once('.') else {
        return Ok(None);
    };
    let (path, key) = rest.rsplit_once('.').unwrap_or(("", rest));
    let Some(part) = table.get_ref().get(kind).map(Spanned::get_ref) else {
        return Ok(None);
    };
    let (part, line) = match part {
        DeValue::Array(list) => {
            let named = list.iter().find_map(|entry| {
                let name = entry.get_ref().as_table()?.get("name")?;
                (name.get_ref().as_str()? == path).then(|| (entry.get_ref(), name.span()))
            });
            let line = |span: Range<usize>| {
                text[span.end..]
                    .find('\n')
                    .map_or(text.len(), |at| span.end + at)
            };
            match named {
                Some((entry, span)) => (Some(entry), Some(line(span))),
                None => (None, None),
            }
        }
        table => (descend(table, path), None),
    };
    let Some(part) = part else {
        return Ok(None);
    };
    let value = part.as_table().and_then(|table| table.get(key));
    Ok(match value {
        Some(value) => Some(Place::Value(value.span())),
        None => line.map(Place::Line),
    })
}

/// The table at a path of keys, which may have dots themselves.
fn descend<'v, 't>(value: &'v DeValue<'t>, path: &str) -> Option<&'v DeValue<'t>> {
    if path.is_empty() {
        return Some(value);
    }
    value.as_table()?.iter().find_map(|(key, inner)| {
        let rest = path.strip_prefix(key.get_ref().as_ref())?;
        match rest.strip_prefix('.') {
            Some(rest) => descend(inner.get_ref(), rest),
            None => rest.is_empty().then(|| inner.get_ref()),
        }
    })
}

/// Adopts a calibration: its files go into a dated folder beside the configuration, whose keys then name
/// them. Gives the folder.
///
/// # Errors
/// A calibration of another robot, or one without any result; files that cannot be written. The old
/// calibration stays then.
pub(crate) fn commit(config: &Path, folder: &Path) -> Result<PathBuf, Problems> {
    let configuration = Configuration::read(config)?;
    let mut calibration = Calibration::read(folder)?;
    check(&configuration, &calibration).map_err(|p| p.or_at(&folder.display().to_string(), 0))?;
    // Named by the commit: the newest is the last one.
    let date = format!("{:.0}", Timestamp::now()).replace(':', "-");
    let numbers = std::iter::once(String::new()).chain((2..).map(|n| format!("-{n}")));
    let mut folders = numbers.map(|number| Path::new(FOLDER).join(format!("{date}{number}")));
    let free = |kept: &PathBuf| !configuration.folder().join(kept).exists();
    let kept = folders.find(free).unwrap_or_default();
    let place = configuration.folder().join(&kept);
    // Keys that this calibration lacks stay as they are.
    let manifest = &calibration.manifest;
    let mut values = Values::new();
    let mut set = |address: String, value: &toml::Value| {
        values.insert(address, Some(value.to_string()));
    };
    let file = |name: &str| toml::Value::from(kept.join(name).to_string_lossy().as_ref());
    for joint in &manifest.joints {
        if let Some(name) = &joint.file {
            set(format!("joint.{}.{OF_JOINT}", joint.name), &file(name));
        }
    }
    for (address, value) in &manifest.settings {
        set(address.clone(), value);
    }
    if let Some(urdf) = &manifest.urdf {
        set(URDF.to_owned(), &file(&urdf.file));
    }
    let (text, before) = configuration.with(&values)?;
    let before = toml::to_string(&before).map_err(|e| Problem::new(e.to_string(), ""))?;
    calibration.files.insert(BEFORE.to_owned(), before);
    calibration.write(&place)?;
    if let Err(problems) = configuration.write(&text) {
        let _ = std::fs::remove_dir_all(&place);
        return Err(problems);
    }
    Ok(place)
}

/// Goes back to the keys before the last commit. Gives the folder that is in use no longer.
///
/// # Errors
/// A configuration that was never committed to; files that cannot be written.
pub(crate) fn rollback(config: &Path) -> Result<PathBuf, Problems> {
    let configuration = Configuration::read(config)?;
    let Some(folder) = configuration.committed().pop() else {
        let reason = "no calibration was committed to this configuration";
        let allowed = "a configuration after `torquectl calibrate commit`";
        return Err(Problem::new(reason, allowed)
            .at(config.display().to_string(), 0)
            .into());
    };
    let path = folder.join(BEFORE);
    let shown = path.display().to_string();
    let text = terminal::read_text(&path).map_err(|e| Problem::unreadable(&shown, &e))?;
    let before: Before =
        toml::from_str(&text).map_err(|e| Problem::new(e.message(), "").at(&shown, 0))?;
    let mut values: Values = (before.was.into_iter())
        .map(|(address, value)| (address, Some(value)))
        .collect();
    values.extend(before.absent.into_iter().map(|address| (address, None)));
    let (text, _) = configuration.with(&values)?;
    configuration.write(&text)?;
    std::fs::rename(&path, folder.join(TAKEN_BACK)).map_err(|e| Problem::unwritable(&shown, &e))?;
    Ok(folder)
}

/// SHA-256 of a text, hexadecimal.
pub(crate) fn text_hash(text: &str) -> String {
    let digest = Sha256::digest(text.as_bytes());
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A calibration must be of this robot.
fn check(configuration: &Configuration, calibration: &Calibration) -> Result<(), Problem> {
    let (identity, manifest) = (&configuration.identity, &calibration.manifest);
    let refuse = |reason: String| Err(Problem::new(reason, "a calibration of this robot"));
    if manifest.robot != identity.robot {
        let (theirs, ours) = (&manifest.robot, &identity.robot);
        return refuse(format!(
            "is a calibration of robot {theirs:?}, not of {ours:?}"
        ));
    }
    for joint in &manifest.joints {
        if identity.hash(&joint.name).as_ref() != Some(&joint.identity) {
            let name = &joint.name;
            return refuse(format!(
                "joint {name}: drive, encoders, their directions and zeros, or the rate are others now than in its \
                 recordings"
            ));
        }
    }
    for sensor in &manifest.sensors {
        if identity.of_sensor(&sensor.name).as_ref() != Some(&sensor.identity) {
            let name = &sensor.name;
            return refuse(format!(
                "F/T sensor {name}: frame, signals, sign or calibration matrix are others now than in its recordings"
            ));
        }
    }
    for drive in &manifest.drives {
        if identity.of_drive(&drive.name).as_ref() != Some(&drive.identity) {
            let name = &drive.name;
            return refuse(format!(
                "drive {name}: gear, torque constant or encoders are others now than in its recordings"
            ));
        }
    }
    if let Some(urdf) = &manifest.urdf {
        let path = &configuration.robot.parameters.urdf_path;
        let now = terminal::read_text(path).map_err(|e| Problem::unreadable(path, &e))?;
        let own = calibration.files.get(&urdf.file);
        if text_hash(&now) != urdf.of_sha256 && own != Some(&now) {
            return refuse(format!("{path}: the URDF has changed since the recordings"));
        }
    }
    if calibration.files.is_empty() && manifest.settings.is_empty() {
        return refuse("nothing of it could be calibrated".to_owned());
    }
    Ok(())
}
