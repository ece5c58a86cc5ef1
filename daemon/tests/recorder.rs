//! The recorder's ends: the loop never allocates or waits for it; files end in an orderly way.

use crate::common;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use can_codec::{Frame, Frames};
use common::RunDir;
use common::recorded::{black_boxes, read, robot_and_files};
use cycle::{ClientInput, Instants, Stamp};
use recording::{CycleInput, Header, Start};
use robot_config::RecorderSettings;
use robot_state::{Content, Event, SharedRecord};
use test_support::allocations;
use torqued::recorder::{self, Always, BlackBoxes, Contents, Ends, KEPT, RecordingRequest};
use torqued_client::StateDirectory;

/// A recorder of the humanoid, and what its loop gives it.
struct Rig {
    ends: Ends,
    rx: Frames,
    tx: Frames,
    record: Box<SharedRecord>,
    now: Instant,
}

impl Rig {
    fn new(directory: Option<&RunDir>) -> Self {
        let (robot, files) = robot_and_files("humanoid", |_, text| text);
        let header = Header::new(&robot, files, Start::default());
        let boxes = directory.map(|directory| {
            BlackBoxes::new(&StateDirectory::at(directory.directory.path(), "robot"))
        });
        let mut rx = Frames::default();
        let mut tx = Frames::default();
        for id in 0..30 {
            rx.push(Frame::zeroed(0, 0x181 + id, 8, false));
            tx.push(Frame::zeroed(0, 0x201 + id, 8, false));
        }
        Self {
            ends: recorder::create(&robot, header, boxes),
            rx,
            tx,
            record: Box::default(),
            now: Instant::now(),
        }
    }

    /// So many cycles of the loop.
    fn loop_on(&mut self, cycles: u64, fault: u32) {
        for _ in 0..cycles {
            let cycle = &mut self.record.cycle;
            cycle.sequence += 1;
            cycle.stamp_ns = cycle.sequence * 1_000_000;
            cycle.fault = fault;
            let input = CycleInput {
                at: Instants {
                    sync: Stamp(cycle.stamp_ns - 500_000),
                    now: Stamp(cycle.stamp_ns),
                },
                rx: &self.rx,
                client: ClientInput::default(),
            };
            self.ends.tap.note(Event::LateCycle, 1);
            self.ends.tap.take(&input, &self.record, &self.tx);
        }
    }

    /// The recorder works until it has nothing to do, so long after the rig's begin.
    fn poll(&mut self, after_s: f64) {
        let now = self.now + Duration::from_secs_f64(after_s);
        while self.ends.recorder.poll(now) {}
    }

    fn begin(&self, path: &Path, seconds: Option<f64>, last_s: f64) {
        self.begin_over(path, seconds, last_s, path.starts_with("/dev"));
    }

    fn begin_over(&self, path: &Path, seconds: Option<f64>, last_s: f64, overwrite: bool) {
        self.ends.handle.ask(RecordingRequest::Begin {
            path: path.to_owned(),
            seconds,
            last_s,
            contents: Contents::default(),
            overwrite,
            unattended: false,
        });
    }

    fn path(&self, directory: &RunDir) -> PathBuf {
        directory.directory.path().join("run.mcap")
    }
}

fn sequences(path: &Path) -> Vec<u64> {
    let mut sequences = Vec::new();
    read(path, |_, message| {
        sequences.push(message.record.cycle.sequence)
    });
    sequences
}

#[test]
fn the_loop_neither_allocates_nor_waits_and_counts_what_finds_no_room() {
    let mut rig = Rig::new(None);
    rig.loop_on(10, 0);
    let before = allocations();
    rig.loop_on(5000, 0);
    assert_eq!(allocations() - before, 0);
    let dropped = rig.ends.tap.dropped();
    // The ring holds at least a second.
    assert!((1000..4010).contains(&dropped), "{dropped}");
    rig.poll(0.0);
    rig.loop_on(500, 0);
    assert_eq!(rig.ends.tap.dropped(), dropped, "there is room again");
}

#[test]
fn a_recording_begins_before_its_request_and_ends_as_asked() {
    let directory = RunDir::new();
    let mut rig = Rig::new(None);
    for _ in 0..5 {
        rig.loop_on(500, 0);
        rig.poll(0.0);
    }
    let path = rig.path(&directory);
    rig.begin(&path, Some(1.0), 2.0);
    for _ in 0..4 {
        rig.poll(0.0);
        rig.loop_on(500, 0);
    }
    rig.poll(0.0);
    let status = rig.ends.handle.status();
    assert!(!status.running && status.failed.is_none(), "{status:?}");
    assert_eq!((status.cycles, status.lost), (3001, 0));
    assert_eq!(sequences(&path), (500..=3500).collect::<Vec<_>>());
    // The file that is there is not touched.
    let bytes = fs::read(&path).expect("readable");
    rig.begin(&path, None, 0.0);
    rig.poll(0.0);
    let refused = rig.ends.handle.status().refused.expect("refused");
    assert!(refused.contains("exists"), "{refused}");
    assert_eq!(fs::read(&path).expect("readable"), bytes);
}

