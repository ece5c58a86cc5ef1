//! Usable: which measured values and estimates others may rely on.

use robot_state::{TorqueEstimate, measured_flags, torque_flags};

/// Flags of measured values from which no torque follows.
pub(crate) const UNUSABLE: u32 =
    measured_flags::NEVER | measured_flags::SETTLING | measured_flags::STALE;

/// The estimate, if it may be used: of a saturated torque only the sign is known.
pub(crate) fn valid(estimate: &TorqueEstimate) -> Option<&TorqueEstimate> {
    let usable = torque_flags::VALID | torque_flags::SATURATED;
    (estimate.flags & usable == torque_flags::VALID).then_some(estimate)
}
