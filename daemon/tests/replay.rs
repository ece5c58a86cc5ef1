//! A recorded run is computed again bit by bit from its file alone; what differs is named.

use crate::common;

use std::fs::File;
use std::io::{self, BufReader};
use std::path::Path;

use common::recorded::robot_and_files;
use common::{RunDir, eventful};
use nix::time::{ClockId, clock_gettime};
use recording::{
    AttachedFile, CycleMessage, Ending, Fields, Header, Replay, Replayed, Run, is_in_torques,
};
use robot_config::Robot;
use robot_state::{Content, CycleRecord};
use torqued::recorder::Contents;
use zerocopy::IntoBytes;

/// The robot of a recording, with its files changed.
fn robot_of(header: &Header, change: impl Fn(&str, String) -> String) -> Robot {
    let read = |path: &str| {
        let text = header.text(path).map(|text| change(path, text.to_owned()));
        text.ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "not in the recording"))
    };
    robot_config::load(&header.files[0].path, &read).expect("a robot")
}

/// Replays a run with every message changed, and with other files.
fn replay(
    path: &Path,
    change: impl Fn(&str, String) -> String,
    spoil: impl Fn(&mut CycleMessage),
) -> Replayed {
    let mut run = Run::open(BufReader::new(File::open(path).expect("a file"))).expect("a run");
    let header = run.header().clone();
    let mut replay = Replay::new(&robot_of(&header, change), &header).expect("a replay");
    let mut message = CycleMessage::default();
    while run.next_cycle(&mut message).expect("readable") {
        spoil(&mut message);
        replay.step(&message);
    }
    assert_eq!(run.ending(), Some(&Ending::Complete));
    replay.result().clone()
}

fn record(cycles: u64, path: &Path) -> Vec<AttachedFile> {
    record_contents(cycles, path, Contents::default())
}

fn record_contents(cycles: u64, path: &Path, contents: Contents) -> Vec<AttachedFile> {
    let (robot, files) = robot_and_files("humanoid", |_, text| text);
    let happened = eventful::record(&robot, files.clone(), cycles, path, contents);
    let rounds = cycles / 8000;
    assert!(happened.faults >= rounds, "{happened:?}");
    assert!(happened.contact_changes >= rounds, "{happened:?}");
    assert!(happened.skipped >= rounds, "{happened:?}");
    assert!(happened.active > cycles / 5, "{happened:?}");
    assert_eq!((happened.lost, happened.cycles), (0, cycles));
    files
}

#[test]
fn a_run_is_computed_again_bit_by_bit_and_what_differs_is_named() {
    const CYCLES: u64 = 4000;
    let directory = RunDir::new();
    let path = directory.directory.path().join("run.mcap");
    record(CYCLES, &path);
    let same = |_: &str, text: String| text;

    let result = replay(&path, same, |_| {});
    assert!(result.is_bit_exact(), "{:?}", result.first_difference);
    assert_eq!((result.cycles, result.first_cycle), (CYCLES, 1));
    assert!(result.missing.is_empty());
    let torques = result.joints.iter().flatten();
    assert!(torques.into_iter().all(|torque| torque.largest == 0.0));

    // One bit of one frame.
    let result = replay(&path, same, |message| {
        if message.record.cycle.sequence == 2000 {
            let mut frames = message.rx.clone();
            message.rx.clear();
            for (i, mut frame) in std::mem::take(&mut frames).into_iter().copied().enumerate() {
                frame.data[1] ^= u8::from(i == 0);
                message.rx.push(frame);
            }
        }
    });
    let first = result.first_difference.expect("a difference");
    assert_eq!(first.cycle, 2000, "{first:?}");
    assert!(first.field.starts_with("measured."), "{first:?}");
    assert_ne!(first.recorded, first.replayed);

    // Another parameter of one joint's drive: its torques differ, and no other's.
    let other = |path: &str, text: String| {
        if path.ends_with("robot.toml") {
            let key = "K_fs0_Nm_per_rad = ";
            let place = text.find(key).expect("the key") + key.len();
            format!("{}1{}", &text[..place], &text[place..])
        } else {
            text
        }
    };
    let result = replay(&path, other, |_| {});
    assert!(!result.is_bit_exact());
    let encoder = result.joints.iter().map(|torques| torques[0]);
    let differ: Vec<bool> = encoder.map(|torque| torque.rms() > 0.0).collect();
    assert!(differ.contains(&true), "{differ:?}");
    assert!(
        result
            .first_difference
            .expect("a difference")
            .field
            .contains("tau_encoder")
    );
}

