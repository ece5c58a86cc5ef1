//! The leg on vcan as processes of its own, and what its records show.

pub(crate) mod table;

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use test_support::{TemporaryDirectory, project_path};
use torqued_client::robot_state::{RobotState, SharedRecord, measured_flags};
use torqued_client::{Client, Error, Location};

/// Longest wait for anything.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);
const POLL: Duration = Duration::from_millis(2);
/// User-Mode Linux needs some 2 ms where a real kernel needs 0.1 ms. The time-out of references
/// stays that of the configuration.
const SLOW: [(&str, &str); 3] = [
    ("rate_hz = 1000.0", "rate_hz = 200.0"),
    ("gather_deadline_us = 750.0", "gather_deadline_us = 4500.0"),
    ("stale_after_ms = 20.0", "stale_after_ms = 200.0"),
];

/// A running program; killed with SIGKILL when dropped.
pub(crate) struct Process {
    child: Child,
    output: PathBuf,
}

impl Process {
    fn start(rig: &Rig, program: &str, arguments: &[&str]) -> Self {
        static COUNT: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        let number = COUNT.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let output = rig.directory.path().join(format!("output-{number}"));
        let file = File::create(&output).expect("a file");
        let mut command = Command::new(binaries().join(program));
        command.args(arguments).stdin(Stdio::null());
        command
            .stdout(file.try_clone().expect("a file"))
            .stderr(file);
        command.env("TORQUED_RUN_DIR", rig.location.path());
        command.env("XDG_STATE_HOME", rig.directory.path().join("state"));
        let child = command.spawn();
        let child = child.unwrap_or_else(|e| panic!("{program}: {e}"));
        Self { child, output }
    }

    /// Waits until its output has these words.
    fn wait_for(mut self, words: &str) -> Self {
        let until = Instant::now() + PATIENCE;
        while !self.output().contains(words) {
            let ended = self.has_ended();
            assert!(
                !ended && Instant::now() < until,
                "no '{words}': {}",
                self.output()
            );
            sleep(POLL);
        }
        self
    }

    pub(crate) fn output(&self) -> String {
        fs::read_to_string(&self.output).expect("its output")
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(crate) fn has_ended(&mut self) -> bool {
        self.child.try_wait().expect("its state").is_some()
    }

    pub(crate) fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(self.child.id().cast_signed()), signal).expect("signalled");
    }

    pub(crate) fn wait(&mut self) -> ExitStatus {
        self.child.wait().expect("ended")
    }

    /// Ends it as systemd does.
    pub(crate) fn terminate(mut self) {
        self.signal(Signal::SIGTERM);
        let status = self.wait();
        assert!(status.success(), "{status}: {}", self.output());
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = fs::remove_file(&self.output);
    }
}

/// The folder of the programs.
fn binaries() -> PathBuf {
    let default = || PathBuf::from(project_path("target/debug"));
    std::env::var_os("TORQUED_BINARIES").map_or_else(default, PathBuf::from)
}

/// A run directory and a configuration for this kernel.
pub(crate) struct Rig {
    directory: TemporaryDirectory,
    pub(crate) location: Location,
    config: String,
}

impl Rig {
    pub(crate) fn new() -> Self {
        Self::with(&[])
    }

    /// Where no time-out is tested: a commander that this kernel leaves waiting keeps the command.
    pub(crate) fn with_long_lease() -> Self {
        Self::with(&[(
            "reference_timeout_ms = 40.0",
            "reference_timeout_ms = 1000.0",
        )])
    }

    /// The leg, with other words in its configuration.
    fn with(changes: &[(&str, &str)]) -> Self {
        let directory = TemporaryDirectory::new();
        let location = Location::at(directory.path().join("run")).expect("a run directory");
        let prefix = location.shared_memory_prefix();
        let folder = project_path("config/leg");
        let mut text = fs::read_to_string(format!("{folder}/robot.toml")).expect("the leg");
        let slow: &[_] = if is_virtual() { &SLOW } else { &[] };
        for (old, new) in slow.iter().chain(changes) {
            assert!(text.contains(old), "{old}");
            text = text.replace(old, new);
        }
        // Relative paths refer to the folder of the original.
        let absolute = |text: &str| text.replace("\"../", &format!("\"{folder}/../"));
        let path = directory.path().join("robot.toml");
        fs::write(&path, absolute(&text)).expect("written");
        let sim = fs::read_to_string(format!("{folder}/sim.toml")).expect("its simulation");
        fs::write(directory.path().join("sim.toml"), absolute(&sim)).expect("written");
        Self {
            directory: directory.with_shared_memory(prefix),
            location,
            config: path.to_str().expect("text").to_owned(),
        }
    }

    pub(crate) fn simulator(&self) -> Process {
        Process::start(self, "torqued-sim", &[&self.config, "--json"]).wait_for("ready")
    }

