//! F/T offsets found by tares, kept across restarts: `STATE/ROBOT/ft_offsets.toml`.
//!
//! A file that cannot be understood is never passed over: the daemon does not start with it, since
//! torques would silently be wrong. The refusal names the line and the remedy.

use std::path::{Path, PathBuf};

use jiff::Timestamp;
use problem::{Problem, line_at};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

use torqued_client::StateDirectory;

const FILE: &str = "ft_offsets.toml";
const HEAD: &str = "# F/T offsets, found by a tare and written by torqued: subtracted from each reading, besides the\n\
                    # configuration's offset; N and N·m. `torquectl tare --forget` removes this file.\n\n";
const FORMAT: u32 = 1;
/// Refusal of a stored file, before the reason.
const UNUSABLE: &str = "the F/T offsets cannot be used (mend the file, or remove it to start with \
                        the configuration's offsets; then tare again)";
/// Largest offset and standard deviation of a sensor, N or N·m: more is a slip of the pen.
const MAX_OFFSET: f64 = 1e5;

/// The offset of one F/T sensor; six components fx fy fz tx ty tz.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorOffset {
    /// The sensor's name.
    pub name: String,
    /// Offset subtracted from its reading besides the configuration's, N and N·m.
    #[serde(deserialize_with = "six")]
    pub offset: [f64; 6],
    /// Standard deviation.
    #[serde(deserialize_with = "six")]
    pub sigma: [f64; 6],
    /// True for a component that the pose of the last tare determined.
    #[serde(deserialize_with = "six")]
    pub known: [bool; 6],
}

/// Result of the last tare.
#[derive(Debug, Clone, PartialEq)]
pub struct Offsets {
    /// Time of the tare; whole seconds.
    pub date: Timestamp,
    /// The contact set of the tare.
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

/// Exactly six values: serde's own arrays pass over those that are too many.
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
    pub fn to_text(&self, robot: &str) -> Result<String, Problem> {
        let document = Document {
            format: FORMAT,
            robot: robot.to_owned(),
            date: self.date.to_string(),
            contacts: self.contacts.clone(),
            ft_sensor: self.sensors.clone(),
        };
        let text = toml::to_string(&document).map_err(|e| Problem::new(e.to_string(), ""))?;
        Ok(format!("{HEAD}{text}"))
    }

    /// Reads the file's text for a robot with those F/T sensors, in this order.
    ///
    /// # Errors
    /// A [`Problem`], with its line where there is one.
    pub fn parse(text: &str, robot: &str, sensors: &[&str]) -> Result<Self, Problem> {
        let document: Document = toml::from_str(text).map_err(|error| {
            let place = error.span().map_or(0, |span| span.start);
            let reason = error.message().replace('\n', ", ");
            Problem::new(reason, "").at("", line_at(text, place))
        })?;
        if document.format != FORMAT {
            let format = document.format;
            let reason = format!("format {format} is not known");
            return Err(Problem::new(reason, FORMAT.to_string()));
        }
        if document.robot != robot {
            let reason = format!("the offsets are of robot {:?}", document.robot);
            return Err(Problem::new(reason, format!("{robot:?}")));
        }
        let date: Timestamp = (document.date.parse())
            .map_err(|e| Problem::new(format!("date {:?}: {e}", document.date), "RFC 3339"))?;
        let mut found = document.ft_sensor;
        let named = |name: &str| found.iter().filter(|s| s.name == name).count() == 1;
        if found.len() != sensors.len() || !sensors.iter().all(|name| named(name)) {
            let names: Vec<_> = found.iter().map(|s| s.name.as_str()).collect();
            return Err(Problem::new(
                format!("the F/T sensors are {}", names.join(", ")),
                format!("those of the configuration, {}", sensors.join(", ")),
            ));
        }
        let place = |s: &SensorOffset| sensors.iter().position(|name| *name == s.name);
        found.sort_by_key(place);
        for sensor in &found {
            let fine = |x: &f64| x.abs() <= MAX_OFFSET;
            let deviations = sensor.sigma.iter().all(|x| fine(x) && *x >= 0.0);
            if !(sensor.offset.iter().all(fine) && deviations) {
                return Err(Problem::new(
                    format!("F/T sensor {}: a number is out of range", sensor.name),
                    format!("offsets of at most {MAX_OFFSET}, standard deviations from 0 to that"),
                ));
            }
        }
        Ok(Self {
            date,
            contacts: document.contacts,
            sensors: found,
        })
    }

    /// Date, age and contact set: `2026-11-21T07:20:06Z (3 days old), contacts in_the_air`.
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

/// The file of one robot's offsets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Store {
    robot: String,
    directory: StateDirectory,
}

impl Store {
    /// In the usual state directory: see [`StateDirectory::find`].
    ///
    /// # Errors
    /// No environment variable names a directory.
    pub fn find(robot: &str) -> Result<Self, Problem> {
        Ok(Self {
            robot: robot.to_owned(),
            directory: StateDirectory::find(robot)?,
        })
    }

    /// In that state directory.
    #[must_use]
    pub fn at(state: &Path, robot: &str) -> Self {
        Self {
            robot: robot.to_owned(),
            directory: StateDirectory::at(state, robot),
        }
    }

    /// The file.
    #[must_use]
    pub fn file(&self) -> PathBuf {
        self.directory.file(FILE)
    }

    /// Result of the last tare, if there was one.
    ///
    /// # Errors
    /// A file that cannot be read or understood, with the remedy.
    pub fn load(&self, sensors: &[&str]) -> Result<Option<Offsets>, Problem> {
        let path = self.file();
        let refuse = |problem: Problem| {
            let line = problem.line;
            problem.of(UNUSABLE).at(path.display().to_string(), line)
        };
        let read = self.directory.read(FILE);
        let Some(text) = read.map_err(|e| refuse(Problem::new(e.to_string(), "")))? else {
            return Ok(None);
        };
        Offsets::parse(&text, &self.robot, sensors)
            .map(Some)
            .map_err(refuse)
    }

    /// Writes the file, whole or not at all, and waits until it is on the disk.
    ///
    /// # Errors
    /// A file that cannot be written; the last one is still there.
    pub fn save(&self, offsets: &Offsets) -> Result<(), Problem> {
        let text = offsets.to_text(&self.robot)?;
        // A file that could not be read again would keep the daemon from starting.
        let names: Vec<&str> = offsets.sensors.iter().map(|s| s.name.as_str()).collect();
        Offsets::parse(&text, &self.robot, &names)?;
        (self.directory.replace(FILE, &text))
            .map_err(|e| self.refused(&format!("cannot be written ({e})")))
    }

    /// Removes the file.
    ///
    /// # Errors
    /// A file that cannot be removed.
    pub fn forget(&self) -> Result<(), Problem> {
        (self.directory.remove(FILE)).map_err(|e| self.refused(&format!("cannot be removed ({e})")))
    }

    fn refused(&self, reason: &str) -> Problem {
        Problem::new(reason, "").at(self.file().display().to_string(), 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ages_are_printed_in_words() {
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
