//! A file that is being written from the history.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use problem::{Allowed, Problem};
use recording::{Header, RunWriter, WriteError};
use robot_state::Content;
use terminal::NewFile;

use super::history::History;

/// Interval between two flushes, ns of the cycles' clock: what a crash of the machine can lose.
const FLUSH_NS: u64 = 1_000_000_000;
/// A recording ends when its client has not asked after it for so long.
const LEASE: Duration = Duration::from_secs(5);

/// What a recording holds of every cycle, and of how many.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Contents {
    /// What it holds of a cycle.
    pub content: Content,
    /// Cycles for each message; above 1 of torques alone.
    pub every: u32,
}

impl Default for Contents {
    fn default() -> Self {
        Self {
            content: Content::All,
            every: 1,
        }
    }
}

impl Contents {
    /// With so many messages a second, none: one for each cycle.
    ///
    /// # Errors
    /// A rate that the loop does not have, or of other contents than torques.
    pub fn new(content: Content, rate_hz: Option<f64>, period_s: f64) -> Result<Self, Problem> {
        let Some(rate_hz) = rate_hz else {
            return Ok(Self { content, every: 1 });
        };
        if content != Content::Torques {
            let reason = format!("a rate of {rate_hz} Hz with the content {}", content.name());
            return Err(Problem::new(reason, "a rate with the content torques"));
        }
        let allowed = Allowed::Within(0.1, (1.0 / period_s).round());
        if !allowed.admits(rate_hz) {
            let reason = format!("torques cannot be recorded {rate_hz} times a second");
            return Err(Problem::new(reason, allowed.to_string()));
        }
        let every = (1.0 / (period_s * rate_hz)).round().max(1.0) as u32;
        Ok(Self { content, every })
    }
}

/// Requests to the recorder.
#[derive(Debug, Clone, PartialEq)]
pub enum RecordingRequest {
    /// Record into that file, from `last_s` ago on, for so long.
    Begin {
        /// The file.
        path: PathBuf,
        /// Duration from now on, s; none: until the end is asked for.
        seconds: Option<f64>,
        /// Time before now that is recorded too, s.
        last_s: f64,
        /// What is recorded.
        contents: Contents,
        /// A file that is already there is replaced, once the new one is whole.
        overwrite: bool,
        /// Nobody has to ask after it: it ends with the daemon.
        unattended: bool,
    },
    /// Somebody still wants the recording.
    Renew,
    /// End it.
    End,
}

/// The state of a recording, or of the last one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RecordingStatus {
    /// Count of requests to begin that were decided.
    pub generation: u64,
    /// The file.
    pub path: PathBuf,
    /// It is being written.
    pub running: bool,
    /// Cycles written.
    pub cycles: u64,
    /// Time from the first to the last cycle, s.
    pub seconds: f64,
    /// Bytes before compression.
    pub bytes: u64,
    /// Cycles that are missing.
    pub lost: u64,
    /// Why the last request to begin was refused.
    pub refused: Option<String>,
    /// Why the recording ended too early.
    pub failed: Option<String>,
    pub(super) dropped_before: u64,
}

/// Where a recording is written to.
enum Place {
    /// A file that was not there: it grows in its place, and a crash leaves what was flushed.
    New(BufWriter<File>),
    /// Beside an older file, which stays until this one is whole.
    Beside(NewFile),
}

impl Place {
    fn create(path: &Path, overwrite: bool) -> io::Result<Self> {
        if overwrite && path.exists() {
            let file = NewFile::create(path);
            return Ok(Self::Beside(
                file.map_err(|problem| io::Error::other(problem.reason))?,
            ));
        }
        let file = File::create_new(path).map_err(|e| match e.kind() {
            io::ErrorKind::AlreadyExists => io::Error::new(
                e.kind(),
                "exists already; allowed: a new name, or `torquectl record --force`",
            ),
            _ => e,
        });
        Ok(Self::New(BufWriter::new(file?)))
    }
}

impl Write for Place {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::New(file) => file.write(bytes),
            Self::Beside(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::New(file) => file.flush(),
            Self::Beside(file) => file.flush(),
        }
    }
}

impl Seek for Place {
    fn seek(&mut self, place: SeekFrom) -> io::Result<u64> {
        match self {
            Self::New(file) => file.seek(place),
            Self::Beside(file) => file.seek(place),
        }
    }
}

/// A file that is being written.
pub(super) struct Output {
    path: PathBuf,
    writer: RunWriter<Place>,
    /// The next entry of the history.
    next: u64,
    until_ns: u64,
    first_ns: Option<u64>,
    last_ns: u64,
    flushed_ns: u64,
    cycles: u64,
    bytes: u64,
    lost: u64,
    renewed: Option<Instant>,
    at_end: bool,
    /// Size of the file at the last flush, bytes.
    on_disk: u64,
}

