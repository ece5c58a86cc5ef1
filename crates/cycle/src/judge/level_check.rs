//! Level check: a torque by torsion that neither the motor current nor F/T sensors and rigid-body model bear out.
//!
//! In: the torque by torsion, motor current and velocity, and the torque from F/T sensors and IMU. Out: the
//! joints whose torsion is wrong, whatever made it so and however slowly: a zero that a drive lost while it was
//! silent, another gear ratio, an encoder that creeps. [`TorsionCheck`](super::torsion_check) sees changes within
//! half a second; here the torques themselves are compared.
//!
//! ```text
//! e_1 = T - (k_1 i - k_2 omega - k_3 sign(omega) - J omega')     by motor current (D3)
//! e_2 = T - tau_whole_body                                       by F/T sensors and model (D 2)
//! ```
//!
//! Both must err alike. A payload, a hand or a contact that no F/T sensor measures is in `e_2` alone, as the
//! current bears it; a wrong torque constant and friction are in `e_1` alone. While the motor turns, the sign of
//! its friction is known, and less is needed; [`HandOrEncoder`] excepts more friction than configured. While the drive is
//! off the current shows nothing: then a much greater `e_2` alone does not stop anything, but forbids to enable the joint.

use robot_config::{JointParameters, Robot};
use robot_state::torque_flags;
use supervisor::time_in_a_row;

use super::motor::{HandOrEncoder, Motor};
use super::{Check, JointCheck, JointEvidence, Verdict, of_each};
use crate::estimate::valid;

/// Share of the torque limit beyond which both errors count while the motor stands: what a data sheet's stiffness, an
/// uncalibrated kinematic error and a torque constant leave together. Chosen; no experiment recorded.
const SHARE: f64 = 0.2;
/// Share of the torque limit beyond which both errors count while the motor turns. Chosen; no experiment recorded.
const SHARE_TURNING: f64 = 0.1;
/// Share of the torque itself by which a motor's torque constant may be wrong besides. Chosen; no experiment recorded.
const TORQUE_CONSTANT: f64 = 0.15;
/// Coulomb frictions by which the current may differ besides: 1 for static friction above sliding one; half of it
/// while the motor turns, as it changes with load and temperature.
const FRICTION: f64 = 1.25;
const FRICTION_TURNING: f64 = 0.5;
/// Velocity, in widths over which friction changes sign, from which on the motor turns. Chosen; no experiment recorded.
const TURNS: f64 = 5.0;
/// Share of the torque limit beyond which `e_2` alone forbids to enable a joint: an arm that lies on something has
/// its weight in it.
const SHARE_OFF: f64 = 0.5;
/// Time constant of the errors, s: that of the torque from F/T sensors and IMU, which is so late.
const FILTER_S: f64 = 0.05;
/// Time for which the errors must last, s. Chosen; no experiment recorded.
const LASTS_S: f64 = 0.1;

#[derive(Debug, Clone)]
struct Joint {
    motor: Motor,
    torque_limit: f64,
    /// Filtered `e_1` and `e_2`, N·m, and velocity, rad/s, link side; none before the first sample.
    errors: Option<[f64; 3]>,
    hand: HandOrEncoder,
    /// The last velocity, rad/s, link side.
    omega: f64,
    /// Time for which both have been too great, s, and for which the second has while the drive is off.
    over_s: f64,
    over_off_s: f64,
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    /// Torque by torsion, N·m.
    torsion: f64,
    current: f64,
    /// Motor side, rad/s.
    omega: f64,
    /// Torque from F/T sensors and IMU, N·m.
    whole_body: f64,
}

pub(super) fn make(robot: &Robot) -> Box<dyn Check> {
    of_each(robot, Joint::new)
}

impl JointCheck for Joint {
    fn judge(&mut self, j: usize, evidence: &JointEvidence<'_>, verdict: &mut Verdict<'_>) {
        let (measured, estimated) = (evidence.measured, evidence.estimated);
        // A saturated torque stands for the torque limit.
        let shown = &estimated.tau_encoder;
        let saturated = shown.flags & torque_flags::SATURATED != 0;
        let torsion = (evidence.fast.torsion).or_else(|| saturated.then_some(shown.tau));
        let usable = evidence.shows_torsion() && evidence.has_sound_current();
        let torques = torsion.zip(valid(&estimated.tau_whole_body));
        let sample = torques.filter(|_| usable).map(|(torsion, body)| Sample {
            torsion,
            current: measured.current,
            omega: measured.omega,
            whole_body: body.tau,
        });
        if self.update(sample, evidence.is_engaged(), evidence.dt) {
            verdict.distrust(j);
        }
        if self.over_off_s >= LASTS_S {
            verdict.forbid(j);
        }
    }
}

