//! DBC files made up for a test, and the slowest possible reading of a signal.

use can_codec::{BusDbc, Dbc, SignalMap, Table};

/// A DBC file around some messages.
pub(crate) fn dbc_text(messages: &str) -> String {
    format!("VERSION \"\"\n\nNS_ :\n\nBS_:\n\nBU_: A B\n\n{messages}\n")
}

/// A DBC file that must be accepted.
pub(crate) fn dbc(messages: &str) -> Dbc {
    Dbc::parse(&dbc_text(messages), "test.dbc").unwrap_or_else(|error| panic!("{error}"))
}

/// A table of all signals of one file on bus 0, in the file's order, values as in the file.
pub(crate) fn table(dbc: &Dbc) -> Table {
    let maps = SignalMap::all(0, &dbc.messages);
    let on_bus = BusDbc {
        bus: 0,
        fd: true,
        dbc,
    };
    Table::compile(&[on_bus], &maps).unwrap_or_else(|error| panic!("{error}"))
}

/// A signal's bits, collected one by one as the DBC format describes them.
pub(crate) fn bits_one_by_one(data: &[u8], start: usize, size: usize, big_endian: bool) -> u64 {
    let bit = |byte: usize, in_byte: usize| u64::from(data[byte] >> in_byte & 1);
    let (mut byte, mut in_byte, mut value) = (start / 8, start % 8, 0);
    for i in 0..size {
        if big_endian {
            // From the most significant bit: down in the byte, then to the next byte's top.
            value = value << 1 | bit(byte, in_byte);
            (byte, in_byte) = match in_byte {
                0 => (byte + 1, 7),
                _ => (byte, in_byte - 1),
            };
        } else {
            value |= bit(byte, in_byte) << i;
            (byte, in_byte) = match in_byte {
                7 => (byte + 1, 0),
                _ => (byte, in_byte + 1),
            };
        }
    }
    value
}
