//! What tares have found, kept across restarts: `STATE/ROBOT/ft_offsets.toml`.
//!
//! A file that cannot be understood is never passed over: the daemon does not start with it, since
//! torques would silently be wrong. It says which line is wrong and what to do.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

const FILE: &str = "ft_offsets.toml";
const HEAD: &str = "# F/T offsets, found by a tare and written by torqued: what is taken off each reading besides the\n\
                    # configuration's offset, N and N·m. `torquectl tare --forget` removes this file.\n\n";
const FORMAT: u32 = 1;
/// No sensor has a greater offset, N or N·m: a slipped digit is one.
const LARGEST: f64 = 1e5;

/// The offset of one F/T sensor; six components fx fy fz tx ty tz.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorOffset {
    /// The sensor's name.
    pub name: String,
    /// What is taken off its reading besides the configuration's offset, N and N·m.
    #[serde(deserialize_with = "six")]
    pub offset: [f64; 6],
    /// Standard deviation.
    #[serde(deserialize_with = "six")]
    pub sigma: [f64; 6],
    /// Whether the pose of the last tare has told the component.
    #[serde(deserialize_with = "six")]
    pub known: [bool; 6],
}

/// What the last tare has found.
#[derive(Debug, Clone, PartialEq)]
pub struct Offsets {
    /// When; whole seconds.
    pub date: Timestamp,
    /// The set of contacts that said what touches the robot.
    pub contacts: String,
    /// The sensors, in config order.
    pub sensors: Vec<SensorOffset>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    format: u32,
    robot: String,
    date: String,
    contacts: String,
    ft_sensor: Vec<SensorOffset>,
}

/// Six values, not five and not seven: for arrays alone, what is too much is passed over.
fn six<'de, D: Deserializer<'de>, T: Deserialize<'de>>(d: D) -> Result<[T; 6], D::Error> {
    let values = Vec::<T>::deserialize(d)?;
    let count = values.len();
    (values.try_into()).map_err(|_| D::Error::custom(format!("{count} values; allowed: 6")))
}

impl Offsets {
    /// The file's text.
    ///
    /// # Errors
    /// Never for texts and numbers.
    pub fn to_text(&self, robot: &str) -> Result<String, String> {
        let document = Document {
            format: FORMAT,
            robot: robot.to_owned(),
            date: self.date.to_string(),
            contacts: self.contacts.clone(),
            ft_sensor: self.sensors.clone(),
        };
        let text = toml::to_string(&document).map_err(|e| e.to_string())?;
        Ok(format!("{HEAD}{text}"))
    }

    /// Reads the file's text for a robot with those F/T sensors, in this order.
    ///
    /// # Errors
    /// What is wrong, with the line where there is one, and what is allowed.
    pub fn parse(text: &str, robot: &str, sensors: &[&str]) -> Result<Self, String> {
        let document: Document = toml::from_str(text).map_err(|error| {
            let before = error.span().and_then(|span| text.get(..span.start));
            let line = before.map_or(1, |before| 1 + before.matches('\n').count());
            format!("line {line}: {}", error.message().replace('\n', ", "))
        })?;
        if document.format != FORMAT {
            let format = document.format;
            return Err(format!("format {format} is not known; allowed: {FORMAT}"));
        }
        if document.robot != robot {
            let other = document.robot;
            return Err(format!("it is of robot {other:?}; allowed: {robot:?}"));
        }
        let date: Timestamp = (document.date.parse())
            .map_err(|e| format!("date {:?}: {e}; allowed: RFC 3339", document.date))?;
        let mut found = document.ft_sensor;
        let named = |name: &str| found.iter().filter(|s| s.name == name).count() == 1;
        if found.len() != sensors.len() || !sensors.iter().all(|name| named(name)) {
            let names: Vec<_> = found.iter().map(|s| s.name.as_str()).collect();
            return Err(format!(
                "its F/T sensors are {}; allowed: those of the configuration, {}",
                names.join(", "),
                sensors.join(", ")
            ));
        }
        let place = |s: &SensorOffset| sensors.iter().position(|name| *name == s.name);
        found.sort_by_key(place);
        for sensor in &found {
            let fine = |x: &f64| x.abs() <= LARGEST;
            let deviations = sensor.sigma.iter().all(|x| fine(x) && *x >= 0.0);
            if !(sensor.offset.iter().all(fine) && deviations) {
                return Err(format!(
                    "F/T sensor {}: allowed: offsets of at most {LARGEST}, standard deviations from \
                     0 to that",
                    sensor.name
                ));
            }
        }
        Ok(Self {
            date,
            contacts: document.contacts,
            sensors: found,
        })
    }

    /// `2026-11-21T07:20:06Z (3 days old), contacts in_the_air`.
    #[must_use]
    pub fn about(&self, now: Timestamp) -> String {
        let (date, contacts) = (self.date, &self.contacts);
        format!("{date} ({}), contacts {contacts}", age(date, now))
    }
}

fn age(date: Timestamp, now: Timestamp) -> String {
    let seconds = now.as_second() - date.as_second();
    let plural = |n: i64, unit: &str| format!("{n} {unit}{} old", if n == 1 { "" } else { "s" });
    match seconds {
        ..0 => "dated in the future: was the clock set back?".to_owned(),
        0..60 => plural(seconds, "second"),
        60..3600 => plural(seconds / 60, "minute"),
        3600..86_400 => plural(seconds / 3600, "hour"),
        _ => plural(seconds / 86_400, "day"),
    }
}

