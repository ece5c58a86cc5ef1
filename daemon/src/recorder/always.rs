//! The recording that always runs: `STATE/ROBOT/recordings/DATE_CONTENT.mcap`, a file after the other,
//! the oldest ones removed.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use jiff::Timestamp;
use robot_config::RecorderSettings;
use torqued_client::StateDirectory;

use super::Recorder;
use super::output::{Contents, Output};
use super::tap::Slot;

/// Name of the folder in the robot's state directory.
pub const RECORDINGS: &str = "recordings";
/// Interval at which old files are looked for.
const LOOK: Duration = Duration::from_secs(60);
/// After a file could not be written, as with a full disk, the next one is tried so much later.
const RETRY: Duration = Duration::from_secs(60);

/// Where the recording stands, and what of it is kept.
#[derive(Debug, Clone)]
pub struct Always {
    folder: PathBuf,
    settings: RecorderSettings,
    contents: Contents,
    /// The next file begins then, if none is being written.
    next_try: Option<Instant>,
    looked: Option<Instant>,
}

impl Always {
    /// In the robot's state directory.
    ///
    /// # Errors
    /// A rate that the loop does not have.
    pub fn new(
        directory: &StateDirectory,
        settings: RecorderSettings,
        period_s: f64,
    ) -> Result<Self, problem::Problem> {
        Ok(Self {
            folder: directory.file(RECORDINGS),
            settings,
            contents: Contents::new(settings.content, settings.rate_hz, period_s)?,
            next_try: None,
            looked: None,
        })
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    fn next_path(&self) -> io::Result<PathBuf> {
        fs::create_dir_all(&self.folder)?;
        let date = Timestamp::now().strftime("%Y-%m-%dT%H-%M-%S%.9fZ");
        let content = self.contents.content.name();
        Ok(self.folder.join(format!("{date}_{content}.mcap")))
    }

    /// Removes files by age and size, but not the newest one.
    fn prune(&self) -> io::Result<()> {
        let entries = fs::read_dir(&self.folder)?;
        let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
        files.retain(|path| path.extension().is_some_and(|ending| ending == "mcap"));
        // Names begin with the date.
        files.sort();
        let mut kept = 0;
        for (age, path) in files.iter().rev().enumerate() {
            let file = fs::metadata(path)?;
            kept += file.len();
            let since = SystemTime::now().duration_since(file.modified()?);
            let too_old = since.is_ok_and(|age| age.as_secs_f64() > self.settings.kept_s);
            if age > 0 && (too_old || kept > self.settings.kept_bytes) {
                fs::remove_file(path)?;
            }
        }
        Ok(())
    }
}

impl Recorder {
    /// Records from now on as long as the loop runs.
    pub fn record_always(&mut self, always: Always) {
        self.always = Some(always);
    }

    /// Begins the file that is due, ends one that is long enough, and removes old ones.
    pub(super) fn advance_always(&mut self, now: Instant) {
        let Some(mut always) = self.always.take() else {
            return;
        };
        let place = (self.recordings.iter()).position(|(slot, _)| *slot == Slot::Always);
        let due = always.next_try.is_none_or(|next| now >= next);
        match place {
            Some(place) => {
                let full = |output: &Output| output.on_disk() >= always.settings.file_bytes;
                if self
                    .recordings
                    .get(place)
                    .is_some_and(|(_, output)| full(output))
                {
                    let (_, output) = self.recordings.remove(place);
                    let next = output.next();
                    if let Err(why) = output.finish() {
                        tracing::warn!("the recording's file ends: {why}");
                    }
                    self.begin_always(&mut always, next, now);
                }
            }
            None if due && !self.ended => {
                // What the history still holds is recorded too: the first cycle is among it.
                let from = self.history.oldest();
                self.begin_always(&mut always, from, now);
            }
            None => {}
        }
        if always
            .looked
            .is_none_or(|looked| now.duration_since(looked) > LOOK)
        {
            always.looked = Some(now);
            if let Err(why) = always.prune() {
                tracing::warn!("{}: old recordings stay: {why}", always.folder.display());
            }
        }
        self.always = Some(always);
    }

    fn begin_always(&mut self, always: &mut Always, from: u64, now: Instant) {
        let header = self.header_with(always.contents);
        let begun = always.next_path().map_err(recording::WriteError::Io);
        let begun = begun.and_then(|path| {
            let output = Output::create(&path, false, &header, from, u64::MAX)?;
            Ok((path, output))
        });
        always.next_try = Some(now + RETRY);
        always.looked = None;
        match begun {
            Ok((path, output)) => {
                self.shared.begin(Slot::Always, &path);
                self.recordings.push((Slot::Always, output));
            }
            Err(why) => {
                let folder = always.folder.display();
                tracing::warn!("{folder}: nothing is recorded for a minute: {why}");
                self.shared
                    .refuse(Slot::Always, &always.folder, &why.to_string(), false);
            }
        }
    }
}
