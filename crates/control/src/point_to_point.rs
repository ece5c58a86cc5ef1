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
    /// Copy of these limits with a lower velocity, rad/s; 0 leaves the velocity as it is.
    #[must_use]
    pub fn no_faster(self, velocity: f64) -> Self {
        let velocity = if velocity > 0.0 {
            velocity.min(self.velocity)
        } else {
            self.velocity
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

/// Joints that are planned in one cycle at most, where a motion is planned on the way: each costs up
/// to two microseconds.
const JOINTS_A_CYCLE: usize = 8;
/// Effort of planning a joint for a given duration, where that of planning it alone is one.
const SYNCHRONISING: usize = 5;
/// Rounds after which joints that have not found a common duration have none.
const ROUNDS: usize = 100;

/// Plans and follows motions of all joints of a robot from where they are to a target at rest. A new
/// target may come at any time: the motion goes on from its present position, velocity and
/// acceleration.
#[derive(Debug)]
pub struct PointToPoint {
    planner: Planner,
    followed: Vec<Trajectory<1>>,
    /// T of the followed motion, s.
    duration: f64,
    /// Position of each joint at the motion's end, rad.
    targets: Vec<f64>,
    plan: Plan,
    /// The plan is being made on the way.
    pending: Option<Pending>,
    /// Time since the begin of the followed motion, s; none: the joints are to stay.
    time: Option<f64>,
    now: Vec<PlannedMotion>,
}

/// A motion that begins when the calls of `advance` which are left have been made.
#[derive(Debug, Clone, Copy)]
struct Pending {
    calls_left: usize,
    /// Time between calls, s.
    period: f64,
}

impl PointToPoint {
    /// Motions of `joints` joints, which stay at zero.
    #[must_use]
    pub fn new(joints: usize) -> Self {
        Self {
            planner: Planner::new(),
            followed: vec![Trajectory::new(None); joints],
            duration: 0.0,
            targets: vec![0.0; joints],
            plan: Plan::new(joints),
            pending: None,
            time: None,
            now: vec![PlannedMotion::default(); joints],
        }
    }

    /// The joints are here; the next motion begins with this, and there is none until a target comes.
    pub fn start(&mut self, joints: impl IntoIterator<Item = PlannedMotion>) {
        for (now, joint) in self.now.iter_mut().zip(joints) {
            *now = joint;
        }
        (self.time, self.pending) = (None, None);
    }

    /// Plans the motion from the present state to `target`, rad, a target and its limits for each
    /// joint. False where there is none, as with a target that is not finite: the motion before goes on.
    pub fn go_to(&mut self, target: impl IntoIterator<Item = (f64, MotionLimits)>) -> bool {
        self.plan_at_once(ControlInterface::Position, target)
    }

    /// Plans a motion on the way where there are many joints: the motion before goes on for the
    /// next few calls of [`Self::advance`], each of which plans [`JOINTS_A_CYCLE`] joints, and then
    /// leads to this target, as the earliest motion from there. `period`: time between these calls, s.
    pub fn go_on_to(
        &mut self,
        target: impl IntoIterator<Item = (f64, MotionLimits)>,
        period: f64,
    ) -> bool {
        let calls = self.now.len().div_ceil(JOINTS_A_CYCLE);
        if calls <= 1 {
            return self.go_to(target);
        }
        let later = period * (calls - 1) as f64;
        if !self.begin_plan(later, ControlInterface::Position, target) {
            return false;
        }
        self.pending = Some(Pending {
            calls_left: calls,
            period,
        });
        true
    }

    /// A motion is being planned on the way.
    #[must_use]
    pub fn is_planning(&self) -> bool {
        self.pending.is_some()
    }

    /// Plans how every joint comes to rest, all at once, within its limits and wherever that is.
    /// False where there is no such motion: the motion before goes on.
    pub fn stop(&mut self, limits: impl IntoIterator<Item = MotionLimits>) -> bool {
        let anywhere = limits.into_iter().map(|limits| (0.0, limits));
        self.plan_at_once(ControlInterface::Velocity, anywhere)
    }

    fn plan_at_once(
        &mut self,
        interface: ControlInterface,
        target: impl IntoIterator<Item = (f64, MotionLimits)>,
    ) -> bool {
        self.begin_plan(0.0, interface, target) && self.finish_plan()
    }

    /// Begins the plan of a motion from the state `later`, s, in place of one that is being planned.
    /// False where a number is none.
    fn begin_plan(
        &mut self,
        later: f64,
        interface: ControlInterface,
        target: impl IntoIterator<Item = (f64, MotionLimits)>,
    ) -> bool {
        self.pending = None;
        let begin = self.now.iter().zip(&self.followed).zip(&self.targets);
        let begin = begin.map(|((now, followed), target)| match self.time {
            Some(time) if later > 0.0 => state_at(followed, *target, self.duration, time + later),
            _ => *now,
        });
        let ways = begin.zip(target);
        let ways = ways.map(|(from, (to, limits))| Way { from, to, limits });
        self.plan.begin(interface, ways)
    }

    /// Makes the rest of the plan and follows it; false where there is no such motion.
    fn finish_plan(&mut self) -> bool {
        let found = self.plan.go_on(&mut self.planner, usize::MAX) == Progress::Found;
        if found {
            std::mem::swap(&mut self.plan.trajectories, &mut self.followed);
            self.duration = self.plan.duration;
            let ends = self.targets.iter_mut().zip(&self.followed);
            for ((target, followed), way) in ends.zip(&self.plan.ways) {
                *target = match self.plan.interface {
                    ControlInterface::Position => way.to,
                    _ => at(followed, self.duration).q,
                };
            }
            self.time = Some(0.0);
        }
        found
    }

    /// The joints `dt` later, s. After the end of the motion they stay at the target.
    pub fn advance(&mut self, dt: f64) -> &[PlannedMotion] {
        if let Some(pending) = &mut self.pending {
            pending.calls_left = pending.calls_left.saturating_sub(1);
            let effort = JOINTS_A_CYCLE * (1 + SYNCHRONISING);
            self.plan.go_on(&mut self.planner, effort);
            if pending.calls_left == 0 {
                self.pending = None;
                // Durations that a joint cannot take are rare; the rounds that they cost are made now.
                self.finish_plan();
            }
        }
        let Some(time) = &mut self.time else {
            return &self.now;
        };
        *time += dt;
        let joints = self.now.iter_mut().zip(&self.followed).zip(&self.targets);
        for ((now, followed), target) in joints {
            *now = state_at(followed, *target, self.duration, *time);
        }
        if *time >= self.duration {
            self.time = None;
        }
        &self.now
    }

    /// Time until the joints are at the target, s; zero where there is no motion.
    #[must_use]
    pub fn left_s(&self) -> f64 {
        let left = (self.time).map_or(0.0, |time| (self.duration - time).max(0.0));
        let pending = self.pending.map_or(0.0, |pending| {
            pending.period * pending.calls_left as f64 + self.plan.duration
        });
        left.max(pending)
    }
}

/// A joint's way: the state in which it begins, its target, rad or rad/s, and its limits.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Way {
    pub(crate) from: PlannedMotion,
    pub(crate) to: f64,
    pub(crate) limits: MotionLimits,
}

impl Way {
    fn is_finite(&self) -> bool {
        let Self { from, to, limits } = self;
        let numbers = [from.q, from.dq, from.ddq, *to, limits.velocity];
        let rest = [limits.acceleration, limits.jerk];
        numbers.iter().chain(&rest).all(|x| x.is_finite())
    }
}

/// State of a plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Progress {
    /// There are joints to be planned.
    Going,
    /// All joints take the same time.
    Found,
    /// There is no such motion.
    None,
}

