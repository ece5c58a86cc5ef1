//! Drift check: of a joint that stands, held by nothing but a torque, a source of that torque drifts.
//!
//! In: the torque by torsion, that from F/T sensors and IMU, motor current and velocity, the desired torque and the
//! link-side angle. Out: event 214, which by default ends the mode: the robot holds. An encoder that creeps by 0.02
//! degrees/s changes the torque of a stiff gear by 14 N·m/s, and a joint that nothing brings back moves by that; so
//! does an F/T sensor that drifts as soon as its level is followed.
//!
//! ```text
//! e = T - tau_whole_body        |e - b| > SHARE tau_max + NOISE counts + what turning and load explain
//! e_1 = T - (k_1 i - k_2 omega - k_3 sign(omega) - J omega')     by motor current (D3)
//! ```
//!
//! `b` is what `e` was as the joint came to stand, and follows it slowly: creep of the gear and warming sensors are no
//! news. While the joint stands friction hides from the current which source errs, and any of them does. When it has
//! moved off, something that presses where no sensor measures it looks alike, but `e_1` is then that of friction; of an
//! encoder that drifts it is `e - b`. The nearer of both is believed. A change that is faster than such a drift is a
//! hand's or an impact, and begins the judgement anew, as does a joint that has come to stand elsewhere;
//! [`TorsionCheck`](super::torsion_check) judges what is that fast.

use robot_config::{JointParameters, Robot};
use robot_state::Event;
use supervisor::time_in_a_row;

use super::motor::Motor;
use super::{Check, JointCheck, JointEvidence, Verdict, of_each};
use crate::estimate::{KINEMATIC_SLOPE, valid};
use crate::events::Subject;

/// Time constant of `e` and `e_1`, s. Chosen on the simulated leg with slow drifts and with hands
/// (`crates/cycle/tests/slow_drifts.rs`), and tried on `rt-tests/second-robot`.
const FILTER_S: f64 = 0.03;
/// Time constants of `e` between which a change is a hand's, s. Chosen as [`FILTER_S`].
const QUICK_S: [f64; 2] = [0.01, 0.06];
/// Change between the time constants [`QUICK_S`] that is no slow drift's, share of the torque limit: 20 % of it a
/// second. Chosen as [`FILTER_S`].
const QUICK: f64 = 0.01;
/// Way within which the joint stands, rad: friction and bristles give way by as much. Chosen as [`FILTER_S`].
const STANDS_WITHIN: f64 = 0.3 * core::f64::consts::PI / 180.0;
/// Change of the desired torque that is none, share of the torque limit. Chosen as [`FILTER_S`].
const SAME_TORQUE: f64 = 0.005;
/// Time in which `b` settles after the joint came to stand, s. Chosen as [`FILTER_S`].
const SETTLES_S: f64 = 0.3;
/// Time constant of `b` while it settles, s. Chosen as [`FILTER_S`].
const SETTLING_TIME_S: f64 = 0.1;
/// Time constant of `b` once it has settled, s. Chosen as [`FILTER_S`].
const CREEP_TIME_S: f64 = 3.0;
/// Change that counts, share of the torque limit. Chosen on the simulated leg: a sound one's is 0.1 %, and one of 1 %
/// moves a knee.
const SHARE: f64 = 0.007;
/// Change that counts, in counts of the encoders: between two of them the torque stands. Chosen as [`FILTER_S`].
const NOISE_COUNTS: f64 = 1.5;
/// Change per change of the torque itself, which a stiffness may make wrong. Chosen as [`FILTER_S`].
const SCALE: f64 = 0.3;
/// Way over which a kinematic error of two periods per turn of the wave generator grows, motor side, rad.
/// Chosen as [`FILTER_S`].
const KINEMATIC_WAY: f64 = 0.5;
/// Velocity, in widths over which friction changes sign, from which on the motor turns. Chosen as [`FILTER_S`].
const TURNS: f64 = 3.0;
/// Share of `e - b` from which on `e_1` is nearer to it than to none: half.
const NEARER: f64 = 0.5;
/// Time for which a drift must last, s. Chosen as [`FILTER_S`].
const LASTS_S: f64 = 0.03;

/// What was known when the joint came to stand.
#[derive(Debug, Clone, Copy)]
struct Stand {
    angle: f64,
    desired: f64,
    /// `b`, N·m.
    level: f64,
    /// Least and greatest torque by torsion and by F/T sensors and IMU since then, N·m.
    ranges: [[f64; 2]; 2],
    time: f64,
    /// Time for which the joint has stood where it has moved off to, s.
    elsewhere_s: f64,
    over_s: f64,
}

