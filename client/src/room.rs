//! Room in shared memory, taken before it is used.
//!
//! Files in `/dev/shm` begin without memory, which each page gets when it is first touched; where
//! none is left then, the process that touched it is ended by SIGBUS. So whoever makes such files
//! has the kernel give them all their memory at once, and is refused where that is not there.

use std::fs::OpenOptions;

use iceoryx2::prelude::*;
use nix::errno::Errno;
use nix::fcntl::posix_fallocate;
use nix::sys::statvfs::statvfs;

use crate::channel::Transport;
use crate::error::Error;

const SHARED_MEMORY: &str = "/dev/shm";
/// Room for the small files that a process makes while it connects, bytes.
const CONNECTING: u64 = 1 << 20;

/// Refuses to connect where shared memory is full.
pub(crate) fn check() -> Result<(), Error> {
    // Without an answer the attempt itself will show.
    let Ok(status) = statvfs(SHARED_MEMORY) else {
        return Ok(());
    };
    // A tmpfs without a limit has no size.
    let free = status.blocks_available() * status.fragment_size();
    match status.blocks() == 0 || free >= CONNECTING {
        true => Ok(()),
        false => Err(Error::NoRoom {
            free,
            needed: CONNECTING,
        }),
    }
}

/// Gives memory to all files of the node's run directory.
pub(crate) fn reserve(node: &Node<Transport>) -> Result<(), Error> {
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
