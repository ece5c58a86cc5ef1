//! Limit: the last word on every command, then the finite check.

use control::{JointLimits, MotorModel};
use robot_state::{Event, JointRecord, control_flags};

use crate::events::Counts;

/// The command that may be sent. `Err` carries the event if there is none: the last command (or
/// the measured position) then stands.
pub(crate) fn limit(
    motor: &MotorModel,
    limits: &JointLimits,
    command: f64,
    record: &mut JointRecord,
    counts: &mut Counts,
) -> Result<f64, Event> {
    let mut flags = record.control.flags;
    let limited = match motor {
        MotorModel::Position { .. } => {
            let q = record.measured.q;
            let lead = limits.delta_q(command - q);
            let position = limits.position(q + lead.value);
            flags |= lead.flags | position.flags;
            record.control.q_c = position.value;
            record.control.delta_q = position.value - q;
            position.value
        }
        MotorModel::Current { .. } => {
            let current = limits.current(command);
            flags |= current.flags;
            record.control.current_c = current.value;
            current.value
        }
    };
    record.control.flags = flags;
    if flags & control_flags::TORQUE_LIMITED != 0 {
        counts.add(Event::TorqueLimit);
    }
    if flags & (control_flags::POSITION_LIMITED | control_flags::DELTA_Q_LIMITED) != 0 {
        counts.add(Event::PositionLimit);
    }
    if limited.is_finite() {
        Ok(limited)
    } else {
        Err(Event::CommandNotFinite)
    }
}
