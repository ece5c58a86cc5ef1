//! Unit of a current by its size alone: no reference is needed.

use super::LogKind;
use super::signals::{Signals, span};
use joint_file::JointFile;
use problem::Problem;

/// Torque of the current, by gear ratio and torque constant, over the joint's torque limit, that no motor reaches.
/// Motors are built for some times the gear's torque, friction and rotor included. Currents in mA of a joint loaded to a
/// tenth show a hundred times.
const MAX_OVER_LIMIT: f64 = 20.0;
/// Multiple of that bound up to which thousandths of an ampere explain it.
const THOUSANDTHS: f64 = 1000.0;

/// A current that would be more than any motor of the joint can give.
pub(super) fn unit(s: &Signals, joint: &JointFile, kind: LogKind) -> Option<Problem> {
    let j = &joint.joint;
    let limit = joint.torque_limit();
    let torque = 0.5 * j.gear_ratio * j.torque_constant * span(&s.current);
    if torque < MAX_OVER_LIMIT * limit {
        return None;
    }
    let name = kind.name("i");
    let thousandths = if torque < MAX_OVER_LIMIT * limit * THOUSANDTHS {
        format!("; is {name} in mA?")
    } else {
        String::new()
    };
    let reason = format!(
        "{name} varies by ±{:.4} A, which by gear ratio and `torque_constant_Nm_per_A` are ±{torque:.0} N·m, {:.0} times \
         the joint's torque limit: unit of {name}, or of `torque_constant_Nm_per_A`{thousandths}",
        0.5 * span(&s.current),
        torque / limit,
    );
    let allowed =
        format!("A of the motor; at most {MAX_OVER_LIMIT} times the torque limit of {limit} N·m");
    Some(Problem::new(reason, allowed))
}
