//! The message of one cycle with what it was given alone: a replay computes the rest.
//!
//! ```text
//! a block is XORed with the same block of the message before it, if that has the same length;
//! numbers are little-endian
//! head    u32 flags: 1 a reference, 2 settings, 4 an operator's request, 8 notes were lost, 16 the
//!         reference of the message before, 32 its settings; u32 notes; u32 frames received
//!         u32 kind of the operator's request, u32 the fault that it acknowledges
//!         u32 CRC-32 of the cycle's record and of the frames sent
//!         u64 instant of SYNC, ns; u64 now, ns; f64 age of the reference, s
//!         u64 received frames that found no room
//!         the record of the cycle up to its measured values; the record of the loop around it
//! notes   u64 number of the event, u64 times
//! reference, settings: if there are any, and other ones than before; in their compact layout
//! heads of the frames received: u32 identifier, u8 bus, u8 length, u8 flags: 1 CAN FD, 2 error, u8 0
//! their stamps: the difference to the one before (at first to SYNC) as eight planes of bytes, not XORed
//! their data, each XORed with that of the last frame of its bus and identifier
//! ```

use std::collections::BTreeMap;

use can_codec::{Frame, Frames, MAX_DATA, MAX_FRAMES};
use core::mem::offset_of;
use cycle::Stamp;
use robot_state::{CycleRecord, Event, Reference, Settings, Zero};
use zerocopy::IntoBytes;

use crate::check::Checker;
use crate::compact::{Compact, Counts};
use crate::message::{
    CycleMessage, HAS_REFERENCE, HAS_REQUEST, HAS_SETTINGS, NOTES_LOST, operator_request,
    request_numbers, take, take_u32, take_u64,
};

const SAME_REFERENCE: u32 = 16;
const SAME_SETTINGS: u32 = 32;

/// Bytes of a cycle's record that stand in a message: its states, without what a replay computes.
pub(crate) const RECORD_HEAD: usize = offset_of!(CycleRecord, measured);
const NUMBERS: usize = 6 * 4 + 4 * 8;
const FRAME_HEAD: usize = 8;

/// What messages are relative to; the same in whoever writes and whoever reads.
#[derive(Debug, Clone)]
pub(crate) struct FramesCoder {
    reference: Compact,
    settings: Compact,
    checker: Checker,
    last: Last,
    block: Vec<u8>,
}

/// Blocks of the message before.
#[derive(Debug, Clone, Default)]
struct Last {
    head: Vec<u8>,
    reference: Vec<u8>,
    settings: Vec<u8>,
    frame_heads: Vec<u8>,
    data: BTreeMap<(u8, u32), [u8; MAX_DATA]>,
}

impl FramesCoder {
    pub(crate) fn new(counts: Counts) -> Self {
        Self {
            reference: Compact::new::<Reference>(counts),
            settings: Compact::new::<Settings>(counts),
            checker: Checker::new(counts),
            last: Last::default(),
            block: Vec::new(),
        }
    }

    /// Appends the message of the next cycle.
    pub(crate) fn put(&mut self, message: &CycleMessage, out: &mut Vec<u8>) {
        let Self { last, block, .. } = self;
        let mut compact = |compact: &Compact, record: Option<&[u8]>, last: &[u8]| {
            block.clear();
            compact.put(record?, block);
            Some((block.clone(), *block == last))
        };
        let reference = message.reference().map(IntoBytes::as_bytes);
        let reference = compact(&self.reference, reference, &last.reference);
        let settings = message.settings().map(IntoBytes::as_bytes);
        let settings = compact(&self.settings, settings, &last.settings);
        let flag = |set: bool, bit: u32| if set { bit } else { 0 };
        let given = |block: &Option<(Vec<u8>, bool)>, new: u32, same: u32| match block {
            None => 0,
            Some((_, true)) => new | same,
            Some((_, false)) => new,
        };
        let flags = given(&reference, HAS_REFERENCE, SAME_REFERENCE)
            | given(&settings, HAS_SETTINGS, SAME_SETTINGS)
            | flag(message.request.is_some(), HAS_REQUEST)
            | flag(message.notes_lost, NOTES_LOST);
        let check = self.checker.of(&message.record.cycle, &message.tx);
        put_head(message, flags, check, block);
        put_relative(block, &mut last.head, out);
        for (event, times) in &message.notes {
            out.extend_from_slice(&u64::from(event.number()).to_le_bytes());
            out.extend_from_slice(&times.to_le_bytes());
        }
        if let Some((bytes, false)) = reference {
            put_relative(&bytes, &mut last.reference, out);
        }
        if let Some((bytes, false)) = settings {
            put_relative(&bytes, &mut last.settings, out);
        }
        block.clear();
        for frame in &message.rx {
            put_frame_head(frame, block);
        }
        put_relative(block, &mut last.frame_heads, out);
        put_stamps(&message.rx, message.at.sync, out);
        for frame in &message.rx {
            let data = frame.payload();
            let before = last.data_of(frame.bus, frame.id);
            out.extend(
                data.iter()
                    .zip(&*before)
                    .map(|(byte, before)| byte ^ before),
            );
            if let Some(to) = before.get_mut(..data.len()) {
                to.copy_from_slice(data);
            }
        }
    }

