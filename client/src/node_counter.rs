//! The one object of iceoryx2 that it opens to all users, kept for the run directory's owner alone.
//!
//! iceoryx2 counts its nodes in a small object in `/dev/shm` that every process reads before it can
//! create one. It gives that object mode 0666: any user could write into it, and no program of this
//! user could connect any more. So this object is made here, with mode 0600, before iceoryx2 would
//! make it, and looked at again whenever a program connects and while the daemon runs.

use std::fs::{self, File, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use crate::location::Location;
use crate::names;
use crate::room::SHARED_MEMORY;

/// End of the object's name: iceoryx2's hash of its type, its name and its version.
const NAME: &str = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt";
/// End of the names of such objects in all versions.
const SUFFIX: &str = ".global_mgmt";
/// The object: iceoryx2's version (major << 32 | minor << 16 | patch), then the count of nodes.
const CONTENT: [u8; 16] = content(10 << 16);
const OTHERS: u32 = 0o077;

const fn content(version: u64) -> [u8; 16] {
    let mut out = [0; 16];
    let bytes = version.to_ne_bytes();
    let mut i = 0;
    while i < bytes.len() {
        out[i] = bytes[i];
        i += 1;
    }
    out
}

/// Makes the object, if it is missing; replaces one that other users can open, or have opened.
pub(crate) fn make_private(location: &Location) -> io::Result<()> {
    let prefix = location.shared_memory_prefix();
    let path = Path::new(SHARED_MEMORY).join(format!("{prefix}{NAME}"));
    match fs::symlink_metadata(&path) {
        Ok(data) if is_private(&data, location)? => return Ok(()),
        // Not only its mode: somebody may have opened it before, and still write into it.
        Ok(_) => fs::rename(write_new(&prefix)?, &path)?,
        Err(e) if e.kind() == ErrorKind::NotFound => {
            let new = write_new(&prefix)?;
            let linked = fs::hard_link(&new, &path);
            fs::remove_file(&new)?;
            match linked {
                Err(e) if e.kind() != ErrorKind::AlreadyExists => return Err(e),
                _ => {}
            }
        }
        Err(e) => return Err(e),
    }
    if is_private(&fs::symlink_metadata(&path)?, location)? {
        Ok(())
    } else {
        Err(io::Error::from(ErrorKind::PermissionDenied))
    }
}

/// Closes all such objects of the run directory to other users, and gives those that were open to
/// them. To be called after a node was created, and while the daemon runs: another version of
/// iceoryx2, or its Python binding, may have made one.
pub(crate) fn close_to_others(location: &Location) -> Vec<PathBuf> {
    let prefix = location.shared_memory_prefix();
    let objects = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
    let open = objects.filter(|object| {
        let name = object.file_name();
        let name = name.to_string_lossy();
        let ours = name.starts_with(&prefix) && name.ends_with(SUFFIX);
        let data = object.metadata().ok().filter(|_| ours);
        data.is_some_and(|data| {
            data.is_file() && data.mode() & OTHERS != 0 && data.uid() == location.owner()
        })
    });
    let paths: Vec<PathBuf> = open.map(|object| object.path()).collect();
    // First the one in use, which somebody may have opened already: it is replaced.
    let _ = make_private(location);
    for path in &paths {
        let _ = fs::set_permissions(path, Permissions::from_mode(0o600));
    }
    paths
}

fn is_private(data: &fs::Metadata, location: &Location) -> io::Result<bool> {
    let whole = data.is_file() && data.len() == CONTENT.len() as u64;
    if data.uid() != location.owner() {
        return Err(io::Error::from(ErrorKind::PermissionDenied));
    }
    Ok(whole && data.mode() & 0o777 == 0o600)
}

/// A new object under a name of its own.
fn write_new(prefix: &str) -> io::Result<PathBuf> {
    let path = Path::new(SHARED_MEMORY).join(format!("{prefix}{}.new", names::random()));
    let mut file = File::options()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&path)?;
    file.write_all(&CONTENT)?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel;
    use crate::daemon_ports::DaemonPorts;
    use crate::error::Error;
    use robot_state::{Description, Name};
    use test_support::TemporaryDirectory;

    /// The objects of that run directory, with their modes.
    fn objects(location: &Location) -> Vec<(PathBuf, u32, u64)> {
        let prefix = location.shared_memory_prefix();
        let files = fs::read_dir(SHARED_MEMORY).expect("readable").flatten();
        let ours = files.filter(|file| file.file_name().to_string_lossy().starts_with(&prefix));
        ours.map(|file| {
            let data = file.metadata().expect("there");
            (file.path(), data.mode() & 0o777, data.ino())
        })
        .collect()
    }

    #[test]
    fn iceoryx2_uses_the_private_object_and_makes_none_of_its_own() {
        let directory = TemporaryDirectory::new();
        let location = Location::at(directory.path()).expect("a run directory");
        let directory = directory.with_shared_memory(location.shared_memory_prefix());
        make_private(&location).expect("made");
        let before = objects(&location);
        assert_eq!(before.len(), 1, "{before:?}");
        drop(channel::create_node(&location).expect("a node"));
        let after = objects(&location);
        // With another name or content of the object, as of another iceoryx2, there would be two.
        assert_eq!(after, before);
        assert_eq!(after[0].1, 0o600);
        let content = fs::read(&after[0].0).expect("readable");
        assert_eq!(content[..8], CONTENT[..8]);
        assert!(
            content[8..12] != [0; 4],
            "iceoryx2 has counted: {content:?}"
        );

        // One that was open is replaced, and another version's is closed.
        let other = PathBuf::from(format!(
            "{SHARED_MEMORY}/{}other{SUFFIX}",
            location.shared_memory_prefix()
        ));
        fs::write(&other, CONTENT).expect("written");
        for path in [&other, &after[0].0] {
            fs::set_permissions(path, Permissions::from_mode(0o666)).expect("opened");
        }
        let mut closed = close_to_others(&location);
        closed.sort();
        let mut expected = vec![other, after[0].0.clone()];
        expected.sort();
        assert_eq!(closed, expected);
        let modes: Vec<u32> = objects(&location).iter().map(|o| o.1).collect();
        assert_eq!(modes, [0o600, 0o600]);
        let replaced = fs::metadata(&after[0].0).expect("there").ino();
        assert_ne!(replaced, after[0].2);
        drop(channel::create_node(&location).expect("a node"));
        drop(directory);
    }

    #[test]
    fn a_daemon_takes_other_names_where_another_user_has_taken_one() {
        let directory = TemporaryDirectory::new();
        let location = Location::at(directory.path()).expect("a run directory");
        let old = location.shared_memory_prefix();
        let taken = PathBuf::from(format!("{SHARED_MEMORY}/{old}{NAME}"));
        fs::write(&taken, CONTENT).expect("written");
        if std::os::unix::fs::chown(&taken, Some(65_534), None).is_err() {
            println!("skipped: only root gives files away");
            fs::remove_file(&taken).expect("removed");
            return;
        }
        let refusal = channel::create_node(&location).expect_err("taken");
        let description = Description {
            robot: Name::new("leg"),
            ..Description::default()
        };
        let ports = DaemonPorts::create(&location, &description);
        let renewed = Location::at(directory.path()).expect("a run directory");
        let _ = fs::remove_file(&taken);
        let _directory = directory.with_shared_memory(renewed.shared_memory_prefix());
        assert!(
            matches!(&refusal, Error::ForeignFile { user: 65_534, .. }),
            "{refusal}"
        );
        ports.expect("other names");
        assert_ne!(renewed.shared_memory_prefix(), old);
    }
}
