//! Shared by the tests of torquectl: beside a daemon's end of shared memory, and on recordings of simulated robots.
#![allow(dead_code, reason = "each test binary uses a part")]

use std::path::Path;
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{scope, sleep};
use std::time::Duration;
use test_support::TemporaryDirectory;
use torqued::demo::{self, DemoOptions};
use torqued_client::robot_state::{Description, SharedRecord};
use torqued_client::{DaemonPorts, Location};

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

    /// `torquectl` with these arguments, in this run directory.
    pub(crate) fn torquectl(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_torquectl"));
        command.args(arguments.split_whitespace());
        command.env("TORQUED_RUN_DIR", self.location.path());
        command
    }

    /// Runs a command while a daemon's end publishes `record` and calls `serve` each millisecond.
    pub(crate) fn beside_daemon(
        &self,
        command: &mut Command,
        description: &Description,
        mut record: SharedRecord,
        serve: impl Fn(&DaemonPorts, &mut SharedRecord) + Sync,
    ) -> Output {
        let ports = DaemonPorts::create(&self.location, description).expect("the daemon's end");
        let done = AtomicBool::new(false);
        scope(|threads| {
            threads.spawn(|| {
                while !done.load(Ordering::Relaxed) {
                    record.cycle.sequence += 1;
                    ports.publish(&record).expect("published");
                    serve(&ports, &mut record);
                    sleep(Duration::from_millis(1));
                }
            });
            let output = command.output();
            done.store(true, Ordering::Relaxed);
            output.expect("torquectl starts")
        })
    }
}

/// Printed text.
pub(crate) fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).expect("UTF-8")
}

/// Runs `torquectl` in a folder, which must end with this exit code; gives what it printed.
pub(crate) fn expect(folder: &Path, arguments: &str, code: i32) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_torquectl"))
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let both = text(&output.stdout) + &text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments}\n{both}");
    both
}

/// Records `run.mcap` in a folder: the daemon's loop in front of a simulated robot in the folder's `motion.toml`.
pub(crate) fn record_demo(folder: &Path, robot: String, seconds: f64, seed: u64) {
    demo::run(&DemoOptions {
        robot,
        uncalibrated: false,
        seconds,
        plot: None,
        joints: Vec::new(),
        json: true,
        fast: true,
        seed: Some(seed),
        motion: Some(folder.join("motion.toml")),
        harness: None,
        record: Some(folder.join("run.mcap")),
    })
    .map_err(|failure| failure.message)
    .unwrap();
}
