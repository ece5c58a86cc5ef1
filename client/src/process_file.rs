//! What can be known and asked of a daemon without shared memory: its process, its robot's state.
//!
//! A daemon keeps `ROBOT.process` in the run directory locked while it lives, so that the kernel
//! itself names its process, and writes its robot's state into it. Whoever finds no way through
//! shared memory (full, spoilt, another version) still stops the robot: by SIGUSR1 to that process.

use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, fcntl};
use nix::libc;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use crate::error::Error;
use crate::location::{Location, own_uid};

const SUFFIX: &str = ".process";
/// Bytes of the file, from the beginning: it takes no further memory later.
const SIZE: usize = 256;
/// Longest wait for a predecessor that is just ending.
const RETRY_FOR: Duration = Duration::from_millis(500);

/// The daemon's end: the file is locked while this value lives.
#[derive(Debug)]
pub struct ProcessFile {
    file: File,
    written: String,
}

impl ProcessFile {
    /// Locks the robot's file.
    ///
    /// # Errors
    /// [`Error::AlreadyRunning`], [`Error::RunDirectory`].
    pub fn create(location: &Location, robot: &str) -> Result<Self, Error> {
        let path = path(location.path(), robot);
        let refuse = |e: &dyn std::fmt::Display| Error::RunDirectory {
            path: location.path().to_owned(),
            reason: format!("{} cannot be written ({e})", path.display()),
        };
        let mut options = File::options();
        let options = options.read(true).write(true).create(true).truncate(false);
        let file = options.mode(0o600).open(&path).map_err(|e| refuse(&e))?;
        let until = Instant::now() + RETRY_FOR;
        while let Err(e) = fcntl(&file, FcntlArg::F_SETLK(&whole_file())) {
            if !matches!(e, Errno::EACCES | Errno::EAGAIN) {
                return Err(refuse(&e));
            }
            if Instant::now() > until {
                return Err(Error::AlreadyRunning {
                    robot: robot.to_owned(),
                });
            }
            sleep(Duration::from_millis(10));
        }
        let mut own = Self {
            file,
            written: String::new(),
        };
        own.show("starting").map_err(|e| refuse(&e))?;
        Ok(own)
    }

    /// Shows this text to [`RunningDaemon::state`], up to 250 bytes.
    ///
    /// # Errors
    /// The file system's.
    pub fn show(&mut self, state: &str) -> io::Result<()> {
        if self.written == state {
            return Ok(());
        }
        let mut bytes = [b'\n'; SIZE];
        let end = state.floor_char_boundary(SIZE - 6);
        bytes[..end].copy_from_slice(&state.as_bytes()[..end]);
        self.file.write_all_at(&bytes, 0)?;
        state.clone_into(&mut self.written);
        Ok(())
    }
}

/// A daemon that runs, as far as it can be known without shared memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunningDaemon {
    /// Its robot.
    pub robot: String,
    /// Its process.
    pub pid: i32,
    file: PathBuf,
}

impl RunningDaemon {
    /// Its robot's state, in words; `None` once it has ended.
    #[must_use]
    pub fn state(&self) -> Option<String> {
        let text = fs::read_to_string(&self.file).ok()?;
        let alive = holder(&self.file) == Some(self.pid);
        alive.then(|| text.trim_end().to_owned())
    }

    /// Has the daemon bring its robot to rest and hold it.
    ///
    /// # Errors
    /// It has ended, or belongs to another user.
    pub fn stop_and_hold(&self) -> io::Result<()> {
        if holder(&self.file) != Some(self.pid) {
            return Err(ErrorKind::NotFound.into());
        }
        Ok(kill(Pid::from_raw(self.pid), Signal::SIGUSR1)?)
    }
}

/// The daemons that run in that run directory, by their robots' names. Root may ask in any user's.
///
/// # Errors
/// The directory cannot be read, or is not this user's.
pub fn running_daemons(run_dir: &Path) -> io::Result<Vec<RunningDaemon>> {
    let uid = own_uid();
    let owner = fs::metadata(run_dir)?.uid();
    if uid != 0 && owner != uid {
        return Err(ErrorKind::PermissionDenied.into());
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(run_dir)? {
        let entry = entry?;
        let name = entry.file_name();
        let robot = name.to_str().and_then(|name| name.strip_suffix(SUFFIX));
        let ours = entry
            .metadata()
            .is_ok_and(|data| data.is_file() && data.uid() == owner);
        if let (Some(robot), true) = (robot, ours)
            && let Some(pid) = holder(&entry.path())
        {
            found.push(RunningDaemon {
                robot: robot.to_owned(),
                pid,
                file: entry.path(),
            });
        }
    }
    found.sort_by(|one, other| one.robot.cmp(&other.robot));
    Ok(found)
}

/// Whether other robots' daemons run in the run directory.
pub(crate) fn others_run(location: &Location, robot: &str) -> bool {
    // The own file is not opened: closing it again would give up the own lock.
    let own = path(location.path(), robot);
    let files = fs::read_dir(location.path())
        .into_iter()
        .flatten()
        .flatten();
    let mut files = files.map(|file| file.path()).filter(|path| *path != own);
    files.any(|path| {
        let named = path.to_str().is_some_and(|path| path.ends_with(SUFFIX));
        named && holder(&path).is_some()
    })
}

fn path(run_dir: &Path, robot: &str) -> PathBuf {
    // A robot's name may have any characters.
    run_dir.join(format!("{}{SUFFIX}", robot.replace('/', "_")))
}

/// The process that holds the file's lock, as the kernel names it.
fn holder(path: &Path) -> Option<i32> {
    let file = File::open(path).ok()?;
    let mut lock = whole_file();
    fcntl(&file, FcntlArg::F_GETLK(&mut lock)).ok()?;
    (lock.l_type != libc::F_UNLCK as i16 && lock.l_pid > 0).then_some(lock.l_pid)
}

fn whole_file() -> libc::flock {
    libc::flock {
        l_type: libc::F_WRLCK as i16,
        l_whence: libc::SEEK_SET as i16,
        l_start: 0,
        l_len: 0,
        l_pid: 0,
    }
}
