//! Torsion check: an encoder that drifts, found by the torques that do not depend on it.
//!
//! In: the torque by torsion, motor current and velocity, and `tau_hat` on the level of F/T
//! sensors and rigid-body model alone. Out: the joints of which one encoder drifts. A drifting encoder
//! changes the torque by torsion alone; a load changes motor current and F/T sensors too, up to
//! friction and errors of the models. Only changes within the last [`SLOW_S`] count: what a torque
//! constant, friction or an inertia is wrong by all the time is the cross-check's affair.
//!
//! ```text
//! e_1 = T - (k_1 i - k_2 omega - k_3 sign(omega) - J omega')     by motor current (D3)
//! e_2 = T - tau_hat                                              by F/T sensors and model
//! ```
//!
//! Without `tau_hat`, torsion and current are taken as late as the velocity is: a rotor that a hand turns round or a wall
//! stops has torques of inertia and friction beyond those that count, which at another instant would stand alone. Where
//! both must change alike, a drift is found sooner without the delay.
//!
//! A change counts from before it began: samples that are not used, as one of a foot that is put down hard may
//! look like an encoder's step, are bridged; to begin anew amid the impact would make its end a change.
//!
//! A hand that turns a motor of more friction than configured changes both: [`HandOrEncoder`] excepts it.
//!
//! Both must change alike, as each alone has errors that look like a drift: friction that reverses,
//! contacts that no F/T sensor measures. Without `tau_hat` the current alone decides, from a greater
//! change on, which must be there with the rotor's inertia and without. So it does for joints beyond which no F/T sensor
//! sits: their `tau_hat` is the model alone, to which every hand, wall and payload is such a change, and no witness.
//! Where the torque itself changes the same way, a share of it ([`SOFTER`]) is a gear less stiff than configured, not a
//! drift.

use robot_config::{JointParameters, Robot};
use robot_state::{TorqueEstimate, torque_flags};
use supervisor::count_in_a_row;

use super::motor::{HandOrEncoder, Motor};
use super::{Check, JointCheck, JointEvidence, Verdict, of_each};
use crate::estimate::{SETTLING_S, valid};

/// Time constants between which a change counts, s. The longer one bounds what a slow drift can
/// do before it is levelled out, the shorter one is the delay of the measured velocity.
const FAST_S: f64 = 0.008;
const SLOW_S: f64 = 0.5;
/// Change that F/T sensors and rigid-body model show, share of the torque limit, and the motor current beyond friction
/// while brakes let go. Chosen; no experiment recorded.
const SHARE: f64 = 0.08;
/// Change that the motor current shows beyond friction once brakes have let go, share of the torque limit.
/// Chosen on the simulated humanoid: half of it is more than one that steps has.
const SHARE_BY_CURRENT: f64 = 0.06;
/// Change of Coulomb friction by which the motor current may differ besides, as a load that is let go
/// reverses it: 2 from one full friction to the other, less where the load was carried at rest.
/// Chosen on the simulated leg: with 1.5 its ankle roll moves by more than a degree before a drift of 0.01 rad/s is
/// found.
const REVERSAL: f64 = 1.25;
/// Share by which the gear may be less stiff than configured: of a torque that changes the torsion then shows so much
/// more than there is. A drifting encoder shows a change where there is none, or of the other sign where the torque is
/// fed back. Found with gears 1.3 times too stiff in the configuration, and with a humanoid in MuJoCo whose ankles
/// carry a push of 60 N from the side.
const SOFTER: f64 = 0.35;
/// Change by the motor current alone, share of the torque limit. Chosen; no experiment recorded.
const SHARE_ALONE: f64 = 0.25;
/// Of both changes as parts of those that count, the product decides once brakes have let go, and neither may be less
/// than this: what one shows clearly, the other need not wait for. Chosen on the simulated humanoid's elbow in mode
/// passive: it moves by 1.05 degrees if both must be whole while its drive's encoder drifts at 0.01 rad/s.
const WEAKER: f64 = 0.8;
/// Difference of both changes beyond friction that is no encoder's, share of the torque limit. Chosen; half of
/// [`SHARE`].
const APART: f64 = 0.04;
/// Samples in a row.
const SAMPLES: u32 = 5;
/// Samples in a row that are bridged: as many as may be implausible before a joint is distrusted.
const BRIDGED: u32 = 8;
/// The change of a signal: what a fast low-pass shows beyond a slow one.
#[derive(Debug, Clone, Copy)]
struct Change {
    fast: f64,
    slow: f64,
}

