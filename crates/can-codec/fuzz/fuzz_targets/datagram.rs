//! Any datagram: a frame that a bus carries, or none; a frame that is read is written as one that
//! reads the same.
#![no_main]

use can_codec::{DATAGRAM_BYTES, EXTENDED_ID, Frame, from_datagram, to_datagram};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some(frame) = from_datagram(3, bytes) else {
        return;
    };
    let most = if frame.fd { 64 } else { 8 };
    assert!(frame.bus == 3 && !frame.error && frame.len <= most);
    let extended = frame.id & EXTENDED_ID != 0;
    let last_id = if extended { 0x1fff_ffff } else { 0x7ff };
    assert!(frame.id & !EXTENDED_ID <= last_id);
    assert!(frame.data[usize::from(frame.len)..].iter().all(|&byte| byte == 0));
    let mut out = [0; DATAGRAM_BYTES];
    let length = to_datagram(&frame, &mut out).expect("a frame that was read can be written");
    let again: Option<Frame> = from_datagram(3, &out[..length]);
    assert_eq!(again, Some(frame));
});
