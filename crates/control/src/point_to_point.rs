//! Motions from point to point: all joints arrive at once, within limits of velocity, acceleration
//! and jerk, as early as these allow (K: L. Berscheid and T. Kröger, Jerk-limited Real-time
//! Trajectory Generation with Arbitrary Target States, RSS 2021), planned by the library rsruckig.

use rsruckig::error::{RuckigError, RuckigErrorHandler};
use rsruckig::prelude::{ControlInterface, InputParameter, Ruckig, RuckigResult, Trajectory};

/// Limits of one joint's motion; all above zero and finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionLimits {
    /// |dq|, rad/s.
    pub velocity: f64,
    /// |ddq|, rad/s².
    pub acceleration: f64,
    /// |dddq|, rad/s³.
    pub jerk: f64,
}

impl MotionLimits {
    /// The same with a lower velocity, rad/s; 0: the same.
    #[must_use]
    pub fn no_faster(self, velocity: f64) -> Self {
        let velocity = match velocity > 0.0 {
            true => velocity.min(self.velocity),
            false => self.velocity,
        };
        Self { velocity, ..self }
    }
}

/// A joint at one instant of its planned motion.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlannedMotion {
    /// q_d, rad.
    pub q: f64,
    /// dq_d, rad/s.
    pub dq: f64,
    /// ddq_d, rad/s².
    pub ddq: f64,
}

/// The library's own handlers allocate a message for each error.
#[derive(Debug, Clone)]
struct Silent;

impl RuckigErrorHandler for Silent {
    fn handle_validation_error(_: &str) -> Result<(), RuckigError> {
        Err(RuckigError::ValidationError(String::new()))
    }
    fn handle_calculator_error(_: &str) -> Result<(), RuckigError> {
        Err(RuckigError::CalculatorError(String::new()))
    }
}

/// Number of joints that the library takes when it runs, not when it is compiled.
const AT_RUN_TIME: usize = 0;

/// Plans and follows motions of all joints of a robot from where they are to a target at rest. A new
/// target may come at any time: the motion goes on from its present position, velocity and
/// acceleration.
#[derive(Debug)]
pub struct PointToPoint {
    planner: Ruckig<AT_RUN_TIME, Silent>,
    input: InputParameter<AT_RUN_TIME>,
    followed: Trajectory<AT_RUN_TIME>,
    /// Where it ends, rad.
    targets: Vec<f64>,
    planned: Trajectory<AT_RUN_TIME>,
    /// Time since the begin of the followed trajectory, s; none: the joints are to stay.
    time: Option<f64>,
    now: Vec<PlannedMotion>,
}

impl PointToPoint {
    /// For `joints` joints, which stay at zero.
    #[must_use]
    pub fn new(joints: usize) -> Self {
        let count = Some(joints);
        Self {
            planner: Ruckig::new(count, 0.0),
            input: InputParameter::new(count),
            followed: Trajectory::new(count),
            targets: vec![0.0; joints],
            planned: Trajectory::new(count),
            time: None,
            now: vec![PlannedMotion::default(); joints],
        }
    }

    /// The joints are here; the next motion begins with this, and there is none until a target comes.
    pub fn start(&mut self, joints: impl IntoIterator<Item = PlannedMotion>) {
        for (now, joint) in self.now.iter_mut().zip(joints) {
            *now = joint;
        }
        self.time = None;
    }

    /// Plans the motion from the present state to `target`, rad, a target and its limits for each
    /// joint. False where there is none, as with a target that is not finite: the motion before goes on.
    pub fn go_to(&mut self, target: impl IntoIterator<Item = (f64, MotionLimits)>) -> bool {
        self.plan(ControlInterface::Position, target)
    }

    /// Plans how every joint comes to rest, all at once, within its limits and wherever that is.
    /// False where there is no such motion: the motion before goes on.
    pub fn stop(&mut self, limits: impl IntoIterator<Item = MotionLimits>) -> bool {
        let anywhere = limits.into_iter().map(|limits| (0.0, limits));
        self.plan(ControlInterface::Velocity, anywhere)
    }

    fn plan(
        &mut self,
        interface: ControlInterface,
        target: impl IntoIterator<Item = (f64, MotionLimits)>,
    ) -> bool {
        let input = &mut self.input;
        for (j, (now, (target, limits))) in self.now.iter().zip(target).enumerate() {
            let numbers = [now.q, now.dq, now.ddq, target, limits.velocity];
            let rest = [limits.acceleration, limits.jerk];
            if !numbers.iter().chain(&rest).all(|x| x.is_finite()) {
                return false;
            }
            input.current_position[j] = now.q;
            input.current_velocity[j] = now.dq;
            input.current_acceleration[j] = now.ddq;
            input.target_position[j] = target;
            input.max_velocity[j] = limits.velocity;
            input.max_acceleration[j] = limits.acceleration;
            input.max_jerk[j] = limits.jerk;
        }
        input.control_interface = interface;
        let result = self.planner.calculate(&self.input, &mut self.planned);
        let found = matches!(result, Ok(RuckigResult::Working | RuckigResult::Finished))
            && self.planned.duration.is_finite();
        if found {
            std::mem::swap(&mut self.planned, &mut self.followed);
            match interface {
                ControlInterface::Position => {
                    for (j, target) in self.targets.iter_mut().enumerate() {
                        *target = self.input.target_position[j];
                    }
                }
                _ => {
                    let targets = &mut self.targets;
                    let end = self.followed.duration;
                    each_at(&self.followed, end, |joint, planned| {
                        if let Some(target) = targets.get_mut(joint) {
                            *target = planned.q;
                        }
                    });
                }
            }
            self.time = Some(0.0);
        }
        found
    }

    /// The joints `dt` later, s. After the end of the motion they stay at the target.
    pub fn advance(&mut self, dt: f64) -> &[PlannedMotion] {
        let Some(time) = &mut self.time else {
            return &self.now;
        };
        *time += dt;
        let now = &mut self.now;
        if *time >= self.followed.duration {
            // Without the rounding that is left of velocity and acceleration.
            for (now, &q) in now.iter_mut().zip(&self.targets) {
                *now = PlannedMotion {
                    q,
                    ..PlannedMotion::default()
                };
            }
            self.time = None;
            return &self.now;
        }
        each_at(&self.followed, *time, |joint, planned| {
            if let Some(now) = now.get_mut(joint) {
                *now = planned;
            }
        });
        &self.now
    }

    /// Time until the joints are at the target, s; zero where there is no motion.
    #[must_use]
    pub fn left_s(&self) -> f64 {
        (self.time).map_or(0.0, |time| (self.followed.duration - time).max(0.0))
    }
}

/// Every joint at a time since the trajectory's begin, s.
fn each_at(
    trajectory: &Trajectory<AT_RUN_TIME>,
    time: f64,
    mut take: impl FnMut(usize, PlannedMotion),
) {
    let mut section = 0;
    trajectory.state_to_integrate_from(time, &mut section, |joint, t, p, v, a, jerk| {
        let (q, dq, ddq) = rsruckig::util::integrate(t, p, v, a, jerk);
        take(joint, PlannedMotion { q, dq, ddq });
    });
}
