//! Any frame against the leg's messages: decoded or refused, and what is decoded is in range.
#![no_main]

use can_codec::{BusDbc, Dbc, Frame, Gather, SignalMap, Table};
use libfuzzer_sys::fuzz_target;
use std::sync::LazyLock;

const LEG: &str = include_str!("../../../../robot-models/leg/drives.dbc");

static TABLE: LazyLock<(Table, Vec<(f64, f64)>)> = LazyLock::new(|| {
    let dbc = Dbc::parse(LEG, "drives.dbc").expect("the leg's messages");
    let maps = SignalMap::all(1, &dbc.messages);
    let range = |(_, map): &(u8, SignalMap)| {
        let signal = dbc.signal(&map.message, &map.signal).expect("a signal");
        let (first, last) = signal.raw_range();
        let ends = [first, last].map(|raw| raw * signal.scale + signal.offset);
        (ends[0].min(ends[1]), ends[0].max(ends[1]))
    };
    let ranges = maps.iter().map(range).collect();
    let bus = BusDbc {
        bus: 1,
        fd: false,
        dbc: &dbc,
    };
    (Table::compile(&[bus], &maps).expect("a table"), ranges)
});

fuzz_target!(|bytes: &[u8]| {
    let (table, ranges) = &*TABLE;
    let byte = |i: usize| bytes.get(i).copied().unwrap_or(0);
    let mut frame = Frame::zeroed(byte(0), 0, 0, byte(1) & 1 != 0);
    frame.error = byte(1) & 2 != 0;
    frame.len = byte(2);
    frame.id = u32::from_le_bytes([byte(3), byte(4), byte(5), byte(6)]);
    for (data, byte) in frame.data.iter_mut().zip(bytes.iter().skip(7)) {
        *data = *byte;
    }
    let mut slots = vec![0.0; ranges.len()];
    let _complete = Gather::new(table.message_count()).note(table, &frame);
    if let Ok(Some(index)) = table.decode(&frame, &mut slots) {
        for slot in table.slots(index) {
            let (min, max) = ranges[slot];
            assert!(slots[slot] >= min && slots[slot] <= max);
        }
    }
    let _payload = frame.payload();
});
