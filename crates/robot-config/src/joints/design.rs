//! The predictive law's design for each joint, chosen by its margins.

use crate::parameters::{JointParameters, Parameters, TorqueLaw};
use control::margins::{JointLoop, NEEDED, choose_design};
use control::predictive::Design;
use robot_state::JointKind;

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

/// Most help for a hand that a joint may have. Slides have the default's: both encoders of the simulated lift that drift
/// as one bring it to 9.6 % of its velocity limit with that, to 18 % with 1.4 times as much, where 10 % are allowed.
fn most_help(joint: &JointParameters) -> f64 {
    match joint.kind {
        JointKind::Prismatic => Design::default().assist,
        JointKind::Revolute => f64::INFINITY,
    }
}

/// Chooses the design of every joint that follows the predictive law; joints that are alike share one.
pub(crate) fn choose_designs(parameters: &mut Parameters) {
    if !matches!(parameters.torque_law, TorqueLaw::Predictive(_)) {
        return;
    }
    let mut chosen: Vec<(JointLoop, f64, Design)> = Vec::new();
    for joint in (parameters.joints.iter_mut()).filter(|joint| joint.has_link_encoder) {
        let of_joint = predictive_loop(joint);
        let most_help = most_help(joint);
        let known = chosen
            .iter()
            .find(|(other, most, _)| *most == most_help && is_alike(&of_joint, other));
        let design = match known {
            Some((_, _, design)) => *design,
            None => {
                let design = choose_design(&of_joint, &NEEDED, most_help);
                chosen.push((of_joint, most_help, design));
                design
            }
        };
        joint.law.design = design;
    }
}
