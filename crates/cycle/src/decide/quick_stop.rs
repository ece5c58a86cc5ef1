//! Reaction `off` of a robot that moves: a drive that can brakes its motor by itself before it is off.
//!
//! A joint whose drive is switched off in motion runs on until friction or a brake stops it. A drive's own quick
//! stop needs nothing of this program but one control word. It needs an encoder that is sound: a joint whose
//! samples are missing or contradict each other is switched off at once. So is one whose drive takes currents, as
//! such a drive need not have gains for a ramp.

use robot_config::Robot;
use supervisor::{Drive, DriveGoal, JointCondition};

/// Time in which a drive enters its quick stop, s: two cycles there and back at 250 Hz, and its step. One that stays
/// enabled for longer does not know the word, and is switched off.
const ENTERS_S: f64 = 0.02;

#[derive(Debug)]
pub(super) struct QuickStops {
    joints: Vec<QuickStop>,
    /// Longest time of one, cycles.
    limit: u32,
    /// Longest time until the drive is in it, cycles.
    enters: u32,
}

#[derive(Debug, Clone, Copy)]
struct QuickStop {
    takes_position: bool,
    /// Cycles that are left; 0: none is going on.
    left: u32,
}

impl QuickStops {
    pub(super) fn new(robot: &Robot) -> Self {
        let p = &robot.parameters;
        let cycles = |time: f64| (time / p.timing.sample_period).ceil() as u32;
        let joints = p.joints.iter().map(|joint| QuickStop {
            takes_position: joint.takes_position(),
            left: 0,
        });
        Self {
            joints: joints.collect(),
            limit: cycles(p.safety.time_limit),
            enters: cycles(ENTERS_S),
        }
    }

    /// The drive of a joint is no longer wanted: whether it is to stop by itself in this cycle. `may`: nothing
    /// but the robot's reaction switches it off.
    pub(super) fn update(
        &mut self,
        joint: usize,
        may: bool,
        drive: &Drive,
        condition: &JointCondition,
    ) -> bool {
        let (limit, enters) = (self.limit, self.enters);
        let Some(joint) = self.joints.get_mut(joint) else {
            return false;
        };
        let sound = condition.usable && !condition.distrusted && !condition.slipped;
        let ignored = drive.is_enabled() && joint.left > 0 && joint.left + enters < limit;
        let needed = may && sound && joint.takes_position && !condition.at_rest && !ignored;
        let begins = drive.goal() == DriveGoal::Enabled && drive.can_stop();
        joint.left = match joint.left {
            _ if !needed => 0,
            0 if begins => limit,
            left => left.saturating_sub(1),
        };
        joint.left > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use supervisor::DriveProfile;

    #[test]
    fn a_drive_that_ignores_its_quick_stop_is_switched_off() {
        let mut stops = QuickStops {
            joints: vec![QuickStop {
                takes_position: true,
                left: 0,
            }],
            limit: 2000,
            enters: 20,
        };
        let moving = JointCondition {
            usable: true,
            ..JointCondition::default()
        };
        // Cycles for which it is to stop by itself, where its status words are these.
        let mut stopping = |words: &dyn Fn(u32) -> u32| {
            let mut drive = Drive::new(Some(DriveProfile::cia402(500)));
            drive.pursue(DriveGoal::Enabled);
            drive.update(Some(0x27));
            let cycle = |k: &u32| {
                let stops = stops.update(0, true, &drive, &moving);
                drive.pursue(if stops {
                    DriveGoal::Stopped
                } else {
                    DriveGoal::Off
                });
                drive.update(Some(words(*k)));
                stops
            };
            (0..5000).take_while(cycle).count()
        };
        assert_eq!(stopping(&|_| 0x27), 22, "deaf");
        assert_eq!(stopping(&|k| if k < 3 { 0x27 } else { 0x07 }), 2000);
    }
}