impl Output {
    /// Creates the file, with the entries of the history from number `from` to stamp `until_ns`.
    pub(super) fn create(
        path: &Path,
        overwrite: bool,
        header: &Header,
        from: u64,
        until_ns: u64,
    ) -> Result<Self, WriteError> {
        let place = Place::create(path, overwrite)?;
        Ok(Self {
            path: path.to_owned(),
            writer: RunWriter::new(place, header)?,
            next: from,
            until_ns,
            first_ns: None,
            last_ns: 0,
            flushed_ns: 0,
            cycles: 0,
            bytes: 0,
            lost: 0,
            renewed: None,
            at_end: false,
            on_disk: 0,
        })
    }

    /// Writes at most so many entries; gives how many.
    pub(super) fn advance(&mut self, history: &History, most: usize) -> Result<usize, WriteError> {
        if self.next < history.oldest() {
            self.lost += history.oldest() - self.next;
            self.next = history.oldest();
        }
        let mut written = 0;
        while written < most && !self.at_end {
            let Some((message, stamp_ns)) = history.get(self.next) else {
                break;
            };
            if stamp_ns > self.until_ns {
                self.at_end = true;
                break;
            }
            self.writer.write(message)?;
            self.next += 1;
            self.cycles += 1;
            self.bytes += message.len() as u64;
            let first_ns = *self.first_ns.get_or_insert(stamp_ns);
            self.last_ns = stamp_ns;
            if stamp_ns.saturating_sub(self.flushed_ns.max(first_ns)) >= FLUSH_NS {
                self.writer.flush()?;
                self.flushed_ns = stamp_ns;
                self.on_disk = std::fs::metadata(&self.path).map_or(0, |file| file.len());
            }
            written += 1;
        }
        Ok(written)
    }

    /// Its last entry is written.
    pub(super) fn is_at_end(&self) -> bool {
        self.at_end || (self.first_ns.is_some() && self.last_ns >= self.until_ns)
    }

    /// Ends with the entry of that stamp, whoever still wants it.
    pub(super) fn end_after(&mut self, stamp_ns: u64) {
        self.renewed = None;
        self.until_ns = self.until_ns.min(stamp_ns);
        self.at_end |= self.first_ns.is_none() || self.last_ns >= self.until_ns;
    }

    /// Somebody still wants it.
    pub(super) fn renew(&mut self, now: Instant) {
        self.renewed = Some(now);
    }

    /// Nobody wants it any more.
    pub(super) fn is_expired(&self, now: Instant) -> bool {
        let renewed = self.renewed;
        renewed.is_some_and(|renewed| now.duration_since(renewed) > LEASE)
    }

    /// The entry of the history that it would write next.
    pub(super) fn next(&self) -> u64 {
        self.next
    }

    /// Size of the file at the last flush, bytes.
    pub(super) fn on_disk(&self) -> u64 {
        self.on_disk
    }

    pub(super) fn cycles(&self) -> u64 {
        self.cycles
    }

    pub(super) fn seconds(&self) -> f64 {
        let first_ns = self.first_ns.unwrap_or(self.last_ns);
        self.last_ns.saturating_sub(first_ns) as f64 * 1e-9
    }

    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    pub(super) fn lost(&self) -> u64 {
        self.lost
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Ends the file and waits until it is on the disk; gives its path.
    pub(super) fn finish(mut self) -> Result<PathBuf, WriteError> {
        if let Err(why) = self.writer.end() {
            return Err(self.give_up(why));
        }
        match self.writer.into_inner() {
            Place::New(file) => {
                let file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
                file.sync_all()?;
            }
            Place::Beside(_) if self.cycles == 0 => {
                let why = "nothing was recorded; the older file stays as it was";
                return Err(io::Error::other(why).into());
            }
            Place::Beside(file) => file.finish()?,
        }
        Ok(self.path)
    }

    /// Ends it where it cannot be written any further; gives why, and what is left of it.
    pub(super) fn give_up(self, why: WriteError) -> WriteError {
        let Place::Beside(file) = self.writer.into_inner() else {
            return why;
        };
        let partial = (self.cycles > 0).then(|| file.keep_partial()).flatten();
        match partial {
            Some(partial) => {
                let partial = partial.display();
                let text =
                    format!("{why}; the older file stays; what was recorded is in {partial}");
                io::Error::other(text).into()
            }
            None => why,
        }
    }
}
