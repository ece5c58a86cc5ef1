//! Process data of a simulated node (CiA 301, 7.2.2 and 7.5.2.35 ff.): the rules of their set-up, and their exchange.

use super::objects::{Key, Objects, abort};

/// PDOs in each direction.
pub(super) const PDOS: u16 = 4;
/// Communication parameters, and mapping, of the first PDO that the node receives, and of the first that it sends.
pub(super) const RECEIVED: u16 = 0x1400;
pub(super) const SENT: u16 = 0x1800;
/// From the communication parameters of a PDO to its mapping.
const MAPPING: u16 = 0x200;
/// Bits of a COB-ID: the PDO does not exist; its identifier has 29 bits.
const INVALID: u32 = 1 << 31;
const EXTENDED: u32 = 1 << 29;
/// Entries of one PDO.
pub(super) const ENTRIES: u8 = 8;

/// A PDO's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Payload {
    data: [u8; 8],
    len: usize,
}

impl Payload {
    pub(super) fn of(bytes: &[u8]) -> Self {
        let len = bytes.len().min(8);
        let mut data = [0; 8];
        data[..len].copy_from_slice(&bytes[..len]);
        Self { data, len }
    }

    pub(super) fn bytes(&self) -> &[u8] {
        &self.data[..self.len]
    }
}

/// A write to a PDO's parameters is allowed.
///
/// # Errors
/// The reason of an abort.
pub(super) fn check(objects: &Objects, (index, sub): Key, bytes: &[u8]) -> Result<(), u32> {
    let mut all = [0; 4];
    let len = bytes.len().min(4);
    all[..len].copy_from_slice(&bytes[..len]);
    let value = u32::from_le_bytes(all);
    match (index & !0x3FF, index & MAPPING != 0, sub) {
        (RECEIVED | SENT, false, 1) => check_id(objects.unsigned(index, 1), value),
        (RECEIVED | SENT, false, 2) if (241..=253).contains(&value) => Err(abort::RANGE),
        (RECEIVED | SENT, true, _) => check_mapping(objects, (index, sub), value),
        _ => Ok(()),
    }
}

/// An identifier changes only while the PDO does not exist, and is none that others have.
fn check_id(old: u32, new: u32) -> Result<(), u32> {
    let restricted = matches!(
        new & 0x7FF,
        0..=0x7F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..
    );
    let exists = |id: u32| id & INVALID == 0;
    let changes = (old ^ new) & 0x1FFF_FFFF != 0;
    if new & EXTENDED != 0 || exists(new) && restricted || exists(old) && exists(new) && changes {
        return Err(abort::RANGE);
    }
    Ok(())
}

/// A mapping changes only while its PDO does not exist; its entries, while it has none.
fn check_mapping(objects: &Objects, (index, sub): Key, value: u32) -> Result<(), u32> {
    let exists = objects.unsigned(index - MAPPING, 1) & INVALID == 0;
    if exists || sub > 0 && objects.unsigned(index, 0) != 0 {
        return Err(abort::ACCESS);
    }
    let sent = index & !0x3FF == SENT;
    if sub > 0 {
        // An entry of zero is none.
        return if value == 0 {
            Ok(())
        } else {
            let (key, bits) = entry(value);
            objects.can_be_mapped(key, bits, sent)
        };
    }
    let mut bits = 0;
    for number in 1..=value.min(u32::from(u8::MAX)) as u8 {
        let (key, its) = entry(objects.unsigned(index, number));
        objects.can_be_mapped(key, its, sent)?;
        bits += u32::from(its);
    }
    if bits > 64 {
        return Err(abort::TOO_LONG_FOR_PDO);
    }
    Ok(())
}

/// Index, sub-index and bits of an entry.
fn entry(value: u32) -> (Key, u8) {
    let [bits, sub, low, high] = value.to_le_bytes();
    ((u16::from_le_bytes([low, high]), sub), bits)
}

/// The objects of a PDO and their lengths in bytes, by its communication parameters.
fn mapped(objects: &Objects, parameters: u16) -> impl Iterator<Item = (Key, usize)> + '_ {
    let mapping = parameters + MAPPING;
    let count = objects.unsigned(mapping, 0).min(u32::from(ENTRIES)) as u8;
    (1..=count).map(move |sub| {
        let (key, bits) = entry(objects.unsigned(mapping, sub));
        (key, usize::from(bits) / 8)
    })
}

/// The identifier of a PDO that exists.
pub(super) fn id(objects: &Objects, parameters: u16) -> Option<u32> {
    let id = objects.unsigned(parameters, 1);
    (id & INVALID == 0).then_some(id & 0x7FF)
}

/// The objects of a PDO in their order, as it is sent.
pub(super) fn pack(objects: &Objects, parameters: u16) -> Payload {
    let mut payload = Payload::of(&[]);
    for (key, len) in mapped(objects, parameters) {
        let bytes = objects.bytes(key).unwrap_or_default();
        let end = payload.len + len;
        if bytes.len() == len && end <= 8 {
            payload.data[payload.len..end].copy_from_slice(bytes);
            payload.len = end;
        }
    }
    payload
}

/// Takes what came by a PDO; returns how many objects it wrote, which are in `keys`.
///
/// # Errors
/// It is shorter than its mapping: nothing was taken.
pub(super) fn unpack(
    objects: &mut Objects,
    parameters: u16,
    payload: &Payload,
    keys: &mut [Key; ENTRIES as usize],
) -> Result<usize, ()> {
    let mut places = [(0, 0); ENTRIES as usize];
    let (mut count, mut end) = (0, 0);
    for (key, len) in mapped(objects, parameters) {
        keys[count] = key;
        places[count] = (end, end + len);
        (count, end) = (count + 1, end + len);
    }
    if end > payload.len {
        return Err(());
    }
    for (key, (begin, end)) in keys.iter().zip(places).take(count) {
        objects.receive(*key, &payload.data[begin..end]);
    }
    Ok(count)
}