    pub(crate) fn daemon(&self) -> Process {
        Process::start(self, "torqued", &["run", &self.config, "--json"]).wait_for("running")
    }

    pub(crate) fn client(&self) -> Client {
        Client::connect_at(&self.location, "leg", PATIENCE).expect("a daemon runs")
    }

    /// Starts a compiled client, which moves the first joint to and fro by inverse dynamics for five
    /// seconds, and waits until it is followed. Also gives the number of clients before it that had
    /// lost the command again by then, because this kernel had left them waiting for too long.
    pub(crate) fn commander(&self, client: &mut Client) -> (Process, usize) {
        for lost in 0..20 {
            let mut commander = Process::start(self, "examples/02_send_references", &["leg"]);
            while !commander.has_ended() {
                let record = client.next_record(PATIENCE).expect("a record");
                if record.cycle.mode == 2 && record.cycle.commander.pid == commander.id() {
                    return (commander, lost);
                }
            }
        }
        panic!("no commander keeps the command on this kernel");
    }

    /// Files in the run directory and of its programs in `/dev/shm`.
    pub(crate) fn shared_memory(&self) -> Vec<String> {
        let prefix = self.location.shared_memory_prefix();
        let mut names = Vec::new();
        list(Path::new("/dev/shm"), &mut names);
        names.retain(|name| name.contains(&prefix));
        list(self.location.path(), &mut names);
        names.sort();
        names
    }
}

fn list(folder: &Path, names: &mut Vec<String>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        match entry.path() {
            path if path.is_dir() => list(&path, names),
            path => names.push(path.display().to_string()),
        }
    }
}

/// On User-Mode Linux.
pub(crate) fn is_virtual() -> bool {
    let processor = fs::read_to_string("/proc/cpuinfo").expect("a processor");
    processor.contains("User Mode Linux")
}

/// State by the records from the instant of a kill on.
pub(crate) struct Watch {
    start: Vec<f64>,
    /// Greatest distance of a joint from where it was, rad.
    pub(crate) motion: f64,
    /// Records that this program was too slow to see.
    pub(crate) unseen: u64,
}

impl Watch {
    /// Begins with the newest record.
    pub(crate) fn begin(client: &mut Client) -> Self {
        let newest = client.latest().expect("records");
        let record = newest.unwrap_or_else(|| client.next_record(PATIENCE).expect("a record"));
        let joints = &record.cycle.measured.joints[..record.cycle.joint_count as usize];
        Self {
            start: joints.iter().map(|joint| joint.q).collect(),
            motion: 0.0,
            unseen: 0,
        }
    }

    /// Watches until a record fulfils the condition; gives that one.
    pub(crate) fn until(
        &mut self,
        client: &mut Client,
        mut holds: impl FnMut(&SharedRecord) -> bool,
    ) -> Box<SharedRecord> {
        let until = Instant::now() + PATIENCE;
        loop {
            let record = client.next_record(PATIENCE).expect("a record");
            self.unseen += record.lost;
            for (joint, start) in record.cycle.measured.joints.iter().zip(&self.start) {
                // Before its first sample a joint of a new daemon is at no position.
                if joint.flags & measured_flags::NEVER == 0 {
                    self.motion = self.motion.max((joint.q - start).abs());
                }
            }
            if holds(&record) {
                return Box::new(*record);
            }
            assert!(Instant::now() < until, "still {}", state(&record));
        }
    }

    /// Watches for so many cycles; gives the last record.
    pub(crate) fn cycles(&mut self, client: &mut Client, count: u64) -> Box<SharedRecord> {
        let mut first = None;
        self.until(client, |record| {
            let first = *first.get_or_insert(record.cycle.sequence);
            record.cycle.sequence >= first + count
        })
    }
}

/// The state in words, with the number of a latched fault.
pub(crate) fn state(record: &SharedRecord) -> String {
    let state = RobotState::from_number(record.cycle.state).map_or("?", RobotState::name);
    match record.cycle.fault {
        0 => state.to_owned(),
        fault => format!("{state} {fault}"),
    }
}

pub(crate) fn holds(record: &SharedRecord) -> bool {
    record.cycle.state == RobotState::Holding.number()
}

/// Acknowledges and enables, as an operator would, until the robot holds.
pub(crate) fn recover(client: &mut Client) {
    let until = Instant::now() + PATIENCE;
    loop {
        client.latest().expect("records");
        let record = client.next_record(PATIENCE).expect("a record");
        if holds(&record) {
            return;
        }
        let fault = record.cycle.fault;
        drop(record);
        let asked = match fault {
            0 => client.enable(),
            fault => client.acknowledge(fault),
        };
        match asked {
            Ok(_) => {}
            Err(Error::Refused { reason }) if Instant::now() > until => panic!("{reason}"),
            Err(Error::Refused { .. }) => sleep(10 * POLL),
            Err(e) => panic!("{e}"),
        }
    }
}
