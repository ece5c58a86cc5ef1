//! Thermal check: a drive that is hot is warned of, may make less torque, and stops the robot in the end.
//!
//! By the temperature that it reports, or, as long as it reports none, by its current: the winding's heat follows `i²`
//! with one time constant (I²t), as a share of what the continuous current makes in the end. From a first level on
//! the joint's torque limit falls linearly, down to the torque of the continuous current at a second one: a drive
//! that is held there gets no hotter by its current.

use robot_config::{JointParameters, Robot, Thermal};
use robot_state::{Event, JointMeasured, measured_flags, reported_flags};

use super::{Check, Heat, JointCheck, JointEvidence, Verdict, of_each};
use crate::events::Subject;

/// Loads by the current at which it is warned of and from which on the torque limit falls, and at which it has fallen:
/// the warning and error limits that makers of drives preset for a motor's thermal utilisation (80 and 100 %).
const LOADS: [f64; 2] = [0.8, 1.0];
/// Load at which the robot stops: a current a tenth above the continuous one, for ever. The torque limit bounds the
/// current by a motor's model, whose torque constant and friction are not known better.
const STOP_LOAD: f64 = 1.21;
/// An event lasts until the level is lower by this share of the way from warning to stop, so that noise does not repeat
/// it. Chosen; no experiment recorded.
const HYSTERESIS: f64 = 0.05;

/// Levels at which a drive is warned of, derated, fully derated, and stops the robot.
#[derive(Debug, Clone, Copy)]
struct Levels([f64; 4]);

#[derive(Debug)]
struct Drive {
    thermal: Thermal,
    /// Torque of the continuous current, as a share of the torque limit.
    continuous: f64,
    load: f64,
    is_hot: bool,
    is_overheated: bool,
}

/// Makes the check; none where no drive is watched.
pub(super) fn make(robot: &Robot) -> Option<Box<dyn Check>> {
    let mut joints = robot.parameters.joints.iter();
    let is_watched = joints.any(|joint| Drive::of(joint).is_some());
    is_watched.then(|| of_each(robot, Drive::of))
}

impl Levels {
    const BY_CURRENT: Self = Self([LOADS[0], LOADS[0], LOADS[1], STOP_LOAD]);

    fn by_temperature([warn, derate, stop]: [f64; 3]) -> Self {
        Self([warn, derate, stop, stop])
    }

    /// Torque that is left at a level, as a share of the limit; `continuous`: that of the continuous current.
    fn share(self, level: f64, continuous: f64) -> f64 {
        let [_, from, to, _] = self.0;
        let way = ((level - from) / (to - from)).clamp(0.0, 1.0);
        1.0 - way * (1.0 - continuous)
    }

    /// Whether the drive is hot and overheated now, if it was so `before`.
    fn reached(self, level: f64, before: [bool; 2]) -> [bool; 2] {
        let [warn, .., stop] = self.0;
        let back = HYSTERESIS * (stop - warn);
        let reached = |limit: f64, was: bool| level >= if was { limit - back } else { limit };
        [reached(warn, before[0]), reached(stop, before[1])]
    }
}

impl Drive {
    fn of(joint: &JointParameters) -> Option<Self> {
        Some(Self {
            thermal: joint.thermal?,
            continuous: joint.continuous_share()?,
            load: 0.0,
            is_hot: false,
            is_overheated: false,
        })
    }

    /// Takes a cycle; what it leaves of the torque, and whether it has become hot or overheated.
    fn update(&mut self, measured: &JointMeasured, dt: f64) -> (f64, [bool; 2]) {
        if measured.flags & measured_flags::NEVER == 0 {
            let makes = (measured.current / self.thermal.continuous_current).powi(2);
            self.load += (makes - self.load) * dt / (dt + self.thermal.time_constant);
        }
        let reported = measured.reported & reported_flags::TEMPERATURE != 0;
        let (levels, level) = match self.thermal.temperatures.filter(|_| reported) {
            Some(limits) => (Levels::by_temperature(limits), measured.temperature),
            None => (Levels::BY_CURRENT, self.load),
        };
        let before = [self.is_hot, self.is_overheated];
        [self.is_hot, self.is_overheated] = levels.reached(level, before);
        let begins = [self.is_hot && !before[0], self.is_overheated && !before[1]];
        (levels.share(level, self.continuous), begins)
    }
}

impl JointCheck for Option<Drive> {
    fn judge(&mut self, j: usize, evidence: &JointEvidence<'_>, verdict: &mut Verdict<'_>) {
        let Some(drive) = self else {
            return;
        };
        let (share, [hot, overheated]) = drive.update(evidence.measured, evidence.dt);
        let load = drive.load;
        verdict.heats(j, Heat { load, share });
        let subject = Subject::Joint(j);
        if drive.is_hot {
            verdict.lasts(Event::DriveHot, subject, hot);
            verdict.warn(Event::DriveHot, subject);
        }
        if drive.is_overheated {
            verdict.lasts(Event::DriveOverheated, subject, overheated);
        }
    }
}
