//! Any text: the reader refuses it, or it describes tables that work both ways.
#![no_main]

use can_codec::{BusDbc, Dbc, Frame, SignalMap, Table};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let Ok(dbc) = Dbc::parse(text, "fuzz.dbc") else {
        return;
    };
    let mut maps = SignalMap::all(0, &dbc.messages);
    for (slot, (_, map)) in maps.iter_mut().enumerate() {
        let signal = dbc.signal(&map.message, &map.signal);
        map.wraps = slot % 2 == 0 && signal.is_some_and(|signal| signal.coding.is_integer());
    }
    let bus = BusDbc {
        bus: 0,
        fd: true,
        dbc: &dbc,
    };
    let Ok(table) = Table::compile(&[bus], &maps) else {
        return;
    };
    let mut slots = vec![0.0; maps.len()];
    for index in 0..table.message_count() {
        let mut frame = Frame::zeroed(0, 0, 0, false);
        assert!(table.encode(index, &slots, &mut frame));
        assert_eq!(table.classify(&frame), Some(index));
        assert_eq!(table.decode(&frame, &mut slots), Ok(Some(index)));
        slots.fill(0.0);
    }
});
