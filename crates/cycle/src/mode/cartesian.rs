//! Cartesian: frames led by springs, dampers and desired forces (D 5.4).
//!
//! In: a client's frames, the newest angles, contact wrenches of F/T sensors or external torques. Out: torques
//! that are added to those of inverse dynamics, and the stiffness of joints besides: those of a led limb keep
//! their posture with a small share of theirs, all others stay as in mode inverse dynamics. The law is
//! [`control::CartesianLaw`].
//!
//! Inverse dynamics takes the force by which the ground carries the robot off the joints: a limb on the ground would
//! show no stiffness. So for a led limb that share is put back, and the desired force takes its place. Where a frame's forces are
//! those of an F/T sensor, what its filters have not shown yet is added. A robot that uses no frame pays for
//! a branch; nothing here is computed before a client uses one.

mod approach;
mod frame_check;
mod frames;
mod record;

use robot_config::Robot;
use robot_state::{CommandedRecord, Event, MeasuredRecord, Mode, Reference};

use super::{
    Bounds, ClientMode, Feedback, Foresight, JointGoal, Made, ModeCycle, Speed, Spring, Task, Unfit,
};
use crate::inputs::Seen;
use frame_check::FrameCheck;
use frames::Frames;

pub(super) use frame_check::is_finite;

#[derive(Debug)]
struct Cartesian {
    check: FrameCheck,
    frames: Frames,
}

pub(super) fn make(robot: &Robot) -> Made {
    if robot.parameters.frames.is_empty() {
        return Ok(None);
    }
    Ok(Some(Box::new(Cartesian {
        check: FrameCheck::new(robot),
        frames: Frames::new(robot),
    })))
}

impl ClientMode for Cartesian {
    fn accepts(&self, bounds: &Bounds, reference: &Reference) -> bool {
        bounds.softened(reference) && bounds.motions(reference) && self.check.is_within(reference)
    }

    fn takes(
        &mut self,
        reference: &Reference,
        begins: bool,
        measured: &MeasuredRecord,
    ) -> Result<(), Event> {
        if begins && !self.check.begins_near(reference, measured) {
            return Err(Event::ReferenceJump);
        }
        if !begins && !self.check.goes_on(reference) {
            return Err(Event::ReferenceRejected);
        }
        Ok(())
    }

    fn set_tasks(&mut self, mut cycle: ModeCycle<'_>) -> Result<(), Unfit> {
        let (asked, seen) = (cycle.asked, cycle.seen);
        let carried = cycle.body.follow(asked.reference, seen);
        let torques = cycle.body.torques_mut();
        (self.frames).lead(asked, (seen, &carried), torques, cycle.commanded);
        cycle.track(Mode::Cartesian, asked, |j, mut follow| {
            if self.frames.leads(j) {
                follow.speed = Speed::Torque;
                follow.spring = follow.spring.map(|spring| Spring {
                    impedance: self.frames.posture(j, spring.impedance),
                    foresight: Foresight::None,
                    ..spring
                });
            }
            Task {
                goal: JointGoal::Follow(follow),
                feedback: Feedback::Estimated {
                    pressing: self.frames.force_share(j),
                },
            }
        });
        Ok(())
    }

    fn idle(&mut self, seen: &Seen<'_>, commanded: &mut CommandedRecord) {
        self.frames.show(seen.client, seen.measured, commanded);
    }
}