/// A motion that is being planned, joint by joint: first each one alone, as fast as it can be; then
/// all others for the duration of the slowest. A joint in motion may not be able to take just that
/// time: it takes the next longer one that it can, and then all others that one. The duration is so the
/// least that all can take (K).
#[derive(Debug)]
struct Plan {
    interface: ControlInterface,
    ways: Vec<Way>,
    trajectories: Vec<Trajectory<1>>,
    /// Joints of `ways` and the round among them that is next.
    joint: usize,
    round: usize,
    /// T of this round, s; zero in the first one.
    duration: f64,
    /// Longest duration of a joint in this round, s.
    longest: f64,
    progress: Progress,
}

impl Plan {
    fn new(joints: usize) -> Self {
        Self {
            interface: ControlInterface::Position,
            ways: Vec::with_capacity(joints),
            trajectories: vec![Trajectory::new(None); joints],
            joint: 0,
            round: 0,
            duration: 0.0,
            longest: 0.0,
            progress: Progress::None,
        }
    }

    /// Begins anew; false where a number is none, or a joint has no target.
    fn begin(&mut self, interface: ControlInterface, ways: impl Iterator<Item = Way>) -> bool {
        self.interface = interface;
        self.ways.clear();
        // No more than there is memory for.
        self.ways.extend(ways.take(self.trajectories.len()));
        (self.joint, self.round) = (0, 0);
        (self.duration, self.longest) = (0.0, 0.0);
        let complete = self.ways.len() == self.trajectories.len();
        let possible = complete && self.ways.iter().all(Way::is_finite);
        self.progress = if possible {
            Progress::Going
        } else {
            Progress::None
        };
        possible
    }

