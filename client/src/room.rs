//! Room in shared memory, taken before it is used.
//!
//! Files in `/dev/shm` begin without memory, which each page gets when it is first touched; where
//! none is left then, the process that touched it is ended by SIGBUS. So whoever makes such files
//! has the kernel give them all their memory at once, and is refused where that is not there.

use std::fs::OpenOptions;
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;

use iceoryx2::prelude::*;
use nix::errno::Errno;
use nix::fcntl::posix_fallocate;
use nix::sys::statvfs::statvfs;

use crate::error::Error;
use crate::location::Location;

/// Where the system keeps shared memory objects.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
/// Room for the small files that a process makes while it connects, bytes.
const CONNECTING: u64 = 1 << 20;
/// Files that a process makes while it connects, at most.
const FILES: u64 = 128;

/// Refuses to connect where shared memory is full.
pub(crate) fn check() -> Result<(), Error> {
    // Without an answer the attempt itself will show.
    let Ok(status) = statvfs(SHARED_MEMORY) else {
        return Ok(());
    };
    // A tmpfs without a limit has no size.
    let free = status.blocks_available() * status.fragment_size();
    let files = status.files_available();
    if status.files() != 0 && files < FILES {
        return Err(Error::NoFiles {
            free: files,
            needed: FILES,
        });
    }
    if status.blocks() == 0 || free >= CONNECTING {
        return Ok(());
    }
    Err(Error::NoRoom {
        free,
        needed: CONNECTING,
    })
}

/// Gives memory to all files of the node's run directory.
pub(crate) fn reserve<S: Service>(node: &Node<S>) -> Result<(), Error> {
    let prefix = node.config().global.prefix.to_string();
    let files = std::fs::read_dir(SHARED_MEMORY)
        .into_iter()
        .flatten()
        .flatten();
    for file in files {
        if !file.file_name().to_string_lossy().starts_with(&prefix) {
            continue;
        }
        // Other processes remove theirs meanwhile; files that cannot be written are complete.
        let Ok(open) = OpenOptions::new().read(true).write(true).open(file.path()) else {
            continue;
        };
        let needed = open.metadata().map_or(0, |data| data.len());
        if needed > 0 {
            fill(&open, needed)?;
        }
    }
    Ok(())
}

/// A file of another user among those of the run directory, with that user's number: such names
/// are free to all users.
pub(crate) fn foreign_file(location: &Location) -> Option<(PathBuf, u32)> {
    let owner = location.owner();
    let prefix = location.shared_memory_prefix();
    let mut files = std::fs::read_dir(SHARED_MEMORY).ok()?.flatten();
    files.find_map(|file| {
        let user = file.metadata().ok()?.uid();
        let ours = file.file_name().to_string_lossy().starts_with(&prefix);
        (ours && user != owner).then(|| (file.path(), user))
    })
}

fn fill(file: &std::fs::File, needed: u64) -> Result<(), Error> {
    loop {
        match posix_fallocate(file, 0, needed as i64) {
            Err(Errno::EINTR) => {}
            Err(Errno::ENOSPC | Errno::ENOMEM) => {
                let free =
                    statvfs(SHARED_MEMORY).map_or(0, |s| s.blocks_available() * s.fragment_size());
                return Err(Error::NoRoom { free, needed });
            }
            // A file system that cannot: as before.
            _ => return Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_support::TemporaryDirectory;

    #[test]
    fn a_file_of_another_user_is_named() {
        const OTHER: u32 = 65_534;
        let directory = TemporaryDirectory::new();
        let location = Location::at(directory.path()).expect("a run directory");
        let name = format!("{}squatted", location.shared_memory_prefix());
        let path = PathBuf::from(SHARED_MEMORY).join(name);
        std::fs::write(&path, "").expect("written");
        assert_eq!(foreign_file(&location), None);
        let given = std::os::unix::fs::chown(&path, Some(OTHER), None);
        let found = foreign_file(&location);
        std::fs::remove_file(&path).expect("removed");
        match given {
            Ok(()) => assert_eq!(found, Some((path, OTHER))),
            Err(_) => println!("skipped: only root gives files away"),
        }
    }
}