#[test]
fn an_older_recording_stays_until_the_new_one_is_whole() {
    let directory = RunDir::new();
    fs::create_dir_all(directory.directory.path()).expect("a folder");
    let mut rig = Rig::new(None);
    rig.loop_on(100, 0);
    rig.poll(0.0);
    let path = rig.path(&directory);
    fs::write(&path, "old").expect("written");
    let files = || {
        fs::read_dir(directory.directory.path())
            .expect("a folder")
            .count()
    };
    let before = files();

    // Nothing is recorded: its end is asked for before a cycle comes.
    rig.begin_over(&path, None, 0.0, true);
    rig.ends.handle.ask(RecordingRequest::End);
    rig.poll(0.0);
    let failed = rig.ends.handle.status().failed.expect("nothing recorded");
    assert!(failed.contains("nothing was recorded"), "{failed}");
    assert_eq!(fs::read(&path).expect("readable"), b"old");
    assert_eq!(files(), before, "nothing half-written");

    rig.begin_over(&path, None, 0.0, true);
    rig.poll(0.0);
    rig.loop_on(500, 0);
    rig.poll(0.0);
    assert_eq!(fs::read(&path).expect("readable"), b"old");
    rig.ends.handle.ask(RecordingRequest::End);
    rig.poll(0.0);
    let status = rig.ends.handle.status();
    assert_eq!((status.running, status.failed), (false, None));
    assert_eq!(sequences(&path), (101..=600).collect::<Vec<_>>());
    assert_eq!(files(), before);
}

#[test]
fn a_full_disk_ends_the_recording_with_a_message_and_nothing_else() {
    let mut rig = Rig::new(None);
    rig.loop_on(100, 0);
    rig.poll(0.0);
    rig.begin(Path::new("/dev/full"), None, 0.0);
    for _ in 0..6 {
        rig.loop_on(500, 0);
        rig.poll(0.0);
    }
    let status = rig.ends.handle.status();
    let why = status.failed.or(status.refused).expect("a failure");
    assert!(why.contains("No space left"), "{why}");
    assert!(!status.running);
    assert_eq!(rig.ends.tap.dropped(), 0);
}

#[test]
fn a_recording_that_nobody_asks_after_ends() {
    let directory = RunDir::new();
    let mut rig = Rig::new(None);
    rig.loop_on(10, 0);
    rig.poll(0.0);
    let path = rig.path(&directory);
    rig.begin(&path, None, 0.0);
    rig.poll(0.0);
    for second in 1..=3 {
        rig.ends.handle.ask(RecordingRequest::Renew);
        rig.loop_on(1000, 0);
        rig.poll(4.0 * f64::from(second));
        assert!(rig.ends.handle.status().running);
    }
    rig.loop_on(1000, 0);
    rig.poll(17.5);
    assert!(!rig.ends.handle.status().running);
    assert_eq!(sequences(&path), (11..=4010).collect::<Vec<_>>());
}