/// Where one robot's offsets are kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Store {
    robot: String,
    folder: PathBuf,
}

impl Store {
    /// In the usual state directory: `$STATE_DIRECTORY`, which systemd sets; else
    /// `$XDG_STATE_HOME/torqued`; else `~/.local/state/torqued`.
    ///
    /// # Errors
    /// Where nothing tells the directory.
    pub fn find(robot: &str) -> Result<Self, String> {
        let directory = state_directory(|variable| std::env::var_os(variable))?;
        Ok(Self::at(&directory, robot))
    }

    /// In that state directory.
    #[must_use]
    pub fn at(state: &Path, robot: &str) -> Self {
        Self {
            robot: robot.to_owned(),
            folder: state.join(robot),
        }
    }

    /// The file.
    #[must_use]
    pub fn file(&self) -> PathBuf {
        self.folder.join(FILE)
    }

    /// What the last tare has found, if there was one.
    ///
    /// # Errors
    /// A file that cannot be read or understood: which, why, and what to do.
    pub fn load(&self, sensors: &[&str]) -> Result<Option<Offsets>, String> {
        let path = self.file();
        let refuse = |what: String| {
            format!(
                "{}: {what}. Mend it, or remove it to start with the configuration's offsets; then \
                 tare again",
                path.display()
            )
        };
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(refuse(format!("cannot be read ({e})"))),
        };
        Offsets::parse(&text, &self.robot, sensors)
            .map(Some)
            .map_err(refuse)
    }

    /// Writes the file, whole or not at all, and waits until it is on the disk.
    ///
    /// # Errors
    /// What cannot be written; the last file is still there.
    pub fn save(&self, offsets: &Offsets) -> Result<(), String> {
        let text = offsets.to_text(&self.robot)?;
        // What could not be read again would keep the daemon from starting.
        let names: Vec<&str> = offsets.sensors.iter().map(|s| s.name.as_str()).collect();
        Offsets::parse(&text, &self.robot, &names)?;
        let fail = |e: io::Error| format!("{}: cannot be written ({e})", self.file().display());
        self.replace(&text).map_err(fail)
    }

    /// Removes the file.
    ///
    /// # Errors
    /// What cannot be removed.
    pub fn forget(&self) -> Result<(), String> {
        let fail = |e: io::Error| format!("{}: cannot be removed ({e})", self.file().display());
        match fs::remove_file(self.file()) {
            Ok(()) => self.sync_folder().map_err(fail),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
            Err(e) => Err(fail(e)),
        }
    }

    fn replace(&self, text: &str) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        let new = self.folder.join(format!("{FILE}.new"));
        let mut file = File::create(&new)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&new, self.file())?;
        self.sync_folder()
    }

    fn sync_folder(&self) -> io::Result<()> {
        File::open(&self.folder)?.sync_all()
    }
}

/// The state directory that the environment tells.
fn state_directory(variable: impl Fn(&str) -> Option<OsString>) -> Result<PathBuf, String> {
    // The XDG specification and systemd: absolute, or as if unset. systemd separates several by `:`.
    let absolute = |name: &str| {
        let value = variable(name)?.into_string().ok()?;
        let first = match name {
            "STATE_DIRECTORY" => value.split(':').next().map(str::to_owned),
            _ => Some(value),
        };
        first.map(PathBuf::from).filter(|path| path.is_absolute())
    };
    let (xdg, home) = (absolute("XDG_STATE_HOME"), absolute("HOME"));
    absolute("STATE_DIRECTORY")
        .or_else(|| xdg.map(|path| path.join("torqued")))
        .or_else(|| home.map(|path| path.join(".local/state/torqued")))
        .ok_or_else(|| {
            "no directory to keep offsets in: none of STATE_DIRECTORY, XDG_STATE_HOME and HOME is \
             set to an absolute path"
                .to_owned()
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_environment_tells_the_directory() {
        let found = |pairs: &[(&str, &str)]| {
            let pairs: Vec<(String, OsString)> = (pairs.iter())
                .map(|(k, v)| ((*k).to_owned(), OsString::from(v)))
                .collect();
            let value = |name: &str| {
                pairs
                    .iter()
                    .find(|(k, _)| k == name)
                    .map(|(_, v)| v.clone())
            };
            state_directory(value).ok()
        };
        let all = [
            ("STATE_DIRECTORY", "/var/lib/torqued:/var/lib/other"),
            ("XDG_STATE_HOME", "/state"),
            ("HOME", "/home/robot"),
        ];
        assert_eq!(found(&all), Some("/var/lib/torqued".into()));
        assert_eq!(found(&all[1..]), Some("/state/torqued".into()));
        let home = Some("/home/robot/.local/state/torqued".into());
        assert_eq!(found(&all[2..]), home);
        assert_eq!(found(&[("XDG_STATE_HOME", "here"), all[2]]), home);
        assert_eq!(found(&[("HOME", "")]), None);
    }

    #[test]
    fn ages_are_told_in_words() {
        let now = Timestamp::from_second(1_800_000_000).expect("a date");
        let old = |seconds: i64| {
            let date = Timestamp::from_second(now.as_second() - seconds).expect("a date");
            age(date, now)
        };
        assert_eq!(old(1), "1 second old");
        assert_eq!(old(3599), "59 minutes old");
        assert_eq!(old(7200), "2 hours old");
        assert_eq!(old(3 * 86_400 + 80_000), "3 days old");
        assert!(old(-5).contains("future"));
    }
}
