//! Where black boxes are kept: `STATE/ROBOT/blackbox/DATE_NUMBER_NAME.mcap`.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use recording::{Header, WriteError};
use robot_state::Event;

use super::output::Output;
use torqued_client::StateDirectory;

/// Name of the folder in the robot's state directory.
pub const FOLDER: &str = "blackbox";
/// Black boxes that are kept: the newest. One of 30 joints takes about 20 MB.
pub const KEPT: usize = 20;
/// Ending of a file that is not whole yet.
const PART: &str = "part";

/// The folder of one robot's black boxes.
#[derive(Debug, Clone)]
pub struct BlackBoxes {
    folder: PathBuf,
}

impl BlackBoxes {
    /// In the robot's state directory.
    #[must_use]
    pub fn new(directory: &StateDirectory) -> Self {
        Self {
            folder: directory.file(FOLDER),
        }
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Begins the black box of a fault.
    pub(super) fn begin(
        &self,
        header: &Header,
        event: Event,
        from: u64,
        until_ns: u64,
    ) -> Result<Output, WriteError> {
        fs::create_dir_all(&self.folder)?;
        let date = Timestamp::now().strftime("%Y-%m-%dT%H-%M-%S%.3fZ");
        let name = format!("{date}_{}_{}.mcap.{PART}", event.number(), event.name());
        let header = Header {
            black_box: Some(event),
            ..header.clone()
        };
        Output::create(&self.folder.join(name), true, &header, from, until_ns)
    }

    /// Ends a black box: it gets its name when it is whole and on the disk. Old ones are removed.
    pub(super) fn finish(&self, output: Output) -> Result<PathBuf, WriteError> {
        let part = output.path().to_owned();
        if let Err(why) = output.finish() {
            let _ = fs::remove_file(&part);
            return Err(why);
        }
        let path = part.with_extension("");
        fs::rename(&part, &path)?;
        File::open(&self.folder)?.sync_all()?;
        self.prune()?;
        Ok(path)
    }

    /// Gives up a black box that could not be written.
    pub(super) fn abandon(&self, output: &Output) {
        let _ = fs::remove_file(output.path());
    }

    /// Removes all but the newest, and parts that a crash has left.
    fn prune(&self) -> io::Result<()> {
        let entries = fs::read_dir(&self.folder)?;
        let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
        // Names begin with the date.
        files.sort();
        let ends_in = |path: &PathBuf, ending: &str| path.extension().is_some_and(|e| e == ending);
        let (whole, others): (Vec<_>, Vec<_>) =
            files.into_iter().partition(|path| ends_in(path, "mcap"));
        let old = whole.len().saturating_sub(KEPT);
        let parts = others.iter().filter(|path| ends_in(path, PART));
        for path in whole.iter().take(old).chain(parts) {
            fs::remove_file(path)?;
        }
        Ok(())
    }
}
