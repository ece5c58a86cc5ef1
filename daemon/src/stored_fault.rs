//! The latched fault, kept across restarts: `STATE/ROBOT/fault.toml`.
//!
//! The file is there while a fault is latched. It is written within some 20 ms of the fault, by the
//! main thread, and removed when the fault has been acknowledged. A daemon that finds it starts
//! with that fault latched.

use std::io;
use std::path::PathBuf;

use jiff::Timestamp;
use problem::{Problem, line_at};
use robot_state::Event;
use serde::{Deserialize, Serialize};

use torqued_client::StateDirectory;

const FILE: &str = "fault.toml";
const HEAD: &str = "# The latched fault, written by torqued, which starts with it until an operator acknowledges it.\n\n";
const FORMAT: u32 = 1;
const UNUSABLE: &str = "the fault that was latched when torqued last ended cannot be read from this \
                        file; find out which it was, then remove the file";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    format: u32,
    robot: String,
    fault: u32,
    name: String,
    date: String,
}

/// Where one robot's latched fault is kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FaultStore {
    robot: String,
    directory: StateDirectory,
}

impl FaultStore {
    /// Storage in that directory.
    #[must_use]
    pub fn new(robot: &str, directory: StateDirectory) -> Self {
        Self {
            robot: robot.to_owned(),
            directory,
        }
    }

    /// The robot's state directory.
    #[must_use]
    pub fn directory(&self) -> &StateDirectory {
        &self.directory
    }

    /// The file.
    #[must_use]
    pub fn file(&self) -> PathBuf {
        self.directory.file(FILE)
    }

    /// The fault that was latched when the daemon last ended, however it ended.
    ///
    /// # Errors
    /// A file that cannot be read or understood, with the remedy.
    pub fn load(&self) -> Result<Option<Event>, Problem> {
        let refuse = |problem: Problem| {
            let line = problem.line;
            (problem.of(UNUSABLE)).at(self.file().display().to_string(), line)
        };
        let read = self.directory.read(FILE);
        let Some(text) = read.map_err(|e| refuse(Problem::new(e.to_string(), "")))? else {
            return Ok(None);
        };
        self.parse(&text).map(Some).map_err(refuse)
    }

    fn parse(&self, text: &str) -> Result<Event, Problem> {
        let document: Document = toml::from_str(text).map_err(|error| {
            let place = error.span().map_or(0, |span| span.start);
            let reason = error.message().replace('\n', ", ");
            Problem::new(reason, "").at("", line_at(text, place))
        })?;
        if document.format != FORMAT || document.robot != self.robot {
            return Err(Problem::new(
                format!("format {}, robot {:?}", document.format, document.robot),
                format!("format {FORMAT}, robot {:?}", self.robot),
            ));
        }
        let (number, name) = (document.fault, document.name);
        // Any event may have latched a fault: the configuration chooses.
        let event = Event::from_number(number).filter(|event| event.name() == name);
        event.ok_or_else(|| {
            let reason = format!("fault {number} ({name}) is not known to this version");
            Problem::new(reason, "")
        })
    }

    /// Stores the latched fault, or removes the file if none is latched; whole or not at all.
    ///
    /// # Errors
    /// The file cannot be written or removed.
    pub fn save(&self, fault: Option<Event>) -> Result<(), Problem> {
        let outcome = match fault {
            None => self.directory.remove(FILE),
            Some(event) => self.directory.replace(FILE, &self.text(event)?),
        };
        outcome.map_err(|e| self.refused(&e))
    }

    /// Checks that the file can be written.
    ///
    /// # Errors
    /// The file system's error.
    pub fn probe(&self) -> Result<(), Problem> {
        self.directory.probe().map_err(|e| self.refused(&e))
    }

    fn refused(&self, error: &io::Error) -> Problem {
        let reason = format!("cannot be written ({error})");
        Problem::new(reason, "").at(self.file().display().to_string(), 0)
    }

    fn text(&self, event: Event) -> Result<String, Problem> {
        let document = Document {
            format: FORMAT,
            robot: self.robot.clone(),
            fault: event.number(),
            name: event.name().to_owned(),
            date: Timestamp::now().to_string(),
        };
        let text = toml::to_string(&document).map_err(|e| Problem::new(e.to_string(), ""))?;
        Ok(format!("{HEAD}{text}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_kept_until_it_is_acknowledged() {
        let name = format!("torqued-fault-{}", std::process::id());
        let state = std::env::temp_dir().join(name);
        let store = FaultStore::new("leg", StateDirectory::at(&state, "leg"));
        assert_eq!(store.load(), Ok(None));
        assert_eq!(store.save(None), Ok(()));
        assert_eq!(store.probe(), Ok(()));
        assert_eq!(store.save(Some(Event::JointStale)), Ok(()));
        assert_eq!(store.load(), Ok(Some(Event::JointStale)));

        let text = std::fs::read_to_string(store.file()).expect("written");
        for (from, to) in [("104", "7"), ("104", "501"), ("leg", "arm"), ("fault", "x")] {
            std::fs::write(store.file(), text.replace(from, to)).expect("written");
            let refusal = store.load().expect_err("not understood");
            assert!(refusal.to_string().contains("remove the file"), "{refusal}");
        }
        assert_eq!(store.save(None), Ok(()));
        assert_eq!(store.load(), Ok(None));
        std::fs::remove_dir_all(state).expect("removed");
    }

    #[test]
    fn a_directory_that_cannot_be_written_is_reported() {
        let store = FaultStore::new("leg", StateDirectory::at("/proc/torqued".as_ref(), "leg"));
        let why = store.probe().expect_err("not writable");
        assert!(why.file.contains("/proc/torqued/leg/fault.toml"), "{why}");
        assert!(store.save(Some(Event::JointStale)).is_err());
    }
}