#[test]
fn a_recording_that_always_runs_goes_on_from_file_to_file_and_old_ones_go() {
    let directory = RunDir::new();
    let state = StateDirectory::at(directory.directory.path(), "robot");
    // The configuration's files are most of a file of so small a robot's cycles.
    let path = directory.directory.path().join("one.mcap");
    let mut rig = Rig::new(None);
    rig.begin(&path, Some(1.0), 0.0);
    for _ in 0..3 {
        rig.loop_on(500, 0);
        rig.poll(0.0);
    }
    let one = fs::metadata(&path).expect("a file").len();
    let settings = RecorderSettings {
        content: Content::Frames,
        rate_hz: None,
        // After each second, when files are flushed.
        file_bytes: one / 2,
        kept_bytes: 4 * one,
        kept_s: 3600.0,
    };
    let always = Always::new(&state, settings, 0.001).expect("a rate of the loop");
    let folder = always.folder().to_owned();
    fs::create_dir_all(&folder).expect("a folder");
    let old = folder.join("2020-01-01T00-00-00Z_frames.mcap");
    fs::write(&old, vec![0; 1000]).expect("written");
    let long_ago = SystemTime::now() - Duration::from_secs(7200);
    let file = fs::File::options().write(true).open(&old).expect("a file");
    file.set_modified(long_ago).expect("a date");
    fs::write(folder.join("notes.txt"), "an operator's").expect("written");
    let mut rig = Rig::new(None);
    rig.ends.recorder.record_always(always);
    let files = || {
        let mut files: Vec<PathBuf> = fs::read_dir(&folder)
            .expect("a folder")
            .map(|entry| entry.expect("readable").path())
            .collect();
        files.retain(|path| path.extension().is_some_and(|ending| ending == "mcap"));
        files.sort();
        files
    };
    let mut most = 0;
    for second in 0..12 {
        for _ in 0..2 {
            rig.loop_on(500, 0);
            rig.poll(f64::from(second));
        }
        assert!(!old.exists(), "it is two hours old");
        let bytes: u64 = files()
            .iter()
            .map(|f| fs::metadata(f).expect("a file").len())
            .sum();
        most = most.max(bytes);
    }
    assert!(most < 6 * one, "{most} bytes; files of {one} bytes");
    let kept = files();
    assert!(kept.len() > 2, "{kept:?}");
    rig.ends.tap.end_as_asked();
    drop(rig.ends.tap);
    while !rig.ends.recorder.is_over() {
        rig.ends.recorder.poll(rig.now);
    }
    let all: Vec<u64> = kept.iter().flat_map(|path| sequences(path)).collect();
    let first = all.first().copied().expect("cycles");
    assert!(first > 2000, "the first files are gone");
    assert_eq!(
        all,
        (first..=12_000).collect::<Vec<_>>(),
        "nothing between two files is lost"
    );
    assert!(folder.join("notes.txt").exists());
}

#[test]
fn rates_that_the_loop_does_not_have_are_refused() {
    let refused = |content, rate| {
        let contents = Contents::new(content, Some(rate), 0.001);
        contents.expect_err("refused").to_string()
    };
    assert!(refused(Content::Frames, 100.0).contains("content torques"));
    assert!(refused(Content::Torques, 2000.0).contains("0.1 to 1000"));
    let every = |rate| {
        Contents::new(Content::Torques, Some(rate), 0.001)
            .expect("a rate")
            .every
    };
    assert_eq!([1000.0, 100.0, 3.0].map(every), [1, 10, 333]);
}

#[test]
fn the_newest_black_boxes_are_kept_and_parts_removed() {
    let directory = RunDir::new();
    let folder = directory.directory.path().join("robot/blackbox");
    fs::create_dir_all(&folder).expect("a folder");
    for k in 0..KEPT + 5 {
        fs::write(
            folder.join(format!("2020-01-01T00-00-{k:02}_104_old.mcap")),
            "old",
        )
        .expect("written");
    }
    fs::write(folder.join("2020-01-01T00-00-00_104_x.mcap.part"), "part").expect("written");
    fs::write(folder.join("notes.txt"), "an operator's").expect("written");
    let mut rig = Rig::new(Some(&directory));
    rig.loop_on(700, 0);
    rig.poll(0.0);
    rig.loop_on(600, Event::JointStale.number());
    rig.poll(0.0);
    let files = black_boxes(&directory);
    let boxes: Vec<_> = files
        .iter()
        .filter(|path| path.extension().is_some_and(|e| e == "mcap"))
        .collect();
    assert_eq!(boxes.len(), KEPT);
    assert_eq!(files.len(), KEPT + 1, "{files:?}");
    assert!(folder.join("notes.txt").exists());
    let newest = boxes[KEPT - 1];
    assert!(
        newest.to_string_lossy().ends_with("_104_joint_stale.mcap"),
        "{newest:?}"
    );
    // The fault is latched in cycle 701; half a second follows.
    assert_eq!(sequences(newest), (1..=1201).collect::<Vec<_>>());
}

/// `cargo test --release -p torqued --test all recorder:: -- --ignored --nocapture`
#[test]
#[ignore = "a measurement"]
fn time_of_the_loop_for_a_cycle() {
    let mut rig = Rig::new(None);
    let mut times = Vec::new();
    for _ in 0..200 {
        rig.poll(0.0);
        let began = Instant::now();
        rig.loop_on(100, 0);
        times.push(began.elapsed().as_secs_f64() / 100.0);
    }
    times.sort_by(f64::total_cmp);
    println!(
        "{:.2} us median, {:.2} us at p99 of hundreds",
        times[100] * 1e6,
        times[198] * 1e6
    );
}