impl Joint {
    fn new(joint: &JointParameters) -> Self {
        Self {
            motor: Motor::new(joint),
            torque_limit: joint.limits.torque,
            errors: None,
            hand: HandOrEncoder::default(),
            omega: 0.0,
            over_s: 0.0,
            over_off_s: 0.0,
        }
    }

    /// Whether the torsion is wrong.
    fn update(&mut self, sample: Option<Sample>, on: bool, dt: f64) -> bool {
        let Some(sample) = sample else {
            (self.errors, self.over_s) = (None, 0.0);
            return false;
        };
        let omega = sample.omega / self.motor.gear_ratio;
        let acceleration = (omega - self.omega) / dt;
        self.omega = omega;
        let inertia = if self.errors.is_some() {
            self.motor.inertia * acceleration
        } else {
            0.0
        };
        let motor = self.motor.torque(sample.current, omega) - inertia;
        let now = [
            sample.torsion - motor,
            sample.torsion - sample.whole_body,
            omega,
        ];
        let errors = self.errors.get_or_insert(now);
        for (error, now) in errors.iter_mut().zip(now) {
            *error += dt / (dt + FILTER_S) * (now - *error);
        }
        let [by_current, by_body, turned] = *errors;
        let limit = self.torque_limit;
        let is_beyond = !on && by_body.abs() > SHARE_OFF * limit;
        time_in_a_row(&mut self.over_off_s, is_beyond, dt);
        let turns = self.motor.turns(omega, TURNS);
        let (share, friction) = if turns {
            (SHARE_TURNING, FRICTION_TURNING)
        } else {
            (SHARE, FRICTION)
        };
        let of_current =
            friction * self.motor.k_3 + TORQUE_CONSTANT * sample.torsion.abs().min(limit);
        let both = [by_current, by_body];
        let is_hand = (self.hand).is_hand(&self.motor, both, turned, of_current, dt);
        let is_wrong = on
            && !is_hand
            && by_current * by_body > 0.0
            && by_body.abs() > share * limit
            && by_current.abs() > share * limit + of_current;
        time_in_a_row(&mut self.over_s, is_wrong, dt) >= LASTS_S
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1e-3;

    /// Torque limit of 110 N·m.
    fn joint() -> Joint {
        Joint {
            motor: Motor::EXAMPLE,
            torque_limit: 110.0,
            errors: None,
            hand: HandOrEncoder::default(),
            omega: 0.0,
            over_s: 0.0,
            over_off_s: 0.0,
        }
    }

    /// A joint that bears `motor` and `body` N·m by these, and shows `torsion`.
    fn found_after(torsion: f64, motor: f64, body: f64, omega: f64) -> Option<usize> {
        let mut joint = joint();
        let sample = Sample {
            torsion,
            current: motor / 6.0,
            omega: 100.0 * omega,
            whole_body: body,
        };
        (0..2000).find(|_| joint.update(Some(sample), true, DT))
    }

    #[test]
    fn a_torsion_that_neither_current_nor_sensors_bear_out_is_found() {
        assert!(found_after(50.0, 10.0, 10.0, 0.0).is_some_and(|k| k < 300));
        assert!(found_after(-50.0, 0.0, 10.0, 0.0).is_some());
        // While it turns, half as much is enough: its friction is known.
        assert_eq!(found_after(30.0, 10.0, 10.0, 0.0), None);
        assert!(found_after(30.0, 14.0, 10.0, 0.2).is_some());
    }

    #[test]
    fn what_one_of_them_alone_contradicts_is_not() {
        assert_eq!(
            found_after(50.0, 50.0, 0.0, 0.0),
            None,
            "a payload or a hand"
        );
        assert_eq!(
            found_after(50.0, 20.0, 50.0, 0.0),
            None,
            "another torque constant"
        );
        assert_eq!(
            found_after(50.0, 90.0, 10.0, 0.0),
            None,
            "both, but not alike"
        );
    }

    #[test]
    fn while_the_drive_is_off_it_forbids_to_enable_and_stops_nothing() {
        let mut joint = joint();
        let sample = Sample {
            torsion: 100.0,
            current: 0.0,
            omega: 0.0,
            whole_body: 10.0,
        };
        assert!((0..500).all(|_| !joint.update(Some(sample), false, DT)));
        assert!(joint.over_off_s >= LASTS_S);
        let sound = Sample {
            torsion: 12.0,
            ..sample
        };
        (0..500).for_each(|_| _ = joint.update(Some(sound), false, DT));
        assert_eq!(joint.over_off_s, 0.0);
    }
}
