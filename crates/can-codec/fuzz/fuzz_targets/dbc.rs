//! Any text: the reader refuses it, or it describes tables that work both ways.
#![no_main]

use can_codec::{BusDbc, Dbc, Frame, SignalMap, Table};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|text: &str| {
    let Ok(dbc) = Dbc::parse(text, "fuzz.dbc") else {
        return;
    };
    let pairs = dbc.messages.iter().flat_map(|message| {
        let signals = message.signals.iter().filter(|signal| !signal.multiplexed);
        signals.map(move |signal| (&message.name, signal))
    });
    let maps: Vec<(u8, SignalMap)> = pairs
        .enumerate()
        .map(|(slot, (message, signal))| {
            let map = SignalMap {
                slot,
                message: message.clone(),
                signal: signal.name.clone(),
                scale: 1.0,
                offset: 0.0,
                wraps: signal.coding.is_integer() && slot % 2 == 0,
            };
            (0, map)
        })
        .collect();
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
