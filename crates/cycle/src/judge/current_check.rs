//! Current check: a motor current that never changes, or stands at the end of its range.
//!
//! A drive that is off may well report a current of zero, always the same.

use robot_config::Robot;
use robot_state::{DriveState, Event};

use super::{Check, JointCheck, JointEvidence, Verdict, of_each};
use crate::events::Subject;

/// Whether a joint's current was implausible in the last cycle.
#[derive(Debug)]
struct Joint {
    before: bool,
}

pub(super) fn make(robot: &Robot) -> Box<dyn Check> {
    of_each(robot, |_| Joint { before: false })
}

impl JointCheck for Joint {
    fn judge(&mut self, j: usize, evidence: &JointEvidence<'_>, verdict: &mut Verdict<'_>) {
        let enabled = evidence.commanded.drive_state == DriveState::Enabled.number();
        let now = !evidence.has_sound_current() && enabled;
        if now {
            verdict.lasts(Event::CurrentImplausible, Subject::Joint(j), !self.before);
        }
        self.before = now;
    }
}
