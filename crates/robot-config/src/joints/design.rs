//! The predictive law's design for each joint, chosen by its margins.

use crate::parameters::{JointParameters, Parameters, TorqueLaw};
use control::margins::{JointLoop, NEEDED, choose_design};
use control::predictive::{Design, DriveModel};

/// The predictive law's loop of a joint as its margins are computed from it, with K_s and K_d.
#[must_use]
pub fn predictive_loop(joint: &JointParameters) -> JointLoop {
    JointLoop {
        stiffness: joint.gains.k_s,
        damping: joint.gains.k_d,
        ..JointLoop::nominal(joint.law, joint.drive_lag, joint.link_inertia)
    }
}

/// The joints of two sides are alike but for the rounding of what hangs on them.
fn is_alike(one: &JointLoop, other: &JointLoop) -> bool {
    let inertia = one.link_inertia;
    let alike = JointLoop {
        link_inertia: inertia,
        ..*other
    };
    *one == alike && (other.link_inertia - inertia).abs() <= 1e-9 * inertia
}

/// Velocity by which both encoders of a joint may err as one, rad/s, the time until that is noticed, s, and the share of
/// the velocity limit that the joint may have by then.
const DRIFT: f64 = 0.1;
const NOTICED_WITHIN: f64 = 0.02;
const DRIFT_SHARE: f64 = 0.2;

/// The drive's damping may go along with quick changes of the velocity. Where both encoders err as one that is a force
/// that nothing asked for: a joint that it would speed up too much keeps the slower default.
fn may_follow_quicker(joint: &JointParameters) -> bool {
    let DriveModel::Position { damping, .. } = joint.law.drive else {
        return false;
    };
    let inertia = joint.law.rotor_inertia + joint.link_inertia;
    let speed = damping * joint.kind.threshold(DRIFT) * NOTICED_WITHIN / inertia;
    speed <= DRIFT_SHARE * joint.limits.velocity
}

/// Chooses the design of every joint that follows the predictive law; joints that are alike share one.
pub(crate) fn choose_designs(parameters: &mut Parameters) {
    if !matches!(parameters.torque_law, TorqueLaw::Predictive(_)) {
        return;
    }
    let mut chosen: Vec<(JointLoop, bool, Design)> = Vec::new();
    for joint in (parameters.joints.iter_mut()).filter(|joint| joint.has_link_encoder) {
        let of_joint = predictive_loop(joint);
        let quicker = may_follow_quicker(joint);
        let is_known = |(other, its, _): &&(JointLoop, bool, Design)| {
            *its == quicker && is_alike(&of_joint, other)
        };
        let design = match chosen.iter().find(is_known) {
            Some((_, _, design)) => *design,
            None => {
                let design = choose_design(&of_joint, &NEEDED, quicker);
                chosen.push((of_joint, quicker, design));
                design
            }
        };
        joint.law.design = design;
    }
}
