//! Motion: from the target of mode position to the reference that inverse dynamics follows.

use control::{MotionLimits, PlannedMotion, PointToPoint};
use robot_config::Parameters;
use robot_state::{JointMeasured, MeasuredRecord, Reference};

use super::reference::Goal;

/// Plans the robot's motions.
#[derive(Debug)]
pub(super) struct Motions {
    motion: PointToPoint,
    limits: Vec<MotionLimits>,
    /// Mode position is followed.
    on: bool,
    /// Target and speed that each joint was sent to last.
    targets: Vec<(f64, f64)>,
    /// They are newer than those of the motion that is followed or being planned.
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

    /// The reference of this cycle on the way to the goal's targets; none in other modes. A motion
    /// begins where the joints are, and a new target leads it off its present way. `anew`: it begins
    /// there whatever was followed before, and at rest, so that the joints are braked.
    pub(super) fn follow(
        &mut self,
        goal: &Goal<'_>,
        anew: bool,
        measured: &MeasuredRecord,
        dt: f64,
    ) -> Option<Reference> {
        let begins = anew || !self.on;
        self.on = matches!(goal, Goal::Position(_));
        let Goal::Position(asked) = goal else {
            return None;
        };
        let mut reference = **asked;
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
        // Of a target that the checks before have let pass there always is a motion; without one the
        // joints stay.
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
        Some(reference)
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
        match self.on {
            true => self.motion.left_s(),
            false => 0.0,
        }
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
