//! Frames as datagrams, beside what python-can 4.6.1 makes of the same messages.

use can_codec::{DATAGRAM_BYTES, EXTENDED_ID, Frame, from_datagram, to_datagram};
use proptest::prelude::*;

/// Identifier, its kind, the frame's kind, data and `pack_message(can.Message(...))`, in hex.
/// rt-tests/udp compares them with the python-can of the test environment.
const RECORDED: &str = include_str!("python_can.txt");

fn frame(id: u32, data: &[u8], fd: bool) -> Frame {
    let mut frame = Frame::zeroed(2, id, data.len() as u8, fd);
    frame.data[..data.len()].copy_from_slice(data);
    frame
}

fn hex(text: &str) -> Vec<u8> {
    let digits = text.trim_matches('-').as_bytes().chunks(2);
    let byte = |pair| u8::from_str_radix(core::str::from_utf8(pair).unwrap(), 16).unwrap();
    digits.map(byte).collect()
}

/// The recorded frames and their datagrams.
fn recorded() -> Vec<(Frame, Vec<u8>)> {
    let line = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        let [id, kind, frame_kind, data, datagram] = words[..] else {
            panic!("{line}");
        };
        let mark = if kind == "extended" { EXTENDED_ID } else { 0 };
        let id = u32::from_str_radix(id, 16).unwrap() | mark;
        (frame(id, &hex(data), frame_kind == "fd"), hex(datagram))
    };
    RECORDED.lines().map(line).collect()
}

fn written(frame: &Frame) -> Option<Vec<u8>> {
    let mut out = [0; DATAGRAM_BYTES];
    to_datagram(frame, &mut out).map(|length| out[..length].to_vec())
}

/// The datagram with the value behind a key replaced.
fn with(datagram: &[u8], key: &str, old: &[u8], new: &[u8]) -> Vec<u8> {
    let found = datagram
        .windows(key.len())
        .position(|w| w == key.as_bytes());
    let at = found.expect("the key") + key.len();
    let value = datagram[at..].strip_prefix(old).expect("the old value");
    [&datagram[..at], new, value].concat()
}

#[test]
fn frames_are_the_bytes_of_python_can_and_back() {
    let recorded = recorded();
    assert_eq!(recorded.len(), 7);
    for (frame, datagram) in recorded {
        assert_eq!(written(&frame).as_ref(), Some(&datagram), "{frame:?}");
        assert_eq!(from_datagram(2, &datagram), Some(frame));
    }
}

#[test]
fn the_longest_frame_fills_the_longest_datagram() {
    let longest = frame(EXTENDED_ID | 0x1fff_ffff, &[7; 64], true);
    assert_eq!(written(&longest).unwrap().len(), DATAGRAM_BYTES);
}

#[test]
fn what_others_may_send_for_the_same_message_is_read() {
    let (frame, datagram) = recorded().swap_remove(0);
    let reads = |datagram: &[u8]| assert_eq!(from_datagram(2, datagram), Some(frame));
    reads(&with(&datagram, "channel", b"\xc0", b"\xac239.74.163.2"));
    reads(&with(&datagram, "channel", b"\xc0", b"\x05"));
    reads(&with(&datagram, "channel", b"\xc0", b"\xd9\x05vcan0"));
    // An integer in more bytes than it needs, and a time that is set, or an integer.
    reads(&with(
        &datagram,
        "arbitration_id",
        b"\xcd\x01\x01",
        b"\xd3\0\0\0\0\0\0\x01\x01",
    ));
    reads(&with(&datagram, "timestamp", b"\xcb\0", b"\xcb\x41"));
    reads(&with(
        &datagram,
        "timestamp",
        &[0xcb, 0, 0, 0, 0, 0, 0, 0, 0],
        b"\x00",
    ));
    // Keys in another order, one that is not known, one that is not there.
    let rotated = [&datagram[..1], &datagram[20..], &datagram[1..20]].concat();
    reads(&rotated);
    let more = [b"\x8c", &datagram[1..], b"\xa5is_rx\xc3"].concat();
    reads(&more);
    let fewer = [b"\x8a", &datagram[20..]].concat();
    reads(&fewer);
}

#[test]
fn what_is_no_data_frame_is_refused() {
    let recorded = recorded();
    let (_, classic) = &recorded[0];
    let (_, fd) = &recorded[5];
    let refuses = |datagram: &[u8]| assert_eq!(from_datagram(0, datagram), None);
    for length in 0..classic.len() {
        refuses(&classic[..length]);
    }
    refuses(&[classic.as_slice(), &[0]].concat());
    refuses(&with(classic, "is_remote_frame", b"\xc2", b"\xc3"));
    refuses(&with(classic, "is_error_frame", b"\xc2", b"\xc3"));
    refuses(&with(classic, "dlc", b"\x08", b"\x07"));
    refuses(&with(classic, "dlc", b"\x08", b"\xff"));
    refuses(&with(
        classic,
        "arbitration_id",
        b"\xcd\x01\x01",
        b"\xcd\x08\x00",
    ));
    refuses(&with(classic, "arbitration_id", b"\xcd\x01\x01", b"\xff"));
    refuses(&with(classic, "is_extended_id", b"\xc2", b"\x00"));
    refuses(&with(classic, "channel", b"\xc0", b"\x90"));
    refuses(&with(classic, "data", b"\xc4", b"\xc1"));
    // A classic frame of 64 bytes.
    refuses(&with(fd, "is_fd", b"\xc3", b"\xc2"));
    refuses(&[b"\x8a".as_slice(), &classic[1..]].concat());
    refuses(b"\xdf\xff\xff\xff\xff");
    refuses(&[0x93, 1, 2, 3]);
}

#[test]
fn what_no_bus_carries_is_not_written() {
    let mut error = frame(0x101, &[1], false);
    error.error = true;
    let mut long = frame(0x101, &[1], false);
    long.len = 9;
    let mut too_long = frame(0x101, &[1], true);
    too_long.len = 65;
    // As SocketCAN's bit of remote frames would be.
    let remote = frame(0x4000_0101, &[1], false);
    for frame in [error, long, too_long, remote, frame(0x800, &[], false)] {
        assert_eq!(written(&frame), None, "{frame:?}");
    }
}

proptest! {
    #[test]
    fn any_frame_survives(
        id in 0_u32..0x2000_0000,
        extended in any::<bool>(),
        fd in any::<bool>(),
        data in prop::collection::vec(any::<u8>(), 0..=64),
    ) {
        let (id, most) = (if extended { id | EXTENDED_ID } else { id & 0x7ff }, if fd { 64 } else { 8 });
        let frame = frame(id, &data[..data.len().min(most)], fd);
        prop_assert_eq!(from_datagram(2, &written(&frame).unwrap()), Some(frame));
    }

    #[test]
    fn any_bytes_are_a_frame_or_none(
        mut datagram in prop::sample::select(recorded()).prop_map(|(_, datagram)| datagram),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
    ) {
        for (at, byte) in changes {
            let at = at.index(datagram.len());
            datagram[at] = byte;
        }
        if let Some(frame) = from_datagram(2, &datagram) {
            let most = if frame.fd { 64 } else { 8 };
            prop_assert!(frame.len <= most && !frame.error);
        }
    }
}
