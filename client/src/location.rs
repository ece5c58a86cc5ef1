//! The directory in which daemon and clients meet.

use std::fs;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

use iceoryx2::config::Config;
use iceoryx2::prelude::{FileName, SemanticString};

use crate::error::Error;

/// The variable that overrides the run directory.
const VARIABLE: &str = "TORQUED_RUN_DIR";
const SYSTEM_DIR: &str = "/run/torqued";

/// The run directory, in which daemon and clients find each other. Only one user's processes meet
/// in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Location {
    path: PathBuf,
}

impl Location {
    /// The default: `$TORQUED_RUN_DIR`; else `/run/torqued` for root and for the user that owns
    /// it; else `$XDG_RUNTIME_DIR/torqued`; else `/tmp/torqued-<uid>`.
    ///
    /// # Errors
    /// [`Error::RunDirectory`].
    pub fn find() -> Result<Self, Error> {
        let set = |variable| std::env::var_os(variable).filter(|value| !value.is_empty());
        if let Some(path) = set(VARIABLE) {
            return Self::at(path);
        }
        let uid = own_uid();
        if uid == 0 || fs::metadata(SYSTEM_DIR).is_ok_and(|m| m.uid() == uid) {
            return Self::at(SYSTEM_DIR);
        }
        match set("XDG_RUNTIME_DIR") {
            Some(path) => Self::at(Path::new(&path).join("torqued")),
            None => Self::at(format!("/tmp/torqued-{uid}")),
        }
    }

    /// That directory; made if it is missing.
    ///
    /// # Errors
    /// [`Error::RunDirectory`] if it cannot be made or belongs to another user.
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
        let owner = fs::metadata(&real)
            .map_err(|e| refuse(e.to_string()))?
            .uid();
        let uid = own_uid();
        if owner != uid {
            return Err(refuse(format!(
                "belongs to user {owner}, this program runs as {uid}"
            )));
        }
        Ok(Self { path: real })
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
    /// together in `/dev/shm`: the path's hash (32-bit FNV-1a) distinguishes them.
    #[must_use]
    pub fn shared_memory_prefix(&self) -> String {
        let bytes = self.path.as_os_str().as_encoded_bytes();
        let hash = bytes.iter().fold(0x811c_9dc5_u32, |hash, byte| {
            (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193)
        });
        format!("torqued_{hash:08x}_")
    }
}

fn own_uid() -> u32 {
    // The owner of a process's own entry is its effective user.
    fs::metadata("/proc/self").map_or(u32::MAX, |m| m.uid())
}
