//! Digest of a run: equal for two runs whose records and commands are equal bit for bit.

use can_codec::Frames;
use core::fmt;
use robot_state::CycleRecord;
use zerocopy::IntoBytes;

/// Multiplier of the 64-bit FNV-1a hash, and its beginning.
const PRIME: u64 = 0x0000_0100_0000_01b3;
const BEGIN: u64 = 0xcbf2_9ce4_8422_2325;

/// FNV-1a over words of eight bytes, turned after each so that the upper bits count as well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Digest(u64);

impl Default for Digest {
    fn default() -> Self {
        Self(BEGIN)
    }
}

impl Digest {
    /// Takes a cycle's record.
    pub fn take_record(&mut self, record: &CycleRecord) {
        self.take(record.as_bytes());
    }

    /// Takes a cycle's commands.
    pub fn take_frames(&mut self, frames: &Frames) {
        for frame in frames {
            self.take(&frame.id.to_le_bytes());
            self.take(&frame.data[..usize::from(frame.len)]);
        }
    }

    fn take(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.0 = (self.0 ^ u64::from_le_bytes(word)).wrapping_mul(PRIME);
            self.0 = self.0.rotate_left(29);
        }
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}
