//! Signals of other programs' MCAP files: however they are compressed, and in whatever order.

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use recording::{Ending, Signals, read_signals};
use std::collections::BTreeMap;
use std::io::Cursor;

/// A JointState of one joint in CDR; without velocity.
fn joint_state(stamp_ns: u64, position: f64, effort: f64) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    let align = |bytes: &mut Vec<u8>, size: usize| {
        while !(bytes.len() - 4).is_multiple_of(size) {
            bytes.push(0);
        }
    };
    let number = |bytes: &mut Vec<u8>, x: u32| {
        align(bytes, 4);
        bytes.extend(x.to_le_bytes());
    };
    number(&mut bytes, (stamp_ns / 1_000_000_000) as u32);
    number(&mut bytes, (stamp_ns % 1_000_000_000) as u32);
    number(&mut bytes, 1);
    bytes.push(0);
    number(&mut bytes, 1);
    number(&mut bytes, 6);
    bytes.extend(b"elbow\0");
    for values in [vec![position], vec![], vec![effort]] {
        number(&mut bytes, values.len() as u32);
        for x in values {
            align(&mut bytes, 8);
            bytes.extend(x.to_le_bytes());
        }
    }
    bytes
}

/// Messages: stamp (0: none, by the time of recording), time of recording, position, effort.
type Message = (u64, u64, f64, f64);

const START: u64 = 1_750_000_000_000_000_000;

/// 600 messages at 500 Hz, in order.
fn messages() -> Vec<Message> {
    let message = |k: u64| {
        let t = START + 2_000_000 * k;
        (t, t + 300_000, (k as f64 * 0.01).sin(), k as f64)
    };
    (0..600).map(message).collect()
}

fn file(options: WriteOptions, messages: &[Message]) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let mut writer = Writer::with_options(&mut out, options).unwrap();
    let schema = writer
        .add_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        .unwrap();
    let channel = writer
        .add_channel(schema, "/joint_states", "cdr", &BTreeMap::new())
        .unwrap();
    for (sequence, (stamp, recorded, position, effort)) in messages.iter().enumerate() {
        let header = MessageHeader {
            channel_id: channel,
            sequence: sequence as u32,
            log_time: *recorded,
            publish_time: *recorded,
        };
        let data = joint_state(*stamp, *position, *effort);
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    out.into_inner()
}

fn chunks() -> WriteOptions {
    WriteOptions::new().chunk_size(Some(4096))
}

fn read(bytes: &[u8]) -> Signals {
    let (signals, ending) = read_signals(bytes).unwrap();
    assert_eq!(ending, Ending::Complete);
    signals
}

#[track_caller]
fn assert_whole(signals: &Signals, what: &str) {
    let position = &signals.columns["/joint_states:elbow.position"];
    assert_eq!(position.t.len(), 600, "{what}");
    for (k, (t, value)) in position.t.iter().zip(&position.values).enumerate() {
        assert!((t - 2e-3 * k as f64).abs() < 1e-9, "{what}: {t}");
        assert_eq!(*value, (k as f64 * 0.01).sin(), "{what}");
    }
}

#[test]
fn every_compression_holds_these_messages() {
    for (what, compression) in [
        ("none", None),
        ("LZ4", Some(Compression::Lz4)),
        ("zstd", Some(Compression::Zstd)),
    ] {
        let signals = read(&file(chunks().compression(compression), &messages()));
        assert_whole(&signals, what);
        assert_eq!((signals.late, signals.repeated, signals.broken), (0, 0, 0));
    }
    let whole = file(WriteOptions::new().use_chunks(false), &messages());
    assert_whole(&read(&whole), "without chunks");
    let lz4 = WriteOptions::new().compression(Some(Compression::Lz4));
    assert_whole(
        &read(&file(lz4.disable_seeking(true), &messages())),
        "one chunk, streamed",
    );
}

#[test]
fn messages_out_of_order_are_put_in_order() {
    let lz4 = || chunks().compression(Some(Compression::Lz4));
    // Neighbours exchanged; two halves; backwards; blocks of seven; by a stride.
    let order: [&dyn Fn(usize) -> usize; 5] = [
        &|k| k ^ 1,
        &|k| (k + 300) % 600,
        &|k| 599 - k,
        &|k| k / 6 * 6 + 5 - k % 6,
        &|k| k * 7 % 600,
    ];
    for (n, place) in order.iter().enumerate() {
        let sorted = messages();
        let shuffled: Vec<Message> = (0..600).map(|k| sorted[place(k)]).collect();
        let signals = read(&file(lz4(), &shuffled));
        assert_whole(&signals, &format!("order {n}"));
        assert!(signals.late > 0 && signals.repeated == 0, "order {n}");
        // Without stamps of their own: by the time of recording.
        let unstamped: Vec<Message> = shuffled.iter().map(|m| (0, m.1, m.2, m.3)).collect();
        assert_whole(
            &read(&file(lz4(), &unstamped)),
            &format!("order {n}, recorded"),
        );
    }
}

#[test]
fn what_is_left_out_is_counted() {
    let mut all = messages();
    all.extend_from_within(100..110);
    all[5].3 = f64::NAN;
    let signals = read(&file(chunks(), &all));
    assert_whole(&signals, "repeated");
    assert_eq!(
        (signals.repeated, signals.not_finite, signals.broken),
        (20, 1, 0)
    );
    assert_eq!(signals.columns["/joint_states:elbow.effort"].t.len(), 599);
}
