//! What a drive reports of itself besides its sample: temperature, voltage, its own torque, its error. Each at a rate
//! of its own, and nothing waits for it.

use robot_config::{JointParameters, slots};
use robot_state::{JointMeasured, reported_flags};

use super::reception::Reception;
use crate::time::Stamp;

/// Time after which a value counts as not reported any more, ns: ten periods of the slowest rate that is asked for.
const OLD_NS: u64 = 1_000_000_000;

/// A value: its bit of `reported_flags`, its slot, and the message that carries it.
type Value = (u32, usize, Option<usize>);

/// The values of one joint's drive.
#[derive(Debug)]
pub(super) struct Reported([Option<Value>; 4]);

impl Reported {
    pub(super) fn new(j: usize, joint: &JointParameters, reception: &Reception) -> Self {
        let all = [
            (reported_flags::TEMPERATURE, slots::temperature(j)),
            (reported_flags::VOLTAGE, slots::voltage(j)),
            (reported_flags::TORQUE, slots::drive_torque(j)),
            (reported_flags::ERROR, slots::drive_error(j)),
        ];
        Self(all.map(|(bit, slot)| {
            (joint.reports & bit != 0).then(|| (bit, slot, reception.message_of(slot)))
        }))
    }

    /// Writes what is known now into the record; what is not keeps its last value, without its bit.
    pub(super) fn read(&self, reception: &Reception, now: Stamp, measured: &mut JointMeasured) {
        measured.reported = 0;
        for &(bit, slot, message) in self.0.iter().flatten() {
            let stamp = message.and_then(|m| reception.stamps().get(m).copied().flatten());
            let is_old = stamp.is_none_or(|stamp| now.0.saturating_sub(stamp) > OLD_NS);
            let value = reception.slot(slot);
            if is_old || !value.is_finite() {
                continue;
            }
            measured.reported |= bit;
            match bit {
                reported_flags::TEMPERATURE => measured.temperature = value,
                reported_flags::VOLTAGE => measured.voltage = value,
                reported_flags::TORQUE => measured.tau_drive = value,
                _ => measured.drive_error = value as u32,
            }
        }
    }
}
