//! Learned feed-forward torques of mode low-gain tracking (G V-B): their inputs, and their files.
//!
//! The inputs are the motions of the joint and of its neighbours in the limb: a payload's weight and
//! coupling reach a joint mostly through these, and nine inputs are what a local Gaussian process has room for.

use crate::JointParameters;
use dynamics::Model;
use estimators::features::MAX_FEATURES;

/// Position, velocity and acceleration of a joint: rad, rad/s, rad/s².
pub type JointMotion = [f64; 3];

/// The joint before and the one after a joint in its limb, in config order; none at an end, and none after a
/// joint at which the robot branches.
#[must_use]
pub fn neighbours(model: &Model, joints: &[JointParameters], joint: usize) -> [Option<usize>; 2] {
    let place = |model_index: usize| joints.iter().position(|j| j.model_index == model_index);
    let own = joints.get(joint).map(|joint| joint.model_index);
    let bodies = || 1..model.bodies().len();
    let Some(body) = bodies().find(|&b| model.bodies().get(b).map(|b| b.joint) == own) else {
        return [None; 2];
    };
    let moved = |b: usize| model.bodies().get(b).and_then(|body| place(body.joint));
    let before = model.parent(body).filter(|&b| b != 0).and_then(moved);
    let mut children = bodies().filter(|&b| model.parent(b) == Some(body));
    let after = match (children.next(), children.next()) {
        (Some(child), None) => moved(child),
        _ => None,
    };
    [before, after].map(|found| found.filter(|&found| found != joint))
}

/// Inputs of a joint's feed-forward; `motion` of each joint.
#[must_use]
pub fn motion_inputs(
    joint: usize,
    neighbours: [Option<usize>; 2],
    motion: impl Fn(usize) -> JointMotion,
) -> [f64; MAX_FEATURES] {
    let mut inputs = [0.0; MAX_FEATURES];
    let [before, after] = neighbours;
    let places = inputs.chunks_exact_mut(3);
    for (inputs, joint) in places.zip([Some(joint), before, after]) {
        if let Some(joint) = joint {
            inputs.copy_from_slice(&motion(joint));
        }
    }
    inputs
}