impl Change {
    fn from(x: f64) -> Self {
        Self { fast: x, slow: x }
    }

    fn update(&mut self, x: f64, dt: f64) -> f64 {
        self.fast += dt / FAST_S * (x - self.fast);
        self.slow += dt / SLOW_S * (x - self.slow);
        self.fast - self.slow
    }

    /// The change of the signal of which `x` is the derivative: a low-pass of it is the signal's high-pass over the
    /// time.
    fn of_derivative(&self, x: f64) -> f64 {
        (x - self.fast) / FAST_S - (x - self.slow) / SLOW_S
    }
}

/// State of a joint that is followed from one sample to the next.
#[derive(Debug, Clone, Copy)]
struct Changes {
    /// Torque by torsion, and the one by current besides friction, as late as the velocity is.
    late: [f64; 2],
    /// Changes of `e_1` without its inertia, of omega, and of `e_2` where it is known.
    by_current: Change,
    omega: Change,
    by_level: Option<Change>,
    /// Changes of the torques by current and by level themselves.
    motor: Change,
    level: Option<Change>,
    hand: HandOrEncoder,
    /// Time since the first sample, s.
    time: f64,
    /// Samples in a row that contradict.
    over: u32,
    /// Samples in a row that could not be used.
    bridged: u32,
}

#[derive(Debug, Clone)]
struct Joint {
    motor: Motor,
    torque_limit: f64,
    /// An F/T sensor sits beyond it, so that what touches its limb is measured.
    is_witnessed: bool,
    /// Its torque from encoders is by torsion.
    has_link_encoder: bool,
    /// Changes so far; none before the first sample.
    changes: Option<Changes>,
}

pub(super) fn make(robot: &Robot) -> Box<dyn Check> {
    of_each(robot, |joint| {
        Joint::new(joint, bears_a_sensor(robot, joint))
    })
}

impl JointCheck for Joint {
    fn judge(&mut self, j: usize, evidence: &JointEvidence<'_>, verdict: &mut Verdict<'_>) {
        let (measured, fast) = (evidence.measured, evidence.fast);
        if evidence.overslept || !evidence.is_engaged() {
            // What comes next does not go on from what came before. Off, brakes carry the torque.
            self.changes = None;
        }
        if !evidence.is_engaged() {
            return;
        }
        let torsion = (fast.torsion).or_else(|| self.at_least(&evidence.estimated.tau_encoder));
        let Some(torsion) = torsion.filter(|_| evidence.shows_torsion()) else {
            self.bridge();
            return;
        };
        let hat = valid(&fast.by_sensors).filter(|_| self.is_witnessed);
        let hat = hat.map(|hat| hat.tau);
        let current = evidence.has_sound_current().then_some(measured.current);
        if self.update(torsion, current, measured.omega, hat, evidence.dt) {
            verdict.distrust(j);
        }
    }
}

impl Joint {
    fn new(joint: &JointParameters, is_witnessed: bool) -> Self {
        Self {
            motor: Motor::new(joint),
            torque_limit: joint.limits.torque,
            is_witnessed,
            has_link_encoder: joint.has_link_encoder,
            changes: None,
        }
    }

    /// The torque by torsion where it has gone beyond the limit: there is at least as much. Without it, an encoder that
    /// drifts quickly would leave the range before it is found. What was beyond from the beginning is no change.
    fn at_least(&self, encoder: &TorqueEstimate) -> Option<f64> {
        let beyond = torque_flags::VALID | torque_flags::SATURATED;
        let was_within = self.has_link_encoder && self.changes.is_some();
        let is_beyond = was_within && encoder.flags & beyond == beyond;
        is_beyond.then(|| encoder.tau.clamp(-self.torque_limit, self.torque_limit))
    }

