//! Bearing: a joint whose drive is withdrawn in a fault, and that no brake would hold.
//!
//! An actuator that is switched off lets its joint fall. One whose commands hold their gains goes on instead with the
//! mean of its torque before the fault, damped, and without a position: then neither a slipped encoder nor a wrong target
//! moves the joint. It is switched off where it reports another torque than that, where its torque drives the joint on or
//! does not keep it from getting fast, and when an operator or a fault's reaction switches all drives off.

use robot_config::{JointParameters, Robot};
use robot_state::{DriveState, JointMeasured, measured_flags};
use supervisor::{Drive, DriveGoal, Safety};

/// Cycles from which on a joint is judged: until then the torque of before ends. Chosen; no experiment recorded.
const SETTLES: u32 = 8;
/// Further velocity from which on a joint is driven, share of its limit. Chosen; no experiment recorded.
const DRIVEN: f64 = 0.05;
/// Further velocity from which on nothing bears a joint, whatever torque its actuator reports: where an encoder slipped on
/// the rotor, or its sign changed, torque and damping push the other way. Share of the limit. Chosen; no experiment
/// recorded.
const UNBORNE: f64 = 0.25;
/// Torque that does work on it, share of its limit: less is noise. Chosen; no experiment recorded.
const WORKS: f64 = 0.03;
/// Samples in a row that show it. Chosen; no experiment recorded.
const SAMPLES: u32 = 3;
/// Cycles in a row in which an actuator may report that it does not bear its joint: two there and back, and its own time.
/// Chosen; no experiment recorded.
const DISOBEYS: u32 = 4;

/// Bearing of each joint; none where its drive cannot.
#[derive(Debug)]
pub(super) struct Bearings(Vec<Option<Bearing>>);

#[derive(Debug, Clone)]
struct Bearing {
    gear_ratio: f64,
    torque_per_current: f64,
    /// Velocity and torque that make a joint a driven one, rad/s and N·m.
    driven: [f64; 2],
    /// Velocity of a joint that nothing bears, rad/s.
    unborne_from: f64,
    /// The joint is borne, for so many cycles.
    going: Option<u32>,
    /// Velocity when it was judged first, rad/s.
    from: f64,
    driven_for: u32,
    /// Cycles in a row in which its actuator has not borne it.
    unborne: u32,
}

impl Bearings {
    pub(super) fn new(robot: &Robot) -> Self {
        let joint = |joint: &JointParameters| {
            let profile = joint.drive_profile.as_ref()?;
            profile.bears.then_some(Bearing {
                gear_ratio: joint.encoders.gear_ratio,
                torque_per_current: joint.encoders.gear_ratio
                    * joint.estimator.wave_generator.torque_constant,
                driven: [DRIVEN * joint.limits.velocity, WORKS * joint.limits.torque],
                unborne_from: UNBORNE * joint.limits.velocity,
                going: None,
                from: 0.0,
                driven_for: 0,
                unborne: 0,
            })
        };
        Self(robot.parameters.joints.iter().map(joint).collect())
    }

    /// An operator has switched the drives off.
    pub(super) fn end(&mut self) {
        (self.0.iter_mut().flatten()).for_each(|bearing| bearing.going = None);
    }

    /// Whether the drive of joint `j` is to bear it in this cycle. `wanted`: it is to follow set-points; `safety`: of the
    /// latched fault. One that switches all drives off ends it, and one that is acknowledged does not.
    pub(super) fn update(
        &mut self,
        j: usize,
        (wanted, safety): (bool, Option<Safety>),
        drive: &Drive,
        measured: &JointMeasured,
    ) -> bool {
        let Some(bearing) = self.0.get_mut(j).and_then(Option::as_mut) else {
            return false;
        };
        let begins = safety.is_some() && drive.goal() == DriveGoal::Enabled && drive.can_stop();
        bearing.going = match bearing.going {
            _ if wanted || safety == Some(Safety::Off) => None,
            None if begins => {
                (bearing.driven_for, bearing.unborne) = (0, 0);
                Some(0)
            }
            None => None,
            Some(cycles) => {
                let is_on = drive.is_enabled() || drive.state() == DriveState::Stopping;
                let is_heard =
                    measured.flags & (measured_flags::MISSED | measured_flags::STALE) == 0;
                let errs = is_heard && bearing.errs(cycles, drive, measured);
                let goes_on = is_on && !errs;
                goes_on.then_some(cycles.saturating_add(1))
            }
        };
        bearing.going.is_some()
    }
}

impl Bearing {
    /// Whether a sample shows that the actuator does not bear the joint, or drives it on.
    fn errs(&mut self, cycles: u32, drive: &Drive, measured: &JointMeasured) -> bool {
        self.unborne = if drive.is_enabled() {
            self.unborne + 1
        } else {
            0
        };
        self.is_driven(cycles, measured) || self.unborne > DISOBEYS
    }

    /// Whether its own torque drives the joint on, or does not bear it, by the actuator's own velocity.
    fn is_driven(&mut self, cycles: u32, measured: &JointMeasured) -> bool {
        let velocity = measured.omega / self.gear_ratio;
        if cycles < SETTLES || !velocity.is_finite() {
            return false;
        }
        if cycles == SETTLES {
            self.from = velocity.abs();
        }
        let torque = self.torque_per_current * measured.current;
        let [faster, works] = self.driven;
        let gained = velocity.abs() - self.from;
        let works_on = torque.abs() > works && torque * velocity > 0.0;
        let is_driven = gained > faster && works_on || gained > self.unborne_from;
        self.driven_for = if is_driven { self.driven_for + 1 } else { 0 };
        self.driven_for >= SAMPLES
    }
}
