//! Directories of tests.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// A directory of one test. Dropping it removes it, and the shared memory of its programs.
#[derive(Debug)]
pub struct TemporaryDirectory {
    path: PathBuf,
    shared_memory_prefix: Option<String>,
}

impl TemporaryDirectory {
    /// The name of a new directory, which is not created yet.
    #[must_use]
    #[expect(clippy::new_without_default, reason = "each call names another one")]
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("torqued-test-{}-{number}", std::process::id());
        Self {
            path: std::env::temp_dir().join(name),
            shared_memory_prefix: None,
        }
    }

    /// Its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Removes the files of `/dev/shm` with this prefix too: iceoryx2 keeps one per run directory.
    #[must_use]
    pub fn with_shared_memory(mut self, prefix: String) -> Self {
        self.shared_memory_prefix = Some(prefix);
        self
    }
}

impl Drop for TemporaryDirectory {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.path);
        let Some(prefix) = &self.shared_memory_prefix else {
            return;
        };
        let objects = std::fs::read_dir("/dev/shm").into_iter().flatten();
        for object in objects.flatten() {
            if object.file_name().to_string_lossy().starts_with(prefix) {
                let _ = std::fs::remove_file(object.path());
            }
        }
    }
}