#[derive(Debug, Clone)]
struct Joint {
    torque_limit: f64,
    /// Change that counts, N·m.
    least: f64,
    /// Error of the torque by torsion per angle, N·m/rad, and the way over which it grows, rad.
    error_per_angle: f64,
    kinematic_way: f64,
    motor: Motor,
    errors: Option<Errors>,
    stand: Option<Stand>,
    before: bool,
}

/// Filtered errors, N·m, and velocity, rad/s.
#[derive(Debug, Clone, Copy)]
struct Errors {
    by_body: f64,
    quick: [f64; 2],
    by_motor: f64,
    omega: f64,
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    /// By torsion, and from F/T sensors and IMU, N·m.
    torques: [f64; 2],
    /// A.
    current: f64,
    /// Motor side, rad/s.
    omega: f64,
    /// Link side, rad.
    angle: f64,
    /// N·m.
    desired: f64,
}

pub(super) fn make(robot: &Robot) -> Box<dyn Check> {
    of_each(robot, Joint::new)
}

impl JointCheck for Joint {
    fn judge(&mut self, j: usize, evidence: &JointEvidence<'_>, verdict: &mut Verdict<'_>) {
        let (measured, dt) = (evidence.measured, evidence.dt);
        let torsion = evidence.fast.torsion.filter(|_| evidence.shows_torsion());
        let body = valid(&evidence.estimated.tau_whole_body).map(|torque| torque.tau);
        let alone = evidence.alone && !evidence.overslept;
        let drifts = match torsion.zip(body) {
            Some((torsion, body)) => {
                let sample = Sample {
                    torques: [torsion, body],
                    current: measured.current,
                    omega: measured.omega,
                    angle: measured.q,
                    desired: evidence.commanded.tau_d,
                };
                let errors = self.filter(&sample, dt);
                alone && self.drifts(&errors, &sample, dt)
            }
            // A sample that cannot be used is bridged.
            None => self.before && alone,
        };
        if !alone {
            self.stand = None;
        }
        if drifts {
            verdict.lasts(Event::TorqueDrift, Subject::Joint(j), !self.before);
        }
        self.before = drifts;
    }

    fn retare(&mut self) {
        (self.stand, self.errors) = (None, None);
    }
}

impl Joint {
    fn new(joint: &JointParameters) -> Self {
        let (e, limit) = (&joint.estimator, joint.limits.torque);
        let counts = (e.motor_resolution / e.gear_ratio).hypot(e.link_resolution);
        Self {
            torque_limit: limit,
            least: SHARE * limit + NOISE_COUNTS * e.compliance.k_fs0 * counts,
            error_per_angle: KINEMATIC_SLOPE * e.compliance.k_fs0,
            kinematic_way: KINEMATIC_WAY / joint.encoders.gear_ratio,
            motor: Motor::new(joint),
            errors: None,
            stand: None,
            before: false,
        }
    }

    /// Filters the errors of a sample.
    fn filter(&mut self, sample: &Sample, dt: f64) -> Errors {
        let [torsion, body] = sample.torques;
        let omega = sample.omega / self.motor.gear_ratio;
        let motor = self.motor.torque(sample.current, omega);
        let (by_body, by_motor) = (torsion - body, torsion - motor);
        let errors = self.errors.get_or_insert(Errors {
            by_body,
            quick: [by_body; 2],
            by_motor,
            omega,
        });
        let share = |time: f64| dt / (dt + time);
        let usual = share(FILTER_S);
        errors.by_body += usual * (by_body - errors.by_body);
        for (quick, time) in errors.quick.iter_mut().zip(QUICK_S) {
            *quick += share(time) * (by_body - *quick);
        }
        errors.by_motor += usual * (by_motor - errors.by_motor);
        errors.omega += usual * (omega - errors.omega);
        // What a low-pass leaves of a derivative is the signal's high-pass over the time.
        let acceleration = (omega - errors.omega) / FILTER_S;
        Errors {
            by_motor: errors.by_motor + self.motor.inertia * acceleration,
            ..*errors
        }
    }

