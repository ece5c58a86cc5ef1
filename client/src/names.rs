//! Names of shared memory that no other user can foresee.
//!
//! All users may make files in `/dev/shm`, and read the names of those that are there. A name that
//! can be foreseen can be taken: so the names of a run directory's objects begin with a random text,
//! which lies in the run directory, where only its owner reads it.

use std::fs::{self, File};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// The file in the run directory.
const FILE: &str = "shared_memory_names";
/// Hexadecimal digits of the text.
const DIGITS: usize = 16;

/// The text of that run directory; made by whoever comes first.
pub(crate) fn of(directory: &Path) -> io::Result<String> {
    match read(directory) {
        Err(e) if e.kind() == ErrorKind::NotFound => {
            let new = write_new(directory)?;
            // Whole at once, and never in the place of another's.
            let linked = fs::hard_link(&new, directory.join(FILE));
            fs::remove_file(&new)?;
            match linked {
                Err(e) if e.kind() != ErrorKind::AlreadyExists => Err(e),
                _ => read(directory),
            }
        }
        other => other,
    }
}

/// Another text from now on.
pub(crate) fn renew(directory: &Path) -> io::Result<String> {
    fs::rename(write_new(directory)?, directory.join(FILE))?;
    read(directory)
}

fn read(directory: &Path) -> io::Result<String> {
    let text = fs::read_to_string(directory.join(FILE))?;
    let text = text.trim();
    if text.len() == DIGITS && text.bytes().all(|byte| byte.is_ascii_hexdigit()) {
        return Ok(text.to_owned());
    }
    Err(io::Error::other(format!(
        "its file {FILE} has no {DIGITS} hexadecimal digits: remove that file while no torqued runs"
    )))
}

fn write_new(directory: &Path) -> io::Result<std::path::PathBuf> {
    let path = directory.join(format!("{FILE}.{}", random()));
    let mut options = File::options();
    let mut file = options
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&path)?;
    file.write_all(format!("{}\n", random()).as_bytes())?;
    Ok(path)
}

/// Hexadecimal digits that nobody knows: the keys of `RandomState` are the system's random bytes.
pub(crate) fn random() -> String {
    format!("{:016x}", RandomState::new().build_hasher().finish())
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_support::TemporaryDirectory;

    #[test]
    fn programs_that_meet_have_one_text_until_it_is_renewed() {
        let directory = TemporaryDirectory::new();
        fs::create_dir(directory.path()).expect("made");
        let found: Vec<String> = std::thread::scope(|threads| {
            let all: Vec<_> = (0..8)
                .map(|_| threads.spawn(|| of(directory.path()).expect("a text")))
                .collect();
            all.into_iter()
                .map(|one| one.join().expect("ended"))
                .collect()
        });
        assert!(found.iter().all(|text| *text == found[0]), "{found:?}");
        let renewed = renew(directory.path()).expect("renewed");
        assert_ne!(renewed, found[0]);
        assert_eq!(of(directory.path()).expect("a text"), renewed);
        let files = fs::read_dir(directory.path()).expect("readable").count();
        assert_eq!(files, 1, "nothing else is left");
        fs::write(directory.path().join(FILE), "../../etc/passwd\n").expect("written");
        let refusal = of(directory.path()).expect_err("no digits").to_string();
        assert!(refusal.contains("remove that file"), "{refusal}");
    }
}
