//! Helpers of the tests of both ends.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::{scope, sleep};
use std::time::Duration;

use torqued_client::robot_state::{Description, Name, SharedRecord};
use torqued_client::{Client, DaemonPorts, Location};

/// A run directory of a test's own.
pub(crate) struct RunDir {
    pub(crate) location: Location,
}

impl RunDir {
    pub(crate) fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let path: PathBuf =
            std::env::temp_dir().join(format!("torqued-test-{}-{number}", std::process::id()));
        Self {
            location: Location::at(path).expect("a run directory"),
        }
    }
}

impl Drop for RunDir {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(self.location.path());
        // The transport keeps one small file per run directory for ever.
        let prefix = self.location.shared_memory_prefix();
        for file in std::fs::read_dir("/dev/shm")
            .into_iter()
            .flatten()
            .flatten()
        {
            if file.file_name().to_string_lossy().starts_with(&prefix) {
                let _ = std::fs::remove_file(file.path());
            }
        }
    }
}

pub(crate) fn description(robot: &str, joints: u32) -> Description {
    Description {
        robot: Name::new(robot),
        joint_count: joints,
        ..Description::default()
    }
}

/// A record with something of its own in its first, middle and last places.
pub(crate) fn record(sequence: u64) -> SharedRecord {
    let mut record = SharedRecord::default();
    record.cycle.sequence = sequence;
    record.cycle.estimated.joints[5].tau_whole_body.tau = sequence as f64 * 0.25;
    record.timing.frames_sent = !sequence;
    record
}

/// Connects a client while the daemon's end keeps house, as the daemon does all the time.
pub(crate) fn connect(dir: &RunDir, ports: &DaemonPorts, robot: &str) -> Client {
    let done = AtomicBool::new(false);
    scope(|threads| {
        threads.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                ports.cleanup_dead_clients();
                sleep(Duration::from_millis(1));
            }
        });
        let client = Client::connect_at(&dir.location, robot, Duration::from_secs(5));
        done.store(true, Ordering::Relaxed);
        client.expect("a daemon runs")
    })
}
