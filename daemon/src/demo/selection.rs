//! The joints that the demo draws.

use dynamics::Model;
use problem::Problem;
use robot_config::Robot;

/// Joints in the picture if none are named.
const PANELS: usize = 6;

/// Joints to draw, of `--joints`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Selection {
    /// The most loaded joints of different limbs.
    MostLoaded,
    /// The named joints, by their places in config order.
    Named(Vec<usize>),
}

impl Selection {
    /// The joints that `--joints` names.
    ///
    /// # Errors
    /// A name that no joint has.
    pub(super) fn new(names: &[String], robot: &Robot) -> Result<Self, Problem> {
        let joints = &robot.parameters.joints;
        if names.is_empty() {
            return Ok(Self::MostLoaded);
        }
        if names == ["all"] {
            return Ok(Self::Named((0..joints.len()).collect()));
        }
        let place = |name: &String| {
            let place = joints.iter().position(|joint| joint.name == *name);
            place.ok_or_else(|| {
                let known: Vec<&str> = joints.iter().map(|joint| joint.name.as_str()).collect();
                let allowed = format!("all, or some of {}", known.join(", "));
                Problem::new(format!("--joints: there is no joint {name:?}"), allowed)
            })
        };
        Ok(Self::Named(
            names.iter().map(place).collect::<Result<_, _>>()?,
        ))
    }

    /// The joints, by their places in config order, given each one's largest torque.
    pub(super) fn joints(&self, robot: &Robot, largest_torque: &[f64]) -> Vec<usize> {
        match self {
            Self::Named(joints) => joints.clone(),
            Self::MostLoaded => {
                let joints = robot.parameters.joints.iter();
                let limbs: Vec<usize> = joints
                    .map(|joint| limb(&robot.model, joint.model_index))
                    .collect();
                most_loaded(&limbs, largest_torque)
            }
        }
    }
}

/// The body with which the limb of a joint begins: the first one after a body that carries several.
fn limb(model: &Model, joint: usize) -> usize {
    let carries_one = |body: usize| {
        let carried = (0..model.bodies().len()).filter(|&b| model.parent(b) == Some(body));
        carried.count() == 1
    };
    let bodies = model.bodies().iter().enumerate().skip(1);
    let mut body = bodies.filter(|(_, b)| b.joint == joint).map(|(i, _)| i);
    let mut at = body.next().unwrap_or(0);
    while let Some(parent) = model.parent(at).filter(|&parent| carries_one(parent)) {
        at = parent;
    }
    at
}

/// The most loaded joint of each limb, then the second of each, and so on; in config order.
fn most_loaded(limbs: &[usize], largest_torque: &[f64]) -> Vec<usize> {
    // Of equally loaded joints the first.
    let more_loaded = |&other: &usize, j: usize| {
        let load = largest_torque[other].total_cmp(&largest_torque[j]);
        limbs[other] == limbs[j] && load.then(j.cmp(&other)).is_gt()
    };
    let all = 0..limbs.len();
    let mut joints: Vec<(usize, usize)> = (all.clone())
        .map(|j| (all.clone().filter(|other| more_loaded(other, j)).count(), j))
        .collect();
    joints.sort_by(|(a_rank, a), (b_rank, b)| {
        let load = largest_torque[*b].total_cmp(&largest_torque[*a]);
        a_rank.cmp(b_rank).then(load)
    });
    let mut chosen: Vec<usize> = joints.into_iter().map(|(_, j)| j).take(PANELS).collect();
    chosen.sort_unstable();
    chosen
}

#[cfg(test)]
mod tests {
    use super::{Selection, most_loaded};
    use crate::demo::robots;

    #[test]
    fn each_limb_comes_before_the_second_joint_of_another() {
        let limbs = [1, 1, 1, 1, 2, 2, 3];
        let torques = [9.0, 8.0, 7.0, 6.0, 1.0, 2.0, 0.5];
        assert_eq!(most_loaded(&limbs, &torques), [0, 1, 2, 4, 5, 6]);
        assert_eq!(most_loaded(&[4], &[0.0]), [0]);
    }

    #[test]
    fn a_humanoid_shows_legs_and_arms() {
        let robot = robot_config::load("config/humanoid/robot.toml", &robots::read).unwrap();
        let joints = &robot.parameters.joints;
        let all = vec![1.0; joints.len()];
        let chosen = Selection::MostLoaded.joints(&robot, &all);
        for part in ["left_hip", "right_hip", "left_shoulder", "right_shoulder"] {
            let shown = |&j: &usize| joints[j].name.starts_with(part);
            assert!(chosen.iter().any(shown), "{part}");
        }
        let named = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
            Selection::new(&names, &robot)
        };
        assert_eq!(named(&[]), Ok(Selection::MostLoaded));
        assert_eq!(named(&[&joints[3].name]), Ok(Selection::Named(vec![3])));
        let problem = named(&["knee"]).unwrap_err();
        assert!(problem.allowed.contains("left_knee"), "{problem}");
    }
}