    /// A sample that cannot be used: what comes next goes on from what came before, unless there are too
    /// many of them.
    fn bridge(&mut self) {
        self.changes = self.changes.take().and_then(|changes| {
            let bridged = changes.bridged.saturating_add(1);
            (bridged <= BRIDGED).then_some(Changes { bridged, ..changes })
        });
    }

    /// Whether an encoder drifts.
    fn update(
        &mut self,
        torsion: f64,
        current: Option<f64>,
        omega: f64,
        hat: Option<f64>,
        dt: f64,
    ) -> bool {
        let Some(current) = current else {
            self.bridge();
            return false;
        };
        let omega = omega / self.motor.gear_ratio;
        let made = self.motor.k_1 * current;
        let late = (self.changes.as_ref()).map_or([torsion, made], |changes| changes.late);
        let share = if hat.is_some() {
            1.0
        } else {
            dt / (dt + FAST_S)
        };
        let [torsion_late, made_late] =
            [(late[0], torsion), (late[1], made)].map(|(late, now)| late + share * (now - late));
        let motor = made_late + self.motor.torque(0.0, omega);
        let changes = self.changes.get_or_insert(Changes {
            late: [torsion, made],
            by_current: Change::from(torsion_late - motor),
            omega: Change::from(omega),
            motor: Change::from(motor),
            level: None,
            by_level: None,
            hand: HandOrEncoder::default(),
            time: 0.0,
            over: 0,
            bridged: 0,
        });
        changes.late = [torsion_late, made_late];
        changes.bridged = 0;
        changes.time += dt;
        let turned = changes.omega.update(omega, dt);
        let inertia = self.motor.inertia * changes.omega.of_derivative(omega);
        let made = changes.motor.update(motor, dt);
        let changed = changes.by_current.update(torsion_late - motor, dt);
        let [by_current, without_inertia] =
            [inertia, 0.0].map(|inertia| beyond_scale(changed + inertia, made - inertia));
        let (limit, friction) = (self.torque_limit, REVERSAL * self.motor.k_3);
        let settled = changes.time > SETTLING_S;
        let share = if settled { SHARE_BY_CURRENT } else { SHARE };
        let drifts = match hat {
            Some(hat) => {
                let error = torsion - hat;
                let level = changes.by_level.get_or_insert(Change::from(error));
                let carried = changes.level.get_or_insert(Change::from(hat));
                let by_level = beyond_scale(level.update(error, dt), carried.update(hat, dt));
                let parts = [
                    by_level / (SHARE * limit),
                    by_current / (share * limit + friction),
                ];
                let weaker = if settled { WEAKER } else { 1.0 };
                let apart = APART * limit + friction;
                let is_hand =
                    (changes.hand).is_hand(&self.motor, [by_current, by_level], turned, apart, dt);
                !is_hand
                    && parts[0] * parts[1] > 1.0
                    && parts.iter().all(|part| part.abs() > weaker)
            }
            None => {
                (changes.by_level, changes.level) = (None, None);
                // The rotor's inertia may explain a difference, but not make one: its size is known roughly, its
                // velocity late. A hand that jerks a joint showed 84 N·m of inertia where 13 N·m differed.
                let least = SHARE_ALONE * limit + friction;
                let agree = by_current * without_inertia > 0.0;
                settled && agree && by_current.abs().min(without_inertia.abs()) > least
            }
        };
        count_in_a_row(&mut changes.over, drifts) >= SAMPLES
    }
}

/// The part of a change of the error that is not that of a softer gear, where the torque changes by so much.
fn beyond_scale(error: f64, torque: f64) -> f64 {
    if error * torque <= 0.0 {
        return error;
    }
    error.signum() * (error.abs() - SOFTER * torque.abs()).max(0.0)
}

