//! Proportional-integral: the torque's error is fed back (D11).

use control::TorqueLoop;
use robot_state::JointCommanded;

use super::{Desired, against_friction, lead_motor, sum};
use crate::joint::JointInput;
use crate::joint::constants::Constants;

/// The command of a cycle, rad or A.
pub(super) fn command(
    torque_loop: &mut TorqueLoop,
    desired: &Desired,
    joint: &Constants,
    input: &JointInput<'_>,
    commanded: &mut JointCommanded,
) -> f64 {
    let tau_d = sum(&desired.terms);
    let limit = joint.limits.torque;
    let tau_star = torque_loop.update(tau_d, input.torque(), &joint.gains, limit, input.dt);
    let friction = against_friction(joint, input);
    lead_motor(desired, (tau_star, friction), joint, input, commanded)
}