    /// Reads the next message; `None` if the bytes are none.
    pub(crate) fn take(&mut self, bytes: &[u8], message: &mut CycleMessage) -> Option<()> {
        let mut rest = bytes;
        let last = &mut self.last;
        let head_len = NUMBERS + RECORD_HEAD + size_of_val(&message.record.timing);
        take_relative(&mut rest, head_len, &mut last.head)?;
        let head = take_head(&last.head, message)?;
        message.notes.clear();
        for _ in 0..head.notes {
            let number = u32::try_from(take_u64(&mut rest)?).ok()?;
            let times = take_u64(&mut rest)?;
            message.notes.push((Event::from_number(number)?, times));
        }
        let mut record = |compact: &Compact, same: u32, last: &mut Vec<u8>, to: &mut [u8]| {
            match head.flags & same {
                0 => take_relative(&mut rest, compact.len(), last)?,
                _ => (last.len() == compact.len()).then_some(())?,
            }
            compact.take(last, to);
            Some(())
        };
        message.reference = None;
        if head.flags & HAS_REFERENCE != 0 {
            let reference = message.reference.insert(Reference::ZERO).as_mut_bytes();
            let (compact, last) = (&self.reference, &mut last.reference);
            record(compact, SAME_REFERENCE, last, reference)?;
        }
        message.settings = None;
        if head.flags & HAS_SETTINGS != 0 {
            let settings = message.settings.insert(Settings::ZERO).as_mut_bytes();
            let (compact, last) = (&self.settings, &mut last.settings);
            record(compact, SAME_SETTINGS, last, settings)?;
        }
        take_frames(&mut rest, &head, message.at.sync, last, &mut message.rx)?;
        message.tx.clear();
        rest.is_empty().then_some(())
    }
}

impl Last {
    fn data_of(&mut self, bus: u8, id: u32) -> &mut [u8; MAX_DATA] {
        self.data.entry((bus, id)).or_insert([0; MAX_DATA])
    }
}

fn put_head(message: &CycleMessage, flags: u32, check: u32, block: &mut Vec<u8>) {
    block.clear();
    let (kind, fault) = message.request.map_or((0, 0), request_numbers);
    let (notes, frames) = (message.notes.len() as u32, message.rx.len() as u32);
    for number in [flags, notes, frames, kind, fault, check] {
        block.extend_from_slice(&number.to_le_bytes());
    }
    let (sync, now) = (message.at.sync.0, message.at.now.0);
    for number in [sync, now, message.age_s.to_bits(), message.rx.overflow()] {
        block.extend_from_slice(&number.to_le_bytes());
    }
    let record = message.record.cycle.as_bytes();
    block.extend_from_slice(record.get(..RECORD_HEAD).unwrap_or_default());
    block.extend_from_slice(message.record.timing.as_bytes());
}

/// Numbers of a head that say what follows.
struct Head {
    flags: u32,
    notes: u32,
    frames: usize,
    overflow: u64,
}

