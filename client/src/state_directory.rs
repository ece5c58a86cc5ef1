//! Where one robot's state is kept across restarts: `STATE/ROBOT/`, a few small files.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use problem::Problem;

/// One robot's folder in the state directory; made when something is first written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StateDirectory {
    folder: PathBuf,
}

impl StateDirectory {
    /// The robot's folder in the usual state directory: `$STATE_DIRECTORY`, which systemd sets; else
    /// `$XDG_STATE_HOME/torqued`; else `~/.local/state/torqued`.
    ///
    /// # Errors
    /// No environment variable names a directory.
    pub fn find(robot: &str) -> Result<Self, Problem> {
        let state = state_directory(|variable| std::env::var_os(variable))?;
        Ok(Self::at(&state, robot))
    }

    /// The robot's folder in that state directory.
    #[must_use]
    pub fn at(state: &Path, robot: &str) -> Self {
        Self {
            folder: state.join(robot),
        }
    }

    /// The folders of all robots in the usual state directory, with the robots' names, sorted.
    ///
    /// # Errors
    /// As [`find`](Self::find); of the file system.
    pub fn all() -> Result<Vec<(String, Self)>, Problem> {
        let state = state_directory(|variable| std::env::var_os(variable))?;
        let entries = match fs::read_dir(&state) {
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            other => other.map_err(|e| {
                Problem::new(
                    format!("{} cannot be read: {e}", state.display()),
                    "a directory",
                )
            })?,
        };
        let folders = entries
            .filter_map(Result::ok)
            .filter(|entry| entry.path().is_dir());
        let robots = folders.filter_map(|entry| entry.file_name().into_string().ok());
        let mut robots: Vec<_> = robots
            .map(|robot| (robot.clone(), Self::at(&state, &robot)))
            .collect();
        robots.sort_by(|(one, _), (other, _)| one.cmp(other));
        Ok(robots)
    }

    /// The path of the file of that name.
    #[must_use]
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// The file's text; none if there is no such file.
    ///
    /// # Errors
    /// The file system's.
    pub fn read(&self, name: &str) -> io::Result<Option<String>> {
        match fs::read_to_string(self.file(name)) {
            Ok(text) => Ok(Some(text)),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e),
        }
    }

    /// Writes the file, whole or not at all, and waits until it is on the disk.
    ///
    /// # Errors
    /// The file system's; the last file is still there.
    pub fn replace(&self, name: &str, text: &str) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        let new = self.file(&format!("{name}.new"));
        let mut file = File::create(&new)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&new, self.file(name))?;
        self.sync()
    }

    /// Removes the file, if there is one.
    ///
    /// # Errors
    /// The file system's.
    pub fn remove(&self, name: &str) -> io::Result<()> {
        match fs::remove_file(self.file(name)) {
            Ok(()) => self.sync(),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
            Err(e) => Err(e),
        }
    }

    /// Whether files can be written at all.
    ///
    /// # Errors
    /// The file system's: the reason why not.
    pub fn probe(&self) -> io::Result<()> {
        self.replace("probe", "")?;
        self.remove("probe")
    }

    fn sync(&self) -> io::Result<()> {
        File::open(&self.folder)?.sync_all()
    }
}

/// The state directory that the environment names.
fn state_directory(variable: impl Fn(&str) -> Option<OsString>) -> Result<PathBuf, Problem> {
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
            Problem::new(
                "no state directory",
                "an absolute path in STATE_DIRECTORY, XDG_STATE_HOME or HOME",
            )
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_environment_names_the_directory() {
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
}
