//! A frame as a datagram: python-can's format of `udp_multicast`, a MessagePack map of the fields of
//! `can.Message` under their names.
//!
//! A frame becomes the very bytes that python-can makes of the same message. A datagram is read as
//! python-can reads it, in any order of the keys, but only where it is a data frame as a bus carries
//! them: remote frames and error frames have no meaning here.

use crate::frame::{EXTENDED_ID, Frame, MAX_DATA};
use rmp::{Marker, decode, encode};

/// Bytes of the longest datagram that [`to_datagram`] makes.
pub const DATAGRAM_BYTES: usize = 220;

/// Data of a classic frame, bytes.
const CLASSIC_DATA: usize = 8;
/// Bits of a standard and of an extended identifier.
const STANDARD_MASK: u32 = 0x7ff;
const EXTENDED_MASK: u32 = 0x1fff_ffff;
/// Fields of `can.Message`.
const FIELDS: u32 = 11;

/// Writes the frame to the beginning of `out`; the number of bytes, or `None` for a frame that no bus
/// carries: an error frame, one with an identifier out of range or too many bytes.
///
/// Its time and channel are not sent: the receiver sets its own. An FD frame's data travel at the
/// data bit rate.
#[must_use]
pub fn to_datagram(frame: &Frame, out: &mut [u8; DATAGRAM_BYTES]) -> Option<usize> {
    let extended = frame.id & EXTENDED_ID != 0;
    let id = frame.id & !EXTENDED_ID;
    let used = usize::from(frame.len);
    if frame.error || !is_data_frame(id, extended, used, frame.fd) {
        return None;
    }
    let data = frame.data.get(..used)?;
    let mut rest = out.as_mut_slice();
    let to = &mut rest;
    encode::write_map_len(to, FIELDS).ok()?;
    encode::write_str(to, "timestamp").ok()?;
    encode::write_f64(to, 0.0).ok()?;
    encode::write_str(to, "arbitration_id").ok()?;
    encode::write_uint(to, id.into()).ok()?;
    write_flag(to, "is_extended_id", extended)?;
    write_flag(to, "is_remote_frame", false)?;
    write_flag(to, "is_error_frame", false)?;
    encode::write_str(to, "channel").ok()?;
    encode::write_nil(to).ok()?;
    encode::write_str(to, "dlc").ok()?;
    encode::write_uint(to, used as u64).ok()?;
    encode::write_str(to, "data").ok()?;
    encode::write_bin(to, data).ok()?;
    write_flag(to, "is_fd", frame.fd)?;
    write_flag(to, "bitrate_switch", frame.fd)?;
    write_flag(to, "error_state_indicator", false)?;
    let left = rest.len();
    Some(DATAGRAM_BYTES - left)
}

fn write_flag(to: &mut &mut [u8], name: &str, flag: bool) -> Option<()> {
    encode::write_str(to, name).ok()?;
    encode::write_bool(to, flag).ok()
}

/// The frame of a datagram that arrived on the bus, without a stamp; `None` if it is none that a bus
/// carries.
#[must_use]
pub fn from_datagram(bus: u8, datagram: &[u8]) -> Option<Frame> {
    let mut rest = datagram;
    let mut id = None;
    let mut extended = None;
    let mut data = None;
    let mut length = None;
    let mut fd = false;
    for _ in 0..decode::read_map_len(&mut rest).ok()? {
        let (name, value) = decode::read_str_from_slice(rest).ok()?;
        rest = value;
        match name {
            "arbitration_id" => id = Some(decode::read_int::<u32, _>(&mut rest).ok()?),
            "is_extended_id" => extended = Some(decode::read_bool(&mut rest).ok()?),
            "data" => data = Some(read_bytes(&mut rest)?),
            "dlc" => length = Some(decode::read_int::<usize, _>(&mut rest).ok()?),
            "is_fd" => fd = decode::read_bool(&mut rest).ok()?,
            "is_remote_frame" | "is_error_frame" => {
                if decode::read_bool(&mut rest).ok()? {
                    return None;
                }
            }
            _ => skip(&mut rest)?,
        }
    }
    let (id, extended, data) = (id?, extended?, data?);
    let used = data.len();
    let whole = rest.is_empty() && length.is_none_or(|length| length == used);
    if !whole || !is_data_frame(id, extended, used, fd) {
        return None;
    }
    let mark = if extended { EXTENDED_ID } else { 0 };
    let mut frame = Frame::zeroed(bus, id | mark, used as u8, fd);
    frame.data.get_mut(..used)?.copy_from_slice(data);
    Some(frame)
}

fn is_data_frame(id: u32, extended: bool, used: usize, fd: bool) -> bool {
    let mask = if extended {
        EXTENDED_MASK
    } else {
        STANDARD_MASK
    };
    let most = if fd { MAX_DATA } else { CLASSIC_DATA };
    id <= mask && used <= most
}

fn read_bytes<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let length = decode::read_bin_len(rest).ok()?;
    let (data, after) = rest.split_at_checked(length as usize)?;
    *rest = after;
    Some(data)
}

/// Passes over the value of a field that is not used. No field of a message is a list or a map.
fn skip(rest: &mut &[u8]) -> Option<()> {
    let length = match decode::read_marker(rest).ok()? {
        Marker::Null | Marker::True | Marker::False | Marker::FixPos(_) | Marker::FixNeg(_) => 0,
        Marker::U8 | Marker::I8 => 1,
        Marker::U16 | Marker::I16 => 2,
        Marker::U32 | Marker::I32 | Marker::F32 => 4,
        Marker::U64 | Marker::I64 | Marker::F64 => 8,
        Marker::FixStr(length) => usize::from(length),
        Marker::Str8 | Marker::Bin8 => usize::from(big_endian(rest).map(u8::from_be_bytes)?),
        Marker::Str16 | Marker::Bin16 => usize::from(big_endian(rest).map(u16::from_be_bytes)?),
        _ => return None,
    };
    *rest = rest.get(length..)?;
    Some(())
}

fn big_endian<const N: usize>(rest: &mut &[u8]) -> Option<[u8; N]> {
    let (bytes, after) = rest.split_first_chunk()?;
    *rest = after;
    Some(*bytes)
}
