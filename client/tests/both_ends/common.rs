//! Helpers of the tests of both ends.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{scope, sleep};
use std::time::Duration;

use test_support::TemporaryDirectory;
use torqued_client::robot_state::{Description, Name, SharedRecord};
use torqued_client::{Client, DaemonPorts, Location};

/// A run directory of one test.
pub(crate) struct RunDir {
    pub(crate) location: Location,
    _directory: TemporaryDirectory,
}

impl RunDir {
    pub(crate) fn new() -> Self {
        let directory = TemporaryDirectory::new();
        let location = Location::at(directory.path()).expect("a run directory");
        let prefix = location.shared_memory_prefix();
        Self {
            location,
            _directory: directory.with_shared_memory(prefix),
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

/// Connects a client while the daemon's end cleans up dead clients, as the daemon does all the time.
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
