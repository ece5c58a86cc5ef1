//! Files of the configuration that change while the daemon runs: it goes on with what it has read.

use std::fs;
use std::time::{Duration, Instant, SystemTime};

use recording::AttachedFile;

/// Interval between two looks at the files.
const INTERVAL: Duration = Duration::from_secs(2);

/// Watches the files from which the robot was made.
#[derive(Debug)]
pub struct ChangedFiles {
    files: Vec<Watched>,
    looked: Instant,
}

#[derive(Debug)]
struct Watched {
    file: AttachedFile,
    modified: Option<SystemTime>,
    differs: bool,
}

impl ChangedFiles {
    /// These files, as they were read.
    #[must_use]
    pub fn new(files: &[AttachedFile]) -> Self {
        let watched = |file: &AttachedFile| Watched {
            modified: modified(&file.path),
            file: file.clone(),
            differs: false,
        };
        Self {
            files: files.iter().map(watched).collect(),
            looked: Instant::now(),
        }
    }

    /// Messages about files that have changed since the last look, every two seconds.
    pub fn look(&mut self) -> Vec<String> {
        if self.looked.elapsed() < INTERVAL {
            return Vec::new();
        }
        self.looked = Instant::now();
        self.files.iter_mut().filter_map(Watched::look).collect()
    }
}

impl Watched {
    fn look(&mut self) -> Option<String> {
        let modified = modified(&self.file.path);
        if modified == self.modified {
            return None;
        }
        self.modified = modified;
        // An editor writes in steps, and saves what has not changed: the text counts.
        let text = fs::read(&self.file.path).ok();
        let line = match &text {
            None => None,
            Some(text) => Some(first_difference(
                &self.file.text,
                &String::from_utf8_lossy(text),
            )),
        };
        let path = &self.file.path;
        let differs = line != Some(None);
        if differs == self.differs && !differs {
            return None;
        }
        self.differs = differs;
        Some(match line {
            None => format!(
                "{path} cannot be read any more; the robot runs on with what was read at the start"
            ),
            Some(Some(line)) => format!(
                "{path}:{line} is no longer what was read at the start; the robot runs on with that: `torquectl check`, \
                 then restart the daemon to take the change over"
            ),
            Some(None) => format!("{path} is again what was read at the start"),
        })
    }
}

fn modified(path: &str) -> Option<SystemTime> {
    fs::metadata(path).and_then(|data| data.modified()).ok()
}

/// The first line in which two texts differ, from 1; none where they are the same.
fn first_difference(one: &str, other: &str) -> Option<usize> {
    if one == other {
        return None;
    }
    let same = one
        .lines()
        .zip(other.lines())
        .take_while(|(one, other)| one == other);
    Some(same.count() + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_support::TemporaryDirectory;

    #[test]
    fn a_change_is_said_once_with_its_line_and_so_is_its_end() {
        let directory = TemporaryDirectory::new();
        fs::create_dir_all(directory.path()).expect("made");
        let path = directory.path().join("robot.toml");
        let path = path.to_str().expect("a path").to_owned();
        let text = "a = 1\nb = 2\n";
        let set = |text: &str, seconds: u64| {
            fs::write(&path, text).expect("written");
            let file = fs::File::options().write(true).open(&path).expect("open");
            let time = SystemTime::UNIX_EPOCH + Duration::from_secs(seconds);
            file.set_modified(time).expect("a time");
        };
        set(text, 1);
        let mut watched = Watched {
            file: AttachedFile {
                path: path.clone(),
                text: text.to_owned(),
            },
            modified: modified(&path),
            differs: false,
        };
        assert_eq!(watched.look(), None);
        set(text, 2);
        assert_eq!(watched.look(), None, "saved without a change");
        set("a = 1\nb = 3\n", 3);
        let message = watched.look().expect("a message");
        assert!(
            message.starts_with(&format!("{path}:2 is no longer")),
            "{message}"
        );
        assert_eq!(watched.look(), None, "said once");
        set(text, 4);
        assert!(
            watched
                .look()
                .expect("a message")
                .ends_with("again what was read at the start")
        );
        fs::remove_file(&path).expect("removed");
        assert!(
            watched
                .look()
                .expect("a message")
                .contains("cannot be read")
        );
    }

    #[test]
    fn a_line_that_is_new_at_the_end_is_a_difference() {
        assert_eq!(first_difference("a\n", "a\nb\n"), Some(2));
        assert_eq!(first_difference("a\n", "a\n"), None);
    }
}
