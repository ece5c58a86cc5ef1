//! Helpers of the tests of both ends.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{scope, sleep};
use std::time::Duration;

use nix::time::{ClockId, clock_gettime};
use supervisor::Commanders;
use test_support::TemporaryDirectory;
use torqued_client::robot_state::{Description, Name, Reference, SharedRecord};
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

/// Lets a daemon's loop decide who commands, once a millisecond, while `act` runs. `change`
/// changes its records before they are published. Also gives the references that it has followed.
pub(crate) fn while_led<T>(
    ports: &DaemonPorts,
    reference_timeout: f64,
    change: impl Fn(&mut SharedRecord) + Sync,
    act: impl FnOnce() -> T,
) -> (T, Vec<Reference>) {
    let done = AtomicBool::new(false);
    scope(|threads| {
        let leading = threads.spawn(|| {
            let mut commanders = Commanders::new(reference_timeout);
            let mut followed: Vec<Reference> = Vec::new();
            let mut sequence = 0;
            while !done.load(Ordering::Relaxed) {
                sequence += 1;
                let mut record = record(sequence);
                let now_ns = monotonic_ns();
                while let Some(reference) = ports.next_reference().expect("received") {
                    commanders.offer(&reference, now_ns);
                }
                commanders.begin_cycle(now_ns);
                record.cycle.commander = commanders.record();
                if let Some(reference) = commanders.reference() {
                    record.cycle.commander.sequence = reference.sequence;
                    let before = followed.last().map(|r| (r.session, r.sequence));
                    if before != Some((reference.session, reference.sequence)) {
                        followed.push(*reference);
                    }
                }
                change(&mut record);
                ports.publish(&record).expect("published");
                ports.cleanup_dead_clients();
                sleep(Duration::from_millis(1));
            }
            followed
        });
        // Also when `act` panics: the thread is joined.
        let result = catch_unwind(AssertUnwindSafe(act));
        // The loop is to see what was sent last.
        sleep(Duration::from_millis(50));
        done.store(true, Ordering::Relaxed);
        let followed = leading.join().expect("led");
        (
            result.unwrap_or_else(|panic| resume_unwind(panic)),
            followed,
        )
    })
}

fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC).expect("a clock");
    now.tv_sec().unsigned_abs() * 1_000_000_000 + now.tv_nsec().unsigned_abs()
}