    /// Goes on with so much effort at most; planning one joint alone is one.
    fn go_on(&mut self, planner: &mut Planner, mut effort: usize) -> Progress {
        while self.progress == Progress::Going {
            let joint = self.ways.get(self.joint);
            let Some((way, trajectory)) = joint.zip(self.trajectories.get_mut(self.joint)) else {
                self.end_round();
                continue;
            };
            let alone = self.round == 0;
            if alone || trajectory.duration < self.duration {
                let needed = if alone { 1 } else { SYNCHRONISING };
                if needed > effort {
                    break;
                }
                effort -= needed;
                let least = (!alone).then_some(self.duration);
                if !planner.plan(self.interface, way, least, trajectory) {
                    self.progress = Progress::None;
                    break;
                }
            }
            self.longest = self.longest.max(trajectory.duration);
            self.joint += 1;
        }
        self.progress
    }

    fn end_round(&mut self) {
        let first = self.round == 0;
        (self.joint, self.round) = (0, self.round + 1);
        if !first && self.longest <= self.duration {
            self.progress = Progress::Found;
        } else if self.round > ROUNDS {
            self.progress = Progress::None;
        }
        self.duration = self.longest;
    }
}

#[derive(Debug)]
pub(crate) struct Planner {
    library: Ruckig<1, Silent>,
    input: InputParameter<1>,
    /// Memory for a motion that is planned anew in each cycle.
    once: Trajectory<1>,
}

impl Planner {
    pub(crate) fn new() -> Self {
        Self {
            library: Ruckig::new(None, 0.0),
            input: InputParameter::new(None),
            once: Trajectory::new(None),
        }
    }

    /// The earliest motion; none where there is none.
    pub(crate) fn plan_once(
        &mut self,
        interface: ControlInterface,
        way: &Way,
    ) -> Option<&Trajectory<1>> {
        let (library, input, once) = (&mut self.library, &mut self.input, &mut self.once);
        let found = way.is_finite() && calculate(library, input, (interface, way), None, once);
        found.then_some(&*once)
    }

    /// The earliest motion that takes at least so long, s; false where there is none.
    fn plan(
        &mut self,
        interface: ControlInterface,
        way: &Way,
        least_duration: Option<f64>,
        trajectory: &mut Trajectory<1>,
    ) -> bool {
        let (library, input) = (&mut self.library, &mut self.input);
        calculate(library, input, (interface, way), least_duration, trajectory)
    }
}

/// Plans the earliest motion that takes at least so long, s; false where there is none.
fn calculate(
    library: &mut Ruckig<1, Silent>,
    input: &mut InputParameter<1>,
    (interface, way): (ControlInterface, &Way),
    least_duration: Option<f64>,
    trajectory: &mut Trajectory<1>,
) -> bool {
    match interface {
        ControlInterface::Velocity => input.target_velocity[0] = way.to,
        _ => (input.target_position[0], input.target_velocity[0]) = (way.to, 0.0),
    }
    input.control_interface = interface;
    input.current_position[0] = way.from.q;
    input.current_velocity[0] = way.from.dq;
    input.current_acceleration[0] = way.from.ddq;
    input.max_velocity[0] = way.limits.velocity;
    input.max_acceleration[0] = way.limits.acceleration;
    input.max_jerk[0] = way.limits.jerk;
    input.minimum_duration = least_duration;
    let result = library.calculate(input, trajectory);
    matches!(result, Ok(RuckigResult::Working | RuckigResult::Finished))
        && trajectory.duration.is_finite()
}

/// A joint at a time since its motion's begin, s; from its end on at its target, without the rounding
/// that is left of velocity and acceleration.
fn state_at(trajectory: &Trajectory<1>, target: f64, duration: f64, time: f64) -> PlannedMotion {
    if time >= duration {
        PlannedMotion {
            q: target,
            ..PlannedMotion::default()
        }
    } else {
        at(trajectory, time)
    }
}

/// A joint at a time since its motion's begin, s.
pub(crate) fn at(trajectory: &Trajectory<1>, time: f64) -> PlannedMotion {
    let (mut section, mut state) = (0, PlannedMotion::default());
    trajectory.state_to_integrate_from(time, &mut section, |_, t, p, v, a, jerk| {
        let (q, dq, ddq) = rsruckig::util::integrate(t, p, v, a, jerk);
        state = PlannedMotion { q, dq, ddq };
    });
    state
}
