//! The predictive law's design for each joint, chosen by its margins.

use crate::parameters::{JointParameters, Parameters, TorqueLaw};
use control::margins::{JointLoop, NEEDED, choose_design};
use control::predictive::Design;

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

/// Chooses the design of every joint that follows the predictive law; joints that are alike share one.
pub(crate) fn choose_designs(parameters: &mut Parameters) {
    if !matches!(parameters.torque_law, TorqueLaw::Predictive(_)) {
        return;
    }
    let mut chosen: Vec<(JointLoop, Design)> = Vec::new();
    for joint in (parameters.joints.iter_mut()).filter(|joint| joint.has_link_encoder) {
        let of_joint = predictive_loop(joint);
        let known = chosen.iter().find(|(other, _)| is_alike(&of_joint, other));
        let design = match known {
            Some((_, design)) => *design,
            None => {
                let design = choose_design(&of_joint, &NEEDED);
                chosen.push((of_joint, design));
                design
            }
        };
        joint.law.design = design;
    }
}
