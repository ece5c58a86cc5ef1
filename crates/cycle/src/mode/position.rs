//! Position: the joints go to `q_d` on a trajectory that the loop plans, by inverse dynamics.

use control::{MotionLimits, PlannedMotion, PointToPoint};
use robot_config::{Parameters, Robot};
use robot_state::{CommandedRecord, JointMeasured, MeasuredRecord, Mode, Reference};

use super::{Asked, Bounds, ClientMode, Made, ModeCycle, Unfit};
use crate::inputs::Seen;

/// Plans motions of the robot to a target.
#[derive(Debug)]
pub(super) struct Motions {
    motion: PointToPoint,
    limits: Vec<MotionLimits>,
    /// A motion is followed.
    on: bool,
    /// Target and speed that each joint was sent to last.
    targets: Vec<(f64, f64)>,
    /// The targets are newer than those of the motion that is followed or being planned.
    newer: bool,
}

impl Motions {
    pub(super) fn new(parameters: &Parameters) -> Self {
        let joints = &parameters.joints;
        Self {
            motion: PointToPoint::new(joints.len()),
            limits: parameters.motion_limits().collect(),
            on: false,
            targets: vec![(0.0, 0.0); joints.len()],
            newer: false,
        }
    }

    /// The reference of this cycle on the way to the targets of `asked`. A motion begins where the joints are, and a
    /// new target leads it off its present way. `anew`: it begins there whatever was followed before, and at rest,
    /// so that the joints are braked.
    pub(super) fn follow(
        &mut self,
        asked: &Reference,
        anew: bool,
        measured: &MeasuredRecord,
        dt: f64,
    ) -> Reference {
        let begins = anew || !self.on;
        self.on = true;
        let mut reference = *asked;
        if begins {
            let joints = measured.joints.iter().zip(&self.limits);
            let begin = joints.map(|(joint, limits)| PlannedMotion {
                dq: if anew { 0.0 } else { here(joint, limits).dq },
                ..here(joint, limits)
            });
            (self.motion).start(begin);
        }
        self.newer |= self.take_targets(&reference);
        let ways = self.targets.iter().zip(&self.limits);
        let ways = ways.map(|((q, speed), limits)| (*q, limits.no_faster(*speed)));
        // A target that passed the checks always has a motion; without one the joints stay.
        if begins {
            self.motion.go_to(ways);
            self.newer = false;
        } else if self.newer && !self.motion.is_planning() {
            // Targets that come meanwhile wait: the plans of many joints together would make a cycle
            // long.
            self.motion.go_on_to(ways, dt);
            self.newer = false;
        }
        for (joint, planned) in reference.joints.iter_mut().zip(self.motion.advance(dt)) {
            (joint.q_d, joint.dq_d, joint.ddq_d) = (planned.q, planned.dq, planned.ddq);
        }
        reference.contact_wrench_given = 0;
        reference
    }

    /// Notes that no target is followed in this cycle.
    pub(super) fn end(&mut self) {
        self.on = false;
    }

    /// True if they are others than those before.
    fn take_targets(&mut self, reference: &Reference) -> bool {
        let mut others = false;
        for (target, asked) in self.targets.iter_mut().zip(&reference.joints) {
            let new = (asked.q_d, asked.dq_d);
            others |= std::mem::replace(target, new) != new;
        }
        others
    }

    /// Time until the robot is at the target, s; 0 without one.
    pub(super) fn left_s(&self) -> f64 {
        if self.on { self.motion.left_s() } else { 0.0 }
    }
}

/// Where a motion begins.
fn here(joint: &JointMeasured, limits: &MotionLimits) -> PlannedMotion {
    PlannedMotion {
        q: joint.q,
        dq: joint.dq.clamp(-limits.velocity, limits.velocity),
        ddq: 0.0,
    }
}

#[derive(Debug)]
struct Position {
    motions: Motions,
}

pub(super) fn make(robot: &Robot) -> Made {
    Ok(Some(Box::new(Position {
        motions: Motions::new(&robot.parameters),
    })))
}

impl ClientMode for Position {
    fn accepts(&self, bounds: &Bounds, reference: &Reference) -> bool {
        bounds.softened(reference) && bounds.targets(reference)
    }

    fn paces(&self, _: &Reference, _: usize) -> bool {
        false
    }

    fn set_tasks(&mut self, mut cycle: ModeCycle<'_>) -> Result<(), Unfit> {
        let (asked, seen) = (cycle.asked.reference, cycle.seen);
        let planned = (self.motions).follow(asked, false, seen.measured, seen.dt);
        cycle.body.follow(&planned, seen);
        // The torque is that mode's: joints do not begin anew where a client goes over from one to the other.
        let mode = Mode::InverseDynamics;
        cycle.track(mode, &Asked::planned(&planned), |_, follow| follow);
        Ok(())
    }

    fn idle(&mut self, _: &Seen<'_>, _: &mut CommandedRecord) {
        self.motions.end();
    }

    fn motion_left_s(&self) -> f64 {
        self.motions.left_s()
    }
}
