//! A recorded run is computed again bit by bit from its file alone; what differs is named.

use crate::common;

use std::fs::File;
use std::io::{self, BufReader};
use std::path::Path;

use common::recorded::robot_and_files;
use common::{RunDir, eventful};
use nix::time::{ClockId, clock_gettime};
use recording::{AttachedFile, CycleMessage, Ending, Header, Replay, Replayed, Run};
use robot_config::Robot;

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
    let (robot, files) = robot_and_files("humanoid", |_, text| text);
    let happened = eventful::record(&robot, files.clone(), cycles, path);
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
    const CYCLES: u64 = 9000;
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