/// An F/T sensor sits beyond the joint.
fn bears_a_sensor(robot: &Robot, joint: &JointParameters) -> bool {
    let model = &robot.model;
    let sensors = robot.parameters.ft_sensors.iter();
    let frames = sensors.filter_map(|ft| model.frame_index(&ft.sensor.frame));
    let on = frames.filter_map(|frame| model.frames().get(frame));
    let beyond = |body: usize| {
        let mut bodies = model.bodies().iter().enumerate().skip(1);
        bodies.any(|(b, own)| own.joint == joint.model_index && model.supports(b, body))
    };
    on.map(|frame| frame.body).any(beyond)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Torque limit of 110 N·m.
    fn joint() -> Joint {
        Joint {
            motor: Motor::EXAMPLE,
            torque_limit: 110.0,
            is_witnessed: true,
            has_link_encoder: true,
            changes: None,
        }
    }

    /// A joint that has carried 10 N·m for a while, and has then had so many unusable samples.
    fn after(bridged: u32) -> Joint {
        let mut joint = joint();
        for _ in 0..200 {
            assert!(!joint.update(10.0, Some(10.0 / 6.0), 0.0, Some(10.0), 1e-3));
        }
        (0..bridged).for_each(|_| joint.bridge());
        joint
    }

    /// The first usable sample after an impact shows 20 N·m more than current and F/T sensors.
    fn is_found(joint: &mut Joint, torsion: impl Fn(u32) -> f64) -> bool {
        (0..30).any(|k| joint.update(torsion(k), Some(10.0 / 6.0), 0.0, Some(10.0), 1e-3))
    }

    #[test]
    fn an_impact_that_ends_is_no_drift_though_a_sample_of_it_was_not_used() {
        let ends = |k: u32| if k == 0 { 30.0 } else { 10.0 };
        assert!(!is_found(&mut after(0), ends));
        assert!(!is_found(&mut after(1), ends));
        assert!(!is_found(&mut after(BRIDGED), ends));
    }

    #[test]
    fn a_change_that_stays_is_found_across_samples_that_were_not_used() {
        assert!(is_found(&mut after(1), |_| 30.0));
        assert!(is_found(&mut after(BRIDGED), |_| 30.0));
        // Samples after a longer gap need not go on from those before it.
        assert!(!is_found(&mut after(BRIDGED + 1), |_| 30.0));
    }

    /// A hand speeds the joint up by 20 rad/s² for 30 ms. Of the motor's torque the rotor takes 60 N·m, which velocities
    /// show 8 ms late; a rotor that is lighter than configured takes 10 N·m. An encoder that drifts by 60 N·m is found.
    #[test]
    fn a_rotor_that_a_hand_speeds_up_is_no_drift() {
        let found = |drifts: bool, inertia: f64| {
            let mut joint = joint();
            (joint.motor.inertia, joint.is_witnessed) = (3.0, false);
            let acceleration = |k: f64| {
                if (1000.0..1030.0).contains(&k) {
                    20.0
                } else {
                    0.0
                }
            };
            let mut velocities = [0.0; 2000];
            for k in 1..2000 {
                velocities[k] = velocities[k - 1] + 1e-3 * acceleration(k as f64);
            }
            (0..1990).any(|k| {
                let late = velocities[usize::saturating_sub(k, 8)];
                let rotor = inertia * acceleration(k as f64);
                let drift = if drifts && k > 1000 { -60.0 } else { 0.0 };
                let friction = if late > 0.0 { 4.0 } else { 0.0 };
                let current = (rotor + friction) / 6.0;
                joint.update(drift, Some(current), 100.0 * late, None, 1e-3)
            })
        };
        assert!(!found(false, 3.0));
        assert!(!found(false, 0.5));
        assert!(found(true, 3.0));
    }

    /// A gear of three quarters of the stiffness that is configured, whose torque jumps to and fro by up to two thirds of
    /// the limit; and the same where the torque is fed back, so that a drifting encoder takes away what it shows too much.
    #[test]
    fn a_softer_gear_is_no_drift_and_a_drift_in_feedback_is_found() {
        let mut soft = joint();
        for k in 0..6000 {
            let torque = if k / 700 % 2 == 0 { -35.0 } else { 38.0 };
            let drifts = soft.update(1.33 * torque, Some(torque / 6.0), 0.0, Some(torque), 1e-3);
            assert!(!drifts, "{k}");
        }
        let mut fed_back = after(0);
        let drift = |k: u32| 0.08 * f64::from(k);
        let found = (0..400).find(|&k| {
            let torque = 10.0 - drift(k);
            fed_back.update(10.0, Some(torque / 6.0), 0.0, Some(torque), 1e-3)
        });
        assert!(found.is_some_and(|k| drift(k) < 22.0), "{found:?}");
    }
}
