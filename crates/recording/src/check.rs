//! A checksum of what a cycle gave: by it a replay shows that it computed the same bits.

use can_codec::Frames;
use robot_state::CycleRecord;
use zerocopy::IntoBytes;

use crate::compact::{Compact, Counts};
use crate::message::put_frame;

/// Computes checksums; the memory is taken once.
#[derive(Debug, Clone)]
pub(crate) struct Checker {
    record: Compact,
    bytes: Vec<u8>,
}

impl Checker {
    pub(crate) fn new(counts: Counts) -> Self {
        Self {
            record: Compact::new::<CycleRecord>(counts),
            bytes: Vec::new(),
        }
    }

    /// CRC-32 of what is in use of a cycle's record, and of the frames that were sent.
    pub(crate) fn of(&mut self, record: &CycleRecord, tx: &Frames) -> u32 {
        self.bytes.clear();
        self.record.put(record.as_bytes(), &mut self.bytes);
        for frame in tx {
            put_frame(frame, &mut self.bytes);
        }
        crc32fast::hash(&self.bytes)
    }
}
