//! A robot's loop with a recorder, both on this thread and on a virtual clock.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use problem::Problem;
use recording::{AttachedFile, CycleMessage, Header, Run, Start};
use robot_config::Robot;
use robot_state::{Description, Name};
use test_support::read_project_file;
use torqued::bus::Bus;
use torqued::bus::in_process::{VirtualClock, VirtualDeadline};
use torqued::control_loop::ControlLoop;
use torqued::looper::Looper;
use torqued::real_time::{Pace, WakeReport};
use torqued::recorder::{self, BlackBoxes, Contents, Recorder, RecorderHandle, RecordingRequest};
use torqued::request_server::RequestServer;
use torqued::shared_memory;
use torqued::summary::Timing;
use torqued_client::{Location, StateDirectory};

use super::RunDir;

/// Start of the virtual clock, ns.
pub(crate) const START_NS: u64 = 1_000_000_000;

/// A robot of the project with the files that it was loaded from.
pub(crate) fn robot_and_files(
    name: &str,
    change: impl Fn(&str, String) -> String,
) -> (Robot, Vec<AttachedFile>) {
    let files = std::cell::RefCell::new(Vec::new());
    let read = |path: &str| {
        let text = change(path, read_project_file(path)?);
        let file = AttachedFile {
            path: path.to_owned(),
            text: text.clone(),
        };
        files.borrow_mut().push(file);
        Ok(text)
    };
    let robot = robot_config::load(&format!("config/{name}/robot.toml"), &read).expect("a robot");
    (robot, files.into_inner())
}

/// One run.
pub(crate) struct Recorded<'a> {
    pub(crate) robot: &'a Robot,
    pub(crate) files: Vec<AttachedFile>,
    pub(crate) directory: &'a RunDir,
    /// A recording from the first cycle on.
    pub(crate) record: Option<PathBuf>,
    /// Cycle at which the end is asked for.
    pub(crate) stop_at: u64,
}

/// Tools of a run's script before each cycle.
pub(crate) struct Scene<'a> {
    pub(crate) cycle: u64,
    pub(crate) location: &'a Location,
    pub(crate) handle: &'a RecorderHandle,
}

struct Script<'a> {
    pace: VirtualDeadline,
    cycle: u64,
    stop_at: u64,
    stop: Arc<AtomicBool>,
    recorder: &'a mut Recorder,
    location: &'a Location,
    handle: &'a RecorderHandle,
    act: &'a mut dyn FnMut(&Scene<'_>),
}

impl Pace for Script<'_> {
    fn wait(&mut self) -> WakeReport {
        self.cycle += 1;
        assert!(self.cycle < self.stop_at + 20_000, "the loop does not end");
        // Until it has nothing to do: the virtual clock is faster than a thread's turns.
        while self.recorder.poll(Instant::now()) {}
        (self.act)(&Scene {
            cycle: self.cycle,
            location: self.location,
            handle: self.handle,
        });
        self.stop
            .store(self.cycle >= self.stop_at, Ordering::Relaxed);
        self.pace.wait()
    }
}

impl Recorded<'_> {
    /// Runs the loop on the bus that `wrap` makes; gives the cycles that the recorder lost.
    pub(crate) fn run<B: Bus>(
        self,
        wrap: impl FnOnce(&VirtualClock) -> B,
        act: &mut dyn FnMut(&Scene<'_>),
    ) -> u64 {
        let clock = VirtualClock::new();
        clock.advance_to(START_NS);
        let robot = self.robot;
        let mut control_loop = ControlLoop::new(robot, wrap(&clock)).expect("a loop");
        let header = Header::new(robot, self.files, Start::default());
        let state = StateDirectory::at(self.directory.directory.path(), "robot");
        let mut ends = recorder::create(robot, header, Some(BlackBoxes::new(&state)));
        control_loop.record_to(ends.tap);
        if let Some(path) = self.record {
            ends.handle.ask(RecordingRequest::Begin {
                path,
                seconds: None,
                last_s: 0.0,
                contents: Contents::default(),
                overwrite: false,
                unattended: true,
            });
        }
        let store = torqued::offsets::Store::at(self.directory.directory.path(), "robot");
        let mut server = RequestServer::new(robot, Ok::<_, Problem>(store)).expect("a server");
        server.record_with(ends.handle.clone());
        let description = Description {
            robot: Name::new(&robot.parameters.name),
            joint_count: robot.parameters.joints.len() as u32,
            ..Description::default()
        };
        let location = &self.directory.location;
        let clients = shared_memory::start_at(
            location,
            &description,
            server,
            supervisor::Commanders::new(0.04),
        )
        .expect("memory");
        let stop = Arc::new(AtomicBool::new(false));
        let mut looper = Looper::new(robot, control_loop, clients, &stop, None);
        let mut script = Script {
            pace: VirtualDeadline::new(&clock, 1_000_000),
            cycle: 0,
            stop_at: self.stop_at,
            stop: Arc::clone(&stop),
            recorder: &mut ends.recorder,
            location,
            handle: &ends.handle,
            act,
        };
        let run = std::panic::AssertUnwindSafe(|| looper.run(&mut script, &mut Timing::new()));
        // A bus that panics stands for a defect.
        let _ = std::panic::catch_unwind(run);
        drop(looper);
        while !ends.recorder.is_over() {
            ends.recorder.poll(Instant::now());
        }
        ends.handle.dropped()
    }
}

/// The black boxes of a run directory, oldest first.
pub(crate) fn black_boxes(directory: &RunDir) -> Vec<PathBuf> {
    let folder = directory.directory.path().join("robot/blackbox");
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut paths: Vec<PathBuf> = entries
        .map(|entry| entry.expect("readable").path())
        .collect();
    paths.sort();
    paths
}

/// Reads a run to its end.
pub(crate) fn read(path: &Path, mut take: impl FnMut(&Header, &CycleMessage)) -> Header {
    let file = std::fs::File::open(path).expect("a file");
    let mut run = Run::open(std::io::BufReader::new(file)).expect("a run");
    let header = run.header().clone();
    let mut message = CycleMessage::default();
    while run.next_cycle(&mut message).expect("readable") {
        take(&header, &message);
    }
    assert_eq!(run.ending(), Some(&recording::Ending::Complete));
    header
}
