//! Current check: a motor current that never changes, or stands at the end of its range.
//!
//! A drive that is off may well report a current of zero, always the same.

use robot_config::Robot;
use robot_state::{DriveState, Event, measured_flags};

use super::{Check, Evidence, Verdict};
use crate::events::Subject;

/// Whether each joint's current was implausible in the last cycle.
#[derive(Debug)]
struct CurrentCheck {
    before: Vec<bool>,
}

pub(super) fn make(robot: &Robot) -> Box<dyn Check> {
    Box::new(CurrentCheck {
        before: vec![false; robot.parameters.joints.len()],
    })
}

impl Check for CurrentCheck {
    fn judge(&mut self, evidence: &Evidence<'_>, verdict: &mut Verdict<'_>) {
        let unsound = measured_flags::FLAT | measured_flags::SATURATED;
        let records = (evidence.measured.joints.iter()).zip(&evidence.commanded.joints);
        for (j, (before, (measured, commanded))) in self.before.iter_mut().zip(records).enumerate()
        {
            let enabled = commanded.drive_state == DriveState::Enabled.number();
            let now = measured.flags & unsound != 0 && enabled;
            if now {
                verdict.lasts(Event::CurrentImplausible, Subject::Joint(j), !*before);
            }
            *before = now;
        }
    }
}