    /// Whether one of the torques by torsion and by F/T sensors and IMU drifts.
    fn drifts(&mut self, errors: &Errors, sample: &Sample, dt: f64) -> bool {
        let begin = Stand {
            angle: sample.angle,
            desired: sample.desired,
            level: errors.by_body,
            ranges: sample.torques.map(|torque| [torque; 2]),
            time: 0.0,
            elsewhere_s: 0.0,
            over_s: 0.0,
        };
        let limit = self.torque_limit;
        let turns = self.motor.turns(errors.omega, TURNS);
        let stand = self.stand.get_or_insert(begin);
        let way = (sample.angle - stand.angle).abs();
        let has_left = way > STANDS_WITHIN;
        let settles = stand.time < SETTLES_S;
        time_in_a_row(&mut stand.elsewhere_s, has_left && !turns, dt);
        let same = (sample.desired - stand.desired).abs() <= SAME_TORQUE * limit;
        let slow = (errors.quick[0] - errors.quick[1]).abs() <= QUICK * limit;
        let stands_elsewhere = stand.elsewhere_s >= SETTLES_S;
        if !same || !slow || settles && has_left || stands_elsewhere {
            *stand = begin;
            return false;
        }
        let time = if settles {
            SETTLING_TIME_S
        } else {
            CREEP_TIME_S
        };
        stand.time += dt;
        stand.level += dt / (dt + time) * (errors.by_body - stand.level);
        for ([low, high], torque) in stand.ranges.iter_mut().zip(sample.torques) {
            (*low, *high) = (low.min(torque), high.max(torque));
        }
        // A torque that changes does so by both; one that drifts does not.
        let changes = stand.ranges.map(|[low, high]| high - low);
        let change = changes[0].min(changes[1]);
        let explained = self.error_per_angle * way.min(self.kinematic_way)
            + SCALE * (change - self.least).max(0.0);
        let drift = errors.by_body - stand.level;
        let shown = errors.by_motor * drift.signum();
        let is_drift = !has_left || turns && shown > NEARER * drift.abs();
        let is_over = !settles && is_drift && drift.abs() > self.least + explained;
        time_in_a_row(&mut stand.over_s, is_over, dt) >= LASTS_S
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1e-3;

    /// Torque limit of 100 N·m.
    fn joint() -> Joint {
        Joint {
            torque_limit: 100.0,
            least: 0.7,
            error_per_angle: 10.0,
            kinematic_way: 0.005,
            motor: Motor::EXAMPLE,
            errors: None,
            stand: None,
            before: false,
        }
    }

    /// A joint that has borne 10 N·m for a while.
    fn standing() -> Joint {
        let mut joint = joint();
        assert_eq!(found(&mut joint, 400, |_| STANDS), None);
        joint
    }

    const STANDS: Sample = Sample {
        torques: [10.0; 2],
        current: 10.0 / 6.0,
        omega: 0.0,
        angle: 0.0,
        desired: 10.0,
    };

    /// The sample in which a drift is found.
    fn found(joint: &mut Joint, samples: u32, sample: impl Fn(f64) -> Sample) -> Option<u32> {
        (0..samples).find(|&k| {
            let sample = sample(DT * f64::from(k));
            let errors = joint.filter(&sample, DT);
            joint.drifts(&errors, &sample, DT)
        })
    }

    /// Moves off at 0.1 rad/s under a torque that grows by 5 N·m/s, which the model does not know.
    fn moves(time: f64, motor: f64) -> Sample {
        Sample {
            torques: [10.0, 10.0 + 5.0 * time.min(0.6)],
            current: motor / 6.0,
            omega: 10.0,
            angle: 0.1 * time,
            ..STANDS
        }
    }

    #[test]
    fn where_it_stands_either_source_that_drifts_is_found() {
        for (source, rate) in [(0, 3.0), (0, -10.0), (1, 3.0), (1, 10.0)] {
            let drifting = |time: f64| {
                let mut sample = STANDS;
                sample.torques[source] += rate * time;
                sample
            };
            let after = found(&mut standing(), 600, drifting);
            assert!(after.is_some_and(|k| k < 500), "{source} {rate}: {after:?}");
        }
    }

    #[test]
    fn the_motor_tells_a_hand_from_a_drift() {
        // Under a hand it bears what the torsion shows, and friction; if that drifts, what the model says.
        let hand = |time| moves(time, 14.0);
        assert_eq!(found(&mut standing(), 1000, hand), None);
        let drift = |time: f64| moves(time, 14.0 + 5.0 * time.min(0.6));
        assert!(found(&mut standing(), 1000, drift).is_some());
    }

    #[test]
    fn a_joint_that_a_hand_has_moved_is_judged_where_it_stands_then() {
        let mut joint = standing();
        assert_eq!(found(&mut joint, 1000, |time| moves(time, 14.0)), None);
        let there = |time: f64| Sample {
            torques: [10.0, 13.0 + 5.0 * (time - 1.0).max(0.0)],
            angle: 0.1,
            ..STANDS
        };
        assert!(found(&mut joint, 2000, there).is_some_and(|k| k > 1000));
    }

    #[test]
    fn another_desired_torque_and_a_quick_change_begin_anew() {
        let asked = |time: f64| Sample {
            torques: [10.0, 10.0 + 5.0 * time],
            desired: 10.0 + 5.0 * time,
            ..STANDS
        };
        assert_eq!(found(&mut standing(), 600, asked), None);
        let pushed = |_: f64| Sample {
            torques: [10.0, 20.0],
            ..STANDS
        };
        assert_eq!(found(&mut standing(), 600, pushed), None);
    }
}
