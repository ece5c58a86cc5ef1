//! One conformance suite for every implementation of `Bus`.
//!
//! A [`Rig`] is a bus under test and a peer at its other end, which sends and receives frames.
#![allow(dead_code, unreachable_pub)] // Each test binary uses its part.

use can_codec::{BusDbc, Dbc, EXTENDED_ID, Frame, Frames, Gather, MAX_FRAMES, SignalMap, Table};
use test_support::allocations;
use torqued::bus::Bus;

/// A bus under test and its other end.
pub trait Rig {
    /// The bus under test.
    fn bus(&mut self) -> &mut dyn Bus;
    /// The peer sends frames.
    fn send_from_peer(&mut self, frames: &Frames);
    /// Frames that the peer has received since the last call, and the number that it lost.
    fn received_by_peer(&mut self) -> (Vec<Frame>, u64);
}

/// Two messages, 0x101 and 0x102 (extended), of eight bytes on each of two buses.
const DBC: &str = r#"VERSION ""

BU_: DRIVE HOST

BO_ 257 ONE: 8 DRIVE
 SG_ value : 0|16@1+ (1,0) [0|65535] "A" HOST

BO_ 2147483906 TWO: 8 DRIVE
 SG_ value : 0|16@1+ (1,0) [0|65535] "A" HOST
"#;
/// Ids of the two messages.
pub const ONE: u32 = 0x101;
pub const TWO: u32 = EXTENDED_ID | 0x102;
/// An id of no message.
pub const STRANGER: u32 = 0x7f0;
/// A wait that no test reaches the end of, ns.
const LONG_NS: u64 = 20_000_000_000;
/// A wait that tests reach the end of, ns.
const SHORT_NS: u64 = 5_000_000;

/// Both messages on buses 0 and 1: four to wait for.
pub fn table() -> Table {
    let dbc = Dbc::parse(DBC, "test.dbc").unwrap();
    let on = |bus| BusDbc {
        bus,
        fd: true,
        dbc: &dbc,
    };
    let map = |slot: usize, message: &str| SignalMap {
        slot,
        message: message.to_owned(),
        signal: "value".to_owned(),
        scale: 1.0,
        offset: 0.0,
        wraps: false,
    };
    let maps = [
        (0, map(0, "ONE")),
        (0, map(1, "TWO")),
        (1, map(2, "ONE")),
        (1, map(3, "TWO")),
    ];
    Table::compile(&[on(0), on(1)], &maps).unwrap()
}

/// A frame whose bytes contain `number`.
pub fn frame(bus: u8, id: u32, len: u8, fd: bool, number: u64) -> Frame {
    let mut frame = Frame::zeroed(bus, id, len, fd);
    let bytes = number.to_le_bytes();
    let used = bytes.len().min(len.into());
    frame.data[..used].copy_from_slice(&bytes[..used]);
    if len > 8 {
        frame.data[usize::from(len) - 1] = 0x5a;
    }
    frame
}

/// `Frames` with the frames of a list.
pub fn frames(list: &[Frame]) -> Frames {
    let mut frames = Frames::new(list.len());
    for frame in list {
        assert!(frames.push(*frame));
    }
    frames
}

/// One frame of each of the four messages.
pub fn answers() -> [Frame; 4] {
    let at = |bus, id| frame(bus, id, 8, false, 7);
    [at(0, ONE), at(0, TWO), at(1, ONE), at(1, TWO)]
}

/// Frames that arrive within a short wait.
pub fn receive(bus: &mut dyn Bus) -> Frames {
    let mut rx = Frames::new(MAX_FRAMES);
    let mut never = Gather::new(1_000);
    let until = bus.now_ns() + SHORT_NS;
    bus.receive(&mut rx, &mut never, &table(), until);
    rx
}

/// Asserts that frames are equal, stamps apart.
pub fn assert_same(seen: &[Frame], expected: &[Frame]) {
    let bare: Vec<_> = seen.iter().map(|&f| Frame { stamp_ns: 0, ..f }).collect();
    assert_eq!(bare, expected);
}

/// Runs the suite on a fresh rig for each part.
pub fn conforms<R: Rig>(mut new: impl FnMut() -> R) {
    order_is_kept_both_ways(&mut new());
    stamps_are_monotonic_and_within_the_wait(&mut new());
    complete_gather_ends_early(&mut new());
    deadline_ends_late(&mut new());
    past_deadline_takes_waiting_frames(&mut new());
    overflow_is_counted(&mut new());
    unknown_frames_pass_and_complete_nothing(&mut new());
    sends_never_block_and_no_frame_is_unaccounted_for(&mut new());
    nothing_is_allocated(&mut new());
}

/// Classic and FD, standard and extended, on two buses, every length from empty to full.
fn mixture() -> Vec<Frame> {
    let lengths = [0, 1, 7, 8, 12, 16, 20, 24, 32, 48, 64];
    let ids = [ONE, TWO, STRANGER, EXTENDED_ID | 1];
    (0..120_usize)
        .map(|i| {
            let len = lengths[i % lengths.len()];
            let fd = len > 8 || i % 3 == 0;
            frame((i % 2) as u8, ids[i % 4], len, fd, i as u64)
        })
        .collect()
}

fn order_is_kept_both_ways(rig: &mut impl Rig) {
    let list = mixture();
    rig.send_from_peer(&frames(&list));
    assert_same(receive(rig.bus()).as_slice(), &list);
    assert_eq!(rig.bus().counters().received, list.len() as u64);

    assert_eq!(rig.bus().send(&frames(&list)), list.len());
    assert_same(&rig.received_by_peer().0, &list);
    assert_eq!(rig.bus().counters().sent, list.len() as u64);
}