fn take_head(mut head: &[u8], message: &mut CycleMessage) -> Option<Head> {
    let rest = &mut head;
    let [flags, notes, frames] = [take_u32(rest)?, take_u32(rest)?, take_u32(rest)?];
    let [kind, fault, check] = [take_u32(rest)?, take_u32(rest)?, take_u32(rest)?];
    message.at.sync = Stamp(take_u64(rest)?);
    message.at.now = Stamp(take_u64(rest)?);
    message.age_s = f64::from_bits(take_u64(rest)?);
    let overflow = take_u64(rest)?;
    message.request = match flags & HAS_REQUEST {
        0 => None,
        _ => Some(operator_request(kind, fault)?),
    };
    message.notes_lost = flags & NOTES_LOST != 0;
    message.check = Some(check);
    let record = message.record.cycle.as_mut_bytes();
    let (own, computed) = record.split_at_mut_checked(RECORD_HEAD)?;
    own.copy_from_slice(take(rest, RECORD_HEAD)?);
    computed.fill(0);
    message.record.timing.as_mut_bytes().copy_from_slice(rest);
    let frames = frames as usize;
    (frames <= MAX_FRAMES).then_some(Head {
        flags,
        notes,
        frames,
        overflow,
    })
}

fn put_frame_head(frame: &Frame, block: &mut Vec<u8>) {
    let flags = u8::from(frame.fd) | u8::from(frame.error) << 1;
    block.extend_from_slice(&frame.id.to_le_bytes());
    block.extend_from_slice(&[frame.bus, frame.payload().len() as u8, flags, 0]);
}

fn put_stamps(frames: &Frames, sync: Stamp, out: &mut Vec<u8>) {
    for plane in 0..8 {
        let mut before = sync.0;
        for frame in frames {
            let difference = frame.stamp_ns.wrapping_sub(before);
            before = frame.stamp_ns;
            out.push((difference >> (8 * plane)) as u8);
        }
    }
}

fn take_frames(
    rest: &mut &[u8],
    head: &Head,
    sync: Stamp,
    last: &mut Last,
    frames: &mut Frames,
) -> Option<()> {
    frames.clear();
    take_relative(rest, head.frames * FRAME_HEAD, &mut last.frame_heads)?;
    let planes = take(rest, head.frames * 8)?;
    let mut stamp_ns = sync.0;
    let heads = std::mem::take(&mut last.frame_heads);
    for (i, mut own) in heads.chunks_exact(FRAME_HEAD).enumerate() {
        let id = take_u32(&mut own)?;
        let &[bus, len, flags, _] = own else {
            return None;
        };
        let byte = |plane: usize| planes.get(plane * head.frames + i).copied().map(u64::from);
        let difference = (0..8).try_fold(0, |sum, plane| Some(sum | byte(plane)? << (8 * plane)));
        stamp_ns = stamp_ns.wrapping_add(difference?);
        let before = last.data_of(bus, id).get_mut(..usize::from(len))?;
        let changed = take(rest, usize::from(len))?;
        for (to, changed) in before.iter_mut().zip(changed) {
            *to ^= changed;
        }
        let mut frame = Frame::zeroed(bus, id, len, flags & 1 != 0);
        frame.error = flags & 2 != 0;
        frame.stamp_ns = stamp_ns;
        frame.data.get_mut(..before.len())?.copy_from_slice(before);
        frames.push(frame);
    }
    last.frame_heads = heads;
    frames.count_overflow(head.overflow);
    Some(())
}

/// Appends a block relative to the last one of its kind, and keeps it.
pub(crate) fn put_relative(block: &[u8], last: &mut Vec<u8>, out: &mut Vec<u8>) {
    if block.len() == last.len() {
        out.extend(block.iter().zip(&*last).map(|(byte, before)| byte ^ before));
    } else {
        out.extend_from_slice(block);
    }
    last.clear();
    last.extend_from_slice(block);
}

/// Reads a block of a length into `last`.
pub(crate) fn take_relative(rest: &mut &[u8], len: usize, last: &mut Vec<u8>) -> Option<()> {
    let bytes = take(rest, len)?;
    if last.len() == len {
        for (to, changed) in last.iter_mut().zip(bytes) {
            *to ^= changed;
        }
    } else {
        last.clear();
        last.extend_from_slice(bytes);
    }
    Some(())
}
