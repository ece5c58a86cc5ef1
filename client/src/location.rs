//! The directory in which daemon and clients meet.

use std::fs;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

use iceoryx2::config::Config;
use iceoryx2::prelude::{FileName, SemanticString};

use crate::error::Error;
use crate::names;
use crate::room::SHARED_MEMORY;

/// The variable that overrides the run directory.
const VARIABLE: &str = "TORQUED_RUN_DIR";
const SYSTEM_DIR: &str = "/run/torqued";
/// Mode bits that let other users write.
const OTHERS_WRITE: u32 = 0o022;

/// The run directory, in which daemon and clients find each other. Only one user's processes meet
/// in it, and no other user may write into it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Location {
    path: PathBuf,
    owner: u32,
    names: String,
}

impl Location {
    /// The default: `$TORQUED_RUN_DIR`; else `/run/torqued` for root and for the user that owns
    /// it; else `$XDG_RUNTIME_DIR/torqued`; else `~/.local/state/torqued/run`; else
    /// `/tmp/torqued-<uid>`.
    ///
    /// # Errors
    /// [`Error::RunDirectory`].
    pub fn find() -> Result<Self, Error> {
        Self::at(Self::default_path())
    }

    /// The path of the default, whether or not it can be used: see [`find`](Self::find).
    #[must_use]
    pub fn default_path() -> PathBuf {
        let set = |variable| std::env::var_os(variable).filter(|value| !value.is_empty());
        if let Some(path) = set(VARIABLE) {
            return path.into();
        }
        let uid = own_uid();
        if uid == 0 || fs::metadata(SYSTEM_DIR).is_ok_and(|m| m.uid() == uid) {
            return SYSTEM_DIR.into();
        }
        if let Some(path) = set("XDG_RUNTIME_DIR") {
            return Path::new(&path).join("torqued");
        }
        // In /tmp another user could be there first.
        match set("HOME") {
            Some(path) => Path::new(&path).join(".local/state/torqued/run"),
            None => format!("/tmp/torqued-{uid}").into(),
        }
    }

    /// That directory; made if it is missing.
    ///
    /// # Errors
    /// [`Error::RunDirectory`] if it cannot be made, belongs to another user, or others may write
    /// into it.
    pub fn at(path: impl Into<PathBuf>) -> Result<Self, Error> {
        let path = path.into();
        let refuse = |reason: String| Error::RunDirectory {
            path: path.clone(),
            reason,
        };
        fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&path)
            .map_err(|e| refuse(format!("cannot be made ({e})")))?;
        // Daemon and clients must spell the path alike: its hash is in `shared_memory_prefix`.
        let real = path.canonicalize().map_err(|e| refuse(e.to_string()))?;
        let data = fs::metadata(&real).map_err(|e| refuse(e.to_string()))?;
        let (owner, uid) = (data.uid(), own_uid());
        if owner != uid {
            return Err(refuse(format!(
                "belongs to user {owner}, this program runs as {uid}"
            )));
        }
        if data.mode() & OTHERS_WRITE != 0 {
            return Err(refuse(format!(
                "other users may write into it (mode {:03o}): `chmod go-w {}`",
                data.mode() & 0o777,
                real.display()
            )));
        }
        let names = names::of(&real).map_err(|e| refuse(format!("cannot be used: {e}")))?;
        Ok(Self {
            path: real,
            owner,
            names,
        })
    }

    /// Gives the directory's objects in shared memory other names from now on, and removes what its
    /// owner's processes have left under the old ones.
    pub(crate) fn rename_objects(&mut self) -> Result<(), Error> {
        let old = self.shared_memory_prefix();
        self.names = names::renew(&self.path).map_err(|e| Error::RunDirectory {
            path: self.path.clone(),
            reason: format!("cannot be used: {e}"),
        })?;
        let objects = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
        for object in objects {
            if object.file_name().to_string_lossy().starts_with(&old) {
                // Others' stay: in this directory nobody removes a file of somebody else.
                let _ = fs::remove_file(object.path());
            }
        }
        Ok(())
    }

    /// The user whose directory it is.
    pub(crate) fn owner(&self) -> u32 {
        self.owner
    }

    /// The directory.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The transport's configuration: root path and prefix of our own, so that other users'
    /// services, permissions and leftovers have no effect.
    pub(crate) fn config(&self) -> Result<Config, Error> {
        let refuse = |e: &dyn std::fmt::Debug| Error::RunDirectory {
            path: self.path.clone(),
            reason: format!("is not allowed as a root path ({e:?})"),
        };
        let bytes = self.path.as_os_str().as_encoded_bytes();
        let root = iceoryx2::prelude::Path::new(bytes).map_err(|e| refuse(&e))?;
        let mut config = Config::default();
        config.global.set_root_path(&root);
        config.global.prefix =
            FileName::new(self.shared_memory_prefix().as_bytes()).map_err(|e| refuse(&e))?;
        Ok(config)
    }

    /// Prefix of the names of this directory's shared memory objects. Those of all directories lie
    /// together in `/dev/shm`: the path's hash (32-bit FNV-1a) distinguishes them, and a random text
    /// keeps other users from foreseeing them.
    #[must_use]
    pub fn shared_memory_prefix(&self) -> String {
        let bytes = self.path.as_os_str().as_encoded_bytes();
        let hash = bytes.iter().fold(0x811c_9dc5_u32, |hash, byte| {
            (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193)
        });
        format!("torqued_{hash:08x}_{}_", self.names)
    }
}

pub(crate) fn own_uid() -> u32 {
    // The owner of a process's own entry is its effective user.
    fs::metadata("/proc/self").map_or(u32::MAX, |m| m.uid())
}