/// Every cycle of a run, with what is computed from frames.
fn cycles_of(path: &Path) -> (Header, Vec<CycleRecord>) {
    let mut run = Run::open(BufReader::new(File::open(path).expect("a file"))).expect("a run");
    run.restore().expect("a robot");
    let mut message = CycleMessage::default();
    let mut records = Vec::new();
    while run.next_cycle(&mut message).expect("readable") {
        records.push(message.record.cycle);
    }
    assert_eq!(run.ending(), Some(&Ending::Complete));
    if let Some(restored) = run.restored() {
        assert!(restored.is_bit_exact(), "{:?}", restored.first_difference);
    }
    (run.header().clone(), records)
}

/// 30 joints at 1 kHz: what a recording takes on the disk, and that frames suffice for every bit.
#[test]
fn frames_suffice_and_contents_fit_a_disk() {
    const CYCLES: u64 = 4000;
    let directory = RunDir::new();
    let file = |content: Content| {
        let path = directory.directory.path().join(format!("{content}.mcap"));
        let contents = Contents { content, every: 1 };
        record_contents(CYCLES, &path, contents);
        let bytes = std::fs::metadata(&path).expect("a file").len();
        let rate = bytes as f64 * 1e-3 / CYCLES as f64;
        println!("{content}: {rate:.2} MB/s");
        (path, rate)
    };
    let (all, _) = file(Content::All);
    let (frames, of_frames) = file(Content::Frames);
    let (torques, of_torques) = file(Content::Torques);
    assert!(of_frames < 1.5, "{of_frames} MB/s");
    assert!(of_torques < 2.5, "{of_torques} MB/s");

    let (header, recorded) = cycles_of(&all);
    let (_, restored) = cycles_of(&frames);
    assert_eq!(recorded.len() as u64, CYCLES);
    let fields = Fields::new::<CycleRecord>(header.counts());
    for (recorded, restored) in recorded.iter().zip(&restored) {
        let difference = fields.first_difference(recorded.as_bytes(), restored.as_bytes());
        assert_eq!(difference, None, "cycle {}", recorded.sequence);
    }
    assert_eq!(restored.len() as u64, CYCLES);
    let (_, shown) = cycles_of(&torques);
    assert_eq!(shown.len() as u64, CYCLES);
    for (recorded, shown) in recorded.iter().zip(&shown) {
        for field in fields.0.iter().filter(|field| is_in_torques(&field.path)) {
            let [recorded, shown] = [recorded, shown].map(|cycle| field.value(cycle.as_bytes()));
            let rounded = f64::from(recorded as f32);
            let same = shown.to_bits() == rounded.to_bits() || shown == recorded;
            assert!(same, "{}: {recorded}, {shown}", field.path);
        }
    }

    // One bit of one frame is noticed by the checksum.
    let same = |_: &str, text: String| text;
    let result = replay(&frames, same, |message| {
        if message.record.cycle.sequence == 2000 {
            let mut frames = message.rx.clone();
            message.rx.clear();
            for (i, mut frame) in std::mem::take(&mut frames).into_iter().copied().enumerate() {
                frame.data[1] ^= u8::from(i == 0);
                message.rx.push(frame);
            }
        }
    });
    assert_eq!(result.first_difference.expect("a difference").cycle, 2000);
    // Torques alone cannot be replayed.
    let run = Run::open(BufReader::new(File::open(&torques).expect("a file"))).expect("a run");
    let robot = robot_of(run.header(), same);
    let refused = Replay::new(&robot, run.header()).err().expect("refused");
    assert!(refused.to_string().contains("torques alone"), "{refused}");
}

/// Time of this thread alone, s: other programs do not enter it.
fn own_time_s() -> f64 {
    let time = clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).expect("a clock");
    time.tv_sec() as f64 + time.tv_nsec() as f64 * 1e-9
}

/// Ten minutes: `cargo test --release -p torqued --test all replay:: -- --ignored --nocapture`.
#[test]
#[ignore = "takes minutes"]
fn ten_minutes_are_computed_again_bit_by_bit() {
    let cycles =
        std::env::var("REPLAY_CYCLES").map_or(600_000, |text| text.parse().expect("a number"));
    let directory = RunDir::new();
    let path = directory.directory.path().join("run.mcap");
    record(cycles, &path);
    let bytes = std::fs::metadata(&path).expect("a file").len();
    let began_s = own_time_s();
    let result = replay(&path, |_, text| text, |_| {});
    let took_s = own_time_s() - began_s;
    println!(
        "{} cycles, {:.1} MB, replayed in {took_s:.1} s of its thread: {:.1} times real time; {:?}",
        result.cycles,
        bytes as f64 * 1e-6,
        cycles as f64 * 1e-3 / took_s,
        result.first_difference
    );
    assert!(result.is_bit_exact());
    assert_eq!(result.cycles, cycles);
}