fn stamps_are_monotonic_and_within_the_wait(rig: &mut impl Rig) {
    let mut last = rig.bus().now_ns();
    for _ in 0..10 {
        rig.send_from_peer(&frames(&mixture()));
        let rx = receive(rig.bus());
        assert_eq!(rx.len(), mixture().len());
        for frame in &rx {
            assert!(frame.stamp_ns >= last, "{} < {last}", frame.stamp_ns);
            last = frame.stamp_ns;
        }
        assert!(last <= rig.bus().now_ns());
    }
}

fn complete_gather_ends_early(rig: &mut impl Rig) {
    let table = table();
    let mut gather = Gather::new(table.message_count());
    let mut rx = Frames::new(MAX_FRAMES);
    for _ in 0..3 {
        rx.clear();
        gather.begin();
        rig.send_from_peer(&frames(&answers()));
        let until = rig.bus().now_ns() + LONG_NS;
        rig.bus().receive(&mut rx, &mut gather, &table, until);
        assert!(gather.complete());
        assert_same(rx.as_slice(), &answers());
        assert!(rig.bus().now_ns() < until);
    }
}

fn deadline_ends_late(rig: &mut impl Rig) {
    let table = table();
    let mut gather = Gather::new(table.message_count());
    let mut rx = Frames::new(MAX_FRAMES);
    let [a, b, _, d] = answers();
    rig.send_from_peer(&frames(&[a, b, d]));
    let until = rig.bus().now_ns() + SHORT_NS;
    rig.bus().receive(&mut rx, &mut gather, &table, until);
    assert!(rig.bus().now_ns() >= until);
    assert_same(rx.as_slice(), &[a, b, d]);
    let missing: Vec<_> = gather
        .missing()
        .map(|m| table.message(m).unwrap())
        .collect();
    assert_eq!(missing.len(), 1);
    assert_eq!((missing[0].bus, missing[0].id), (1, ONE));
}

fn past_deadline_takes_waiting_frames(rig: &mut impl Rig) {
    let table = table();
    let mut gather = Gather::new(table.message_count());
    let mut rx = Frames::new(MAX_FRAMES);
    rig.bus().receive(&mut rx, &mut gather, &table, 0);
    assert!(rx.is_empty());
    rig.send_from_peer(&frames(&answers()[..2]));
    // The other end may be another thread or process: its frames are still under way.
    while rx.len() < 2 {
        rig.bus().receive(&mut rx, &mut gather, &table, 0);
    }
    assert_same(rx.as_slice(), &answers()[..2]);
    assert!(!gather.complete());
}

fn overflow_is_counted(rig: &mut impl Rig) {
    let list = mixture();
    rig.send_from_peer(&frames(&list));
    let mut rx = Frames::new(16);
    let mut never = Gather::new(1_000);
    let until = rig.bus().now_ns() + SHORT_NS;
    rig.bus().receive(&mut rx, &mut never, &table(), until);
    assert_same(rx.as_slice(), &list[..16]);
    let lost = list.len() as u64 - 16;
    assert_eq!(rx.overflow(), lost);
    let counters = rig.bus().counters();
    assert_eq!((counters.received, counters.dropped), (16, lost));
}

fn unknown_frames_pass_and_complete_nothing(rig: &mut impl Rig) {
    let table = table();
    let mut gather = Gather::new(table.message_count());
    let mut rx = Frames::new(MAX_FRAMES);
    let list = [
        frame(0, STRANGER, 8, false, 1),
        // The right ids as standard and extended mixed up, and the right id with a wrong length.
        frame(0, TWO & !EXTENDED_ID, 8, false, 2),
        frame(0, ONE | EXTENDED_ID, 8, false, 3),
        frame(1, ONE, 7, false, 4),
    ];
    rig.send_from_peer(&frames(&list));
    let until = rig.bus().now_ns() + SHORT_NS;
    rig.bus().receive(&mut rx, &mut gather, &table, until);
    assert_same(rx.as_slice(), &list);
    assert_eq!(gather.missing().count(), 4);
    assert_eq!(rig.bus().counters().received, 4);
}

/// The peer does not receive until more frames were sent than any queue holds.
fn sends_never_block_and_no_frame_is_unaccounted_for(rig: &mut impl Rig) {
    const ROUNDS: u64 = 40;
    let list = frames(&mixture());
    let accepted: usize = (0..ROUNDS).map(|_| rig.bus().send(&list)).sum();
    let counters = rig.bus().counters();
    assert_eq!(counters.sent, accepted as u64);
    assert_eq!(counters.sent + counters.send_failed, ROUNDS * 120);
    let (received, lost) = rig.received_by_peer();
    assert_eq!(received.len() as u64 + lost, counters.sent);
}

fn nothing_is_allocated(rig: &mut impl Rig) {
    let (table, list) = (table(), frames(&answers()));
    let mut gather = Gather::new(table.message_count());
    let mut rx = Frames::new(MAX_FRAMES);
    for _ in 0..10 {
        rx.clear();
        gather.begin();
        rig.send_from_peer(&list);
        let bus = rig.bus();
        let before = allocations();
        let until = bus.now_ns() + LONG_NS;
        bus.receive(&mut rx, &mut gather, &table, until);
        bus.receive(&mut rx, &mut gather, &table, 0);
        bus.send(&list);
        assert_eq!(allocations(), before);
        assert!(gather.complete());
    }
}
