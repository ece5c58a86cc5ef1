//! The loops by which a robot's joints are controlled, and the margins below which none is run.

pub use crate::joints::refused_holds;
use crate::joints::{motor_side_loop, predictive_loop};
use crate::parameters::{JointParameters, Parameters, TorqueLaw};
use crate::{Problem, Robot};
use control::margins::{JointLoop, Load, Margins, MotorSideLoop, NEEDED};
use control::margins::{largest_stiffness, least_margins};
use robot_state::JointKind;

/// One joint's torque loop.
#[derive(Debug, Clone)]
pub struct TorqueLoop {
    /// The joint's name.
    pub name: String,
    /// The robot follows this law, so that too little margin is refused.
    pub bound: bool,
    /// The joint turns or slides.
    pub joint_kind: JointKind,
    /// Its drive takes currents.
    pub takes_current: bool,
    /// The law, with K_s and K_d.
    pub law: LoopLaw,
}

/// The law of a joint's torque loop.
#[derive(Debug, Clone)]
pub enum LoopLaw {
    /// The predictive law.
    Predictive(JointLoop),
    /// The feedback of a late torque, of a joint without a link-side encoder.
    Late(MotorSideLoop),
}

/// Least margins over several loads, and the loads at which phase and gain are least.
pub type LeastMargins = (Margins, [Load; 2]);

/// Margins of one joint's loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopMargins {
    /// Of the torque's loop alone, over [`Load::ALL`].
    pub torque: LeastMargins,
    /// With the configured stiffness and damping in space, over [`Load::MOVING`].
    pub space: LeastMargins,
}

/// The loop of every joint, in config order.
#[must_use]
pub fn torque_loops(robot: &Robot) -> Vec<TorqueLoop> {
    let joints = robot.parameters.joints.iter();
    joints
        .map(|joint| torque_loop(joint, &robot.parameters))
        .collect()
}

fn torque_loop(joint: &JointParameters, parameters: &Parameters) -> TorqueLoop {
    let predictive = matches!(parameters.torque_law, TorqueLaw::Predictive(_));
    let late = motor_side_loop(joint, parameters);
    TorqueLoop {
        name: joint.name.clone(),
        bound: predictive || late.is_some(),
        joint_kind: joint.kind,
        takes_current: !joint.takes_position(),
        law: match late {
            Some(late) => LoopLaw::Late(late),
            None => LoopLaw::Predictive(predictive_loop(joint)),
        },
    }
}

/// What is refused of a robot's loops: a problem for each joint with less margin than 30 degrees or 6 dB in the law
/// that it follows, or in the hold of a drive that takes currents; `file`: the configuration.
#[must_use]
pub fn refused_loops(robot: &Robot, file: &str) -> Vec<Problem> {
    let loops = torque_loops(robot);
    let bound = loops.iter().filter(|of_joint| of_joint.bound);
    let of_torque = bound.flat_map(|of_joint| of_joint.refusals(&of_joint.margins(), file));
    of_torque.chain(refused_holds(robot, file)).collect()
}

/// A predictive loop without stiffness and damping in space.
#[must_use]
pub fn without_space(space: &JointLoop) -> JointLoop {
    JointLoop {
        stiffness: 0.0,
        damping: 0.0,
        ..*space
    }
}

/// K_d over K_s, s, for the largest stiffness that a loop bears; a hundredth where there is no K_s.
#[must_use]
pub fn damping_ratio(k_s: f64, k_d: f64) -> f64 {
    if k_s > 0.0 { k_d / k_s } else { 0.01 }
}

impl TorqueLoop {
    /// Least margins of the loop.
    #[must_use]
    pub fn margins(&self) -> LoopMargins {
        match &self.law {
            LoopLaw::Predictive(space) => LoopMargins {
                torque: least_margins(&without_space(space), &Load::ALL),
                space: least_margins(space, &Load::MOVING),
            },
            LoopLaw::Late(space) => LoopMargins {
                torque: space.of_torque().least_margins(&Load::ALL),
                space: space.least_margins(&Load::MOVING),
            },
        }
    }

    /// Largest K_s that the loop bears with the configured K_d over K_s, N·m/rad.
    #[must_use]
    pub fn largest_stiffness(&self) -> f64 {
        match &self.law {
            LoopLaw::Predictive(space) => {
                let ratio = damping_ratio(space.stiffness, space.damping);
                largest_stiffness(&without_space(space), ratio, NEEDED)
            }
            LoopLaw::Late(space) => {
                let ratio = damping_ratio(space.gains.k_s, space.gains.k_d);
                space.of_torque().largest_stiffness(ratio, NEEDED)
            }
        }
    }

    /// A problem for each of the two loops that keeps less than 30 degrees or 6 dB; `file`: the configuration.
    #[must_use]
    pub fn refusals(&self, margins: &LoopMargins, file: &str) -> Vec<Problem> {
        let judged = [
            ("torque loop", &margins.torque),
            ("K_s and K_d", &margins.space),
        ];
        let too_little = judged
            .into_iter()
            .filter(|(_, (margins, _))| !margins.keeps(&NEEDED));
        too_little
            .map(|(what, least)| self.refusal(what, least).at(file, 0))
            .collect()
    }

    fn refusal(&self, what: &str, (margins, at): &LeastMargins) -> Problem {
        let (degrees, db) = margins.in_degrees_and_db();
        let reason = format!(
            "joint {}: {what}: margins of {degrees:.0} degrees (link {}) and {db:.1} dB (link {})",
            self.name,
            at[0].name(),
            at[1].name(),
        );
        let mut ways = Vec::new();
        match &self.law {
            LoopLaw::Late(space) if space.gains.k_i > 0.0 => {
                let k_i = space.gains.k_i;
                ways.push(format!("K_i_per_s below {k_i:.1} or none given"));
            }
            // Around a current nothing else damps the torque: a cycle of delay is too much.
            LoopLaw::Predictive(_) if self.takes_current => {
                ways.push("[control] law = \"proportional_integral\"".to_owned());
            }
            LoopLaw::Late(_) | LoopLaw::Predictive(_) => {}
        }
        ways.push("less delay".to_owned());
        let stiffness = self.largest_stiffness();
        if stiffness >= 1.0 {
            let unit = self.joint_kind.units("N·m/rad");
            ways.push(format!("K_s up to {stiffness:.0} {unit}"));
        }
        let allowed = format!("at least 30 degrees and 6 dB: {}", ways.join(", or "));
        Problem::new(reason, allowed)
    }
}
