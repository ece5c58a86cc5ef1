//! The message of a cycle with its torques, and what one reads beside them.
//!
//! ```text
//! words of four bytes: floats as 32-bit floats, integers of 64 bits as two words, the lower one first,
//! in the order of the schema's fields; each XORed with that of the message before, then as four planes:
//! the lowest bytes of all words, then the second ones, up to the highest
//! ```

use robot_state::SharedRecord;
use zerocopy::IntoBytes;

use crate::compact::Counts;
use crate::fields::{Field, Fields, Kind};
use crate::message::CycleMessage;

/// Groups of the record of which not all is recorded.
const STAGES: [&str; 4] = ["measured", "estimated", "commanded", "events"];
/// Beginnings of the paths of what is recorded, without indices.
const CHOSEN: [&str; 23] = [
    "measured.filter_delay_s",
    "measured.joints.q",
    "measured.joints.theta",
    "measured.joints.current",
    "measured.joints.dq",
    "measured.joints.temperature",
    "measured.joints.flags",
    "measured.ft.wrench",
    "measured.ft.flags",
    "measured.imu.gyro",
    "measured.imu.accelerometer",
    "measured.imu.flags",
    "estimated.joints.tau_encoder",
    "estimated.joints.tau_whole_body",
    "estimated.joints.tau_current",
    "estimated.joints.tau_hat",
    "estimated.joints.tau_ext",
    "estimated.joints.contact_flag",
    "estimated.ft.contact_wrench",
    "estimated.contact_set",
    "estimated.warning",
    "commanded.joints",
    "events",
];
/// Of these only what carries a torque or a state, not its parts.
const LEFT_OUT: [&str; 11] = [
    "measured.imu.gyro_hat",
    "measured.imu.accelerometer_hat",
    "measured.ft.wrench_hat",
    "measured.joints.dq_hat",
    "measured.joints.q_hat",
    "estimated.joints.tau_ext_change",
    "commanded.joints.delta_q",
    "commanded.joints.asked",
    "commanded.joints.feed",
    "commanded.joints.following_error",
    "commanded.joints.command_delay",
];

/// Whether a field of the shared record is recorded.
fn is_recorded(field: &Field) -> bool {
    let of_cycle = field.path.strip_prefix("cycle.");
    of_cycle.map_or(field.path.starts_with("timing."), is_in_torques)
}

/// Whether recordings of torques hold the field of a cycle's record with this path.
#[must_use]
pub fn is_in_torques(path: &str) -> bool {
    let names = path
        .split('.')
        .map(|part| part.split('[').next().unwrap_or(part));
    let path = names.collect::<Vec<_>>().join(".");
    let begins = |with: &&str| path.starts_with(*with);
    let of_head = !STAGES.iter().any(begins);
    of_head || (CHOSEN.iter().any(begins) && !LEFT_OUT.iter().any(begins))
}

/// Writes and reads messages; each is relative to the one before.
#[derive(Debug, Clone)]
pub(crate) struct TorquesCoder {
    fields: Vec<Field>,
    words: usize,
    last: Vec<u32>,
}

impl TorquesCoder {
    pub(crate) fn new(counts: Counts) -> Self {
        let mut fields = Fields::new::<SharedRecord>(counts).0;
        fields.retain(is_recorded);
        let words = fields.iter().map(|field| words_of(field.kind)).sum();
        Self {
            fields,
            words,
            last: vec![0; words],
        }
    }

    /// The fields in the order of the message.
    pub(crate) fn fields(&self) -> &[Field] {
        &self.fields
    }

    pub(crate) fn put(&mut self, message: &CycleMessage, out: &mut Vec<u8>) {
        let record = message.record.as_bytes();
        let start = out.len();
        out.resize(start + 4 * self.words, 0);
        let Some(planes) = out.get_mut(start..) else {
            return;
        };
        let mut last = self.last.iter_mut().enumerate();
        for field in &self.fields {
            for word in words(field, record).into_iter().take(words_of(field.kind)) {
                let Some((i, last)) = last.next() else {
                    return;
                };
                let changed = word ^ std::mem::replace(last, word);
                for (plane, byte) in changed.to_le_bytes().into_iter().enumerate() {
                    if let Some(to) = planes.get_mut(plane * self.words + i) {
                        *to = byte;
                    }
                }
            }
        }
    }

    pub(crate) fn take(&mut self, bytes: &[u8], message: &mut CycleMessage) -> Option<()> {
        if bytes.len() != 4 * self.words {
            return None;
        }
        for (i, last) in self.last.iter_mut().enumerate() {
            let byte = |plane: usize| bytes.get(plane * self.words + i).copied();
            *last ^= u32::from_le_bytes([byte(0)?, byte(1)?, byte(2)?, byte(3)?]);
        }
        *message = CycleMessage {
            record: std::mem::take(&mut message.record),
            ..CycleMessage::default()
        };
        let record = message.record.as_mut_bytes();
        record.fill(0);
        let mut words = self.last.as_slice();
        for field in &self.fields {
            let (own, rest) = words.split_at_checked(words_of(field.kind))?;
            words = rest;
            set(field, own, record)?;
        }
        message.at.now = cycle::Stamp(message.record.cycle.stamp_ns);
        message.at.sync = message.at.now;
        Some(())
    }
}

fn words_of(kind: Kind) -> usize {
    match kind {
        Kind::U64 => 2,
        Kind::U8 | Kind::U32 | Kind::F64 => 1,
    }
}

fn words(field: &Field, record: &[u8]) -> [u32; 2] {
    let bits = field.bits(record);
    match field.kind {
        Kind::F64 => [(f64::from_bits(bits) as f32).to_bits(), 0],
        Kind::U8 | Kind::U32 | Kind::U64 => [bits as u32, (bits >> 32) as u32],
    }
}

fn set(field: &Field, words: &[u32], record: &mut [u8]) -> Option<()> {
    let low = *words.first()?;
    let high = words.get(1).copied().unwrap_or(0);
    let number = match field.kind {
        Kind::F64 => f64::from(f32::from_bits(low)).to_bits(),
        Kind::U8 | Kind::U32 | Kind::U64 => u64::from(low) | u64::from(high) << 32,
    };
    let to = field.bytes_mut(record)?;
    let from = number.to_le_bytes();
    to.copy_from_slice(from.get(..to.len())?);
    Some(())
}
