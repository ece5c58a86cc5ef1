//! Times of a daemon's loop, in a file of its run directory.

use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

const SUFFIX: &str = ".timing";

/// A daemon's file of times: JSON that it writes anew every second, removed at the end.
#[derive(Debug)]
pub struct TimingFile {
    path: PathBuf,
}

impl TimingFile {
    /// That of a robot in a run directory, for the daemon.
    #[must_use]
    pub fn of(run_dir: &Path, robot: &str) -> Self {
        Self {
            path: path(run_dir, robot),
        }
    }

    /// Replaces the text, whole or not at all.
    ///
    /// # Errors
    /// The file system's.
    pub fn write(&self, text: &str) -> io::Result<()> {
        let new = self.path.with_extension("timing-new");
        let mut options = File::options();
        let options = options.write(true).create(true).truncate(true).mode(0o600);
        options.open(&new)?.write_all(text.as_bytes())?;
        fs::rename(new, &self.path)
    }

    /// The text that a robot's daemon has written.
    ///
    /// # Errors
    /// No daemon of that robot runs.
    pub fn read(run_dir: &Path, robot: &str) -> io::Result<String> {
        fs::read_to_string(path(run_dir, robot))
    }
}

impl Drop for TimingFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

fn path(run_dir: &Path, robot: &str) -> PathBuf {
    run_dir.join(format!("{}{SUFFIX}", robot.replace('/', "_")))
}
