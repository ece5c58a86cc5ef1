//! Excitation: planned motions that show a robot's constants, and what must hold before it may follow them.
//!
//! In: a robot's configuration, a plan, where its joints are. Out: the motion, point by point, and what it needs of
//! position, velocity, acceleration, torque, lead and distance to itself; or every reason for which the robot must not
//! follow it.

mod checks;
mod hulls;
mod jet;
mod motion;
mod multisine;
mod plan;
mod rigid;

use problem::Problems;
use robot_config::Robot;

pub use checks::{Need, Needs};
pub use hulls::Distance;
pub use motion::{Motion, SPACING_S, Span};
pub use multisine::Choice;
pub use plan::{Angles, Constant, Kind, Part, PlanFile, SelfDistance};

use hulls::Hulls;
use rigid::Rigid;

/// A plan that the robot may follow.
#[derive(Debug)]
pub struct Prepared {
    /// The robot's configuration.
    pub robot: Robot,
    /// Where the motion begins, rad or m, in config order.
    pub pose: Vec<f64>,
    /// The motion.
    pub motion: Motion,
    /// Its needs.
    pub needs: Needs,
}

impl Prepared {
    /// Each `step`-th point of the motion: its time, s, its place in the motion, and the torques that the gears carry
    /// there, N·m or N, in config order, the base held where it is.
    pub fn each_torque(&self, step: usize, mut take: impl FnMut(f64, usize, &[f64])) {
        let mut rigid = Rigid::new(&self.robot);
        for index in (0..self.motion.len()).step_by(step.max(1)) {
            rigid.set(self.motion.point(index));
            take(index as f64 * SPACING_S, index, rigid.torques());
        }
    }
}

/// Whether and how the robot's distance to itself is checked.
#[derive(Debug, Clone, Copy)]
pub enum SelfCheck<'a> {
    /// By the collision geometry of the robot's URDF, or radii that the plan gives.
    Done {
        /// The URDF's text.
        urdf: &'a str,
        /// Radii and least distance that the plan gives; none: those of the URDF's geometry.
        given: Option<&'a SelfDistance>,
    },
    /// Not at all.
    LeftOut,
}

/// Plans parts about `pose` (rad or m, config order) and checks them, with the way from `here` to it.
///
/// # Errors
/// Every reason for which the robot must not follow the plan.
pub fn prepare(
    robot: Robot,
    parts: &[Part],
    here: &[f64],
    pose: Vec<f64>,
    self_check: SelfCheck<'_>,
    progress: &mut dyn FnMut(&str),
) -> Result<Prepared, Problems> {
    let motion = motion::plan(&robot, parts, &pose, progress)?;
    progress("checking");
    let hulls = match self_check {
        SelfCheck::LeftOut => None,
        SelfCheck::Done { urdf, given } => Some(Hulls::new(&robot, urdf, given)?),
    };
    let approach = motion::approach(&robot, here, &pose)?;
    checks::check(&robot, &approach, hulls.as_ref())?;
    let needs = checks::check(&robot, &motion, hulls.as_ref())?;
    Ok(Prepared {
        robot,
        pose,
        motion,
        needs,
    })
}

/// Where the joints of a robot that is not asked are taken to be, rad or m: where `from` says, or the pose of the
/// motion, or 0, or the nearest limit.
#[must_use]
pub fn supposed(robot: &Robot, from: &[Option<f64>], pose: &[Option<f64>]) -> Vec<f64> {
    let joints = robot.parameters.joints.iter().zip(from.iter().zip(pose));
    let place = joints.map(|(joint, (from, pose))| {
        let limits = &joint.limits;
        let nearest = 0.0f64.clamp(limits.position_min, limits.position_max);
        from.or(*pose).unwrap_or(nearest)
    });
    place.collect()
}
