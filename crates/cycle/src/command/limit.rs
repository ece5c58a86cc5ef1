//! Limit: the last word on every command, then the finite check.

use control::{JointLimits, MotorModel};
use robot_state::{Event, JointCommanded, command_flags};

use crate::events::Counts;

/// The command that may be sent, rad or A, from that of the control law and the measured `q`.
///
/// # Errors
/// The event if the command is not finite: the last command (or the measured position) then stands.
pub(crate) fn limit(
    motor: &MotorModel,
    limits: &JointLimits,
    command: f64,
    q: f64,
    commanded: &mut JointCommanded,
    counts: &mut Counts,
) -> Result<f64, Event> {
    let mut flags = commanded.flags;
    let limited = match motor {
        MotorModel::Position { .. } => {
            let lead = limits.delta_q(command - q);
            let position = limits.position(q + lead.value);
            flags |= lead.flags | position.flags;
            commanded.q_c = position.value;
            commanded.delta_q = position.value - q;
            position.value
        }
        MotorModel::Current { .. } => {
            let current = limits.current(command);
            flags |= current.flags;
            commanded.current_c = current.value;
            current.value
        }
    };
    commanded.flags = flags;
    if flags & command_flags::TORQUE_LIMITED != 0 {
        counts.add(Event::TorqueLimit);
    }
    if flags & (command_flags::POSITION_LIMITED | command_flags::DELTA_Q_LIMITED) != 0 {
        counts.add(Event::PositionLimit);
    }
    if limited.is_finite() {
        Ok(limited)
    } else {
        Err(Event::CommandNotFinite)
    }
}
