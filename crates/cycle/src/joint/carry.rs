//! Carry: how a drive that takes currents holds its joint, and stops it in a fault.
//!
//! ```text
//!              at rest, encoders agree
//!   damped ──────────────────────────────► anchored
//!     ▲  ◄──────────────────────────────      ▲
//!     │        encoders contradict            │
//!   a fault, or a sensor failed,         hold, stop
//!   in a client's mode
//! ```
//!
//! No single sensor can move the joint. The *weight* is that of the model where both encoders showed the joint last,
//! under the [loads](crate::estimate::GravityLoad) of some time before, so of before a sensor failed; from then on no
//! F/T sensor and no IMU is used. An *anchored* joint is held by a spring, damping and an integral of the angle by
//! which **both** encoders show it away from where it was anchored: the smaller of both angles, none where they have
//! opposite directions. The same holds for velocities, so that damping takes energy from the joint whichever encoder is
//! wrong. A *damped* joint carries its weight; where it moves on the way of that torque after the time for stopping,
//! the torque is what moves it, and fades out. Where its encoders are not trusted, the sign of both may be what is
//! wrong, and damping would drive the joint: it is braked against the direction that they showed before, and one that
//! stood by no more than a share of its torque; else no longer.

use control::margins::INTEGRAL_TIMES;
use robot_state::JointCommanded;
use supervisor::Motion;

use super::transition::Stop;

/// Velocity below which a damped joint is anchored where it is, over that of rest. Chosen; no experiment recorded.
const SLOW: f64 = 2.5;
/// Time for stopping a damped joint, and time in which a torque fades out that moves the joint afterwards, s
/// (docs/safety-promises.md, 19). Chosen; no experiment recorded.
const STOPPING_TIME: f64 = 0.3;
/// Time in which a change of torque of the size of the limit is led over where no fault presses, s: that of a change of
/// mode (`DURATION_S` of transition.rs).
const LEAD_OVER_TIME: f64 = 0.3;
/// Periods without a sample from which on velocities are not those of the joint, and the cycles until
/// the velocity filter's window has nothing of them any more.
const BRIDGED: u32 = 5;
const WINDOW: u32 = 20;
/// Share of the torque limit by which a joint is braked that stood when its encoders were trusted last.
/// Chosen on the simulated test joint, with ten lies of an encoder in hold and in motion
/// (`crates/cycle/tests/current.rs`).
const DOUBTED_SHARE: f64 = 0.15;

/// Torque that the joint is held with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CarryParameters {
    /// K_s: spring, N·m/rad.
    pub(super) k_s: f64,
    /// K_d: its damping, N·m·s/rad.
    pub(super) k_d: f64,
    /// Damping that brakes as hard as the delay of the velocity allows, N·m·s/rad.
    pub(super) damping: f64,
    /// K1: joint torque per current, N·m/A.
    pub(super) k_1: f64,
    /// Greatest torque, N·m.
    pub(super) torque: f64,
    /// |dq| below which the joint counts as at rest, rad/s.
    pub(super) rest: f64,
}

/// Where the joint is held, by both encoders, rad; how fast that point still moves, rad/s; and how it
/// comes to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Anchor {
    q: f64,
    theta: f64,
    velocity: f64,
    stop: Stop,
}

/// A joint that is held or stopped.
#[derive(Debug, Clone)]
pub(super) struct Carry {
    /// Anchor of the spring; none while the joint is damped.
    anchor: Option<Anchor>,
    /// The weight when the state began, N·m.
    weight: f64,
    /// Integral of the spring's torque, N·m.
    integral: f64,
    /// Share of weight and integral that is left, 1.
    share: f64,
    /// Time for which it has been damped, s.
    damped_s: f64,
    /// Torque of the command before this state, until it is led over, N·m.
    before: Option<f64>,
    /// Torque left to be led over, N·m.
    led_over: f64,
    /// Cycles for which velocities are not known after a gap in the samples.
    blind: u32,
    /// Where the joint moved to when its encoders were trusted last, 1 or -1; 0: it stood.
    direction: Option<f64>,
    /// The encoders show a motion that braking cannot have led to.
    misled: bool,
    /// The joint has no anchor any more: its spring has made it swing.
    is_loose: bool,
}

impl Carry {
    /// Holds where the joint comes to rest, going on from the torque `before` (N·m) and decelerating
    /// by at most `deceleration` (rad/s²).
    pub(super) fn hold(motion: &Motion, weight: f64, before: f64, deceleration: f64) -> Self {
        Self {
            anchor: Some(Anchor::at(motion, motion.dq, deceleration)),
            before: Some(before),
            ..Self::stop(weight)
        }
    }

    /// Stops the joint at once.
    pub(super) fn stop(weight: f64) -> Self {
        Self {
            anchor: None,
            weight,
            integral: 0.0,
            share: 1.0,
            damped_s: 0.0,
            before: None,
            led_over: 0.0,
            blind: 0,
            direction: None,
            misled: false,
            is_loose: false,
        }
    }

    /// Torque of the integral, N·m.
    pub(super) fn integral(&self) -> f64 {
        self.share * self.integral
    }

    /// Takes the spring away that makes the joint swing: from now on it is damped alone, under its weight.
    pub(super) fn let_loose(&mut self) {
        self.is_loose = true;
        self.integral = 0.0;
        self.anchor = None;
    }

    /// Periods before this cycle have no sample: filters have bridged them by what was before.
    pub(super) fn skip(&mut self, periods: u32) {
        if periods >= BRIDGED {
            self.blind = WINDOW;
        }
    }

    /// The joint is being stopped: its torque takes energy from it.
    pub(super) fn is_damped(&self) -> bool {
        self.anchor.is_none()
    }

    /// The weight that it carries, N·m.
    pub(super) fn weight(&self) -> f64 {
        self.share * (self.weight + self.integral)
    }

    /// The current before limits, A. `velocities`: by each encoder, rad/s, link side; `trusted`: the
    /// encoders do not contradict each other.
    pub(super) fn update(
        &mut self,
        parameters: &CarryParameters,
        (motion, velocities): (&Motion, [f64; 2]),
        trusted: bool,
        dt: f64,
        commanded: &mut JointCommanded,
    ) -> f64 {
        self.settle(motion, trusted, parameters.rest);
        if trusted || self.direction.is_none() {
            let moves = motion.dq.abs() > SLOW * parameters.rest;
            self.direction = Some(if moves { motion.dq.signum() } else { 0.0 });
            self.misled = false;
        }
        let (position, velocity) = match &mut self.anchor {
            Some(anchor) => {
                let p = parameters;
                anchor.advance(dt);
                let away = smaller(anchor.q - motion.q, anchor.theta - motion.theta);
                if anchor.velocity == 0.0 && p.k_d > 0.0 {
                    let rate = p.k_s * p.k_s / (INTEGRAL_TIMES * p.k_d);
                    let most = p.torque;
                    self.integral = (self.integral + rate * away * dt).clamp(-most, most);
                }
                let [link, motor] = velocities.map(|dq| anchor.velocity - dq);
                (p.k_s * away, p.k_d * smaller(link, motor))
            }
            None => {
                self.damped_s += dt;
                let moves = self.weight() * motion.dq > 0.0 && motion.dq.abs() > parameters.rest;
                if moves && self.damped_s > STOPPING_TIME {
                    self.share = (self.share - dt / STOPPING_TIME).max(0.0);
                }
                (0.0, self.braking(parameters, motion.dq, trusted))
            }
        };
        let (position, velocity) = match self.blind {
            0 => (position, velocity),
            _ => (0.0, 0.0),
        };
        self.blind = self.blind.saturating_sub(1);
        let torque = self.weight() + position + velocity;
        if self.anchor.is_none() {
            (self.before, self.led_over) = (None, 0.0);
        }
        let led_over = self.lead_over(torque, parameters.torque, dt);
        let k_1 = parameters.k_1;
        *commanded = JointCommanded {
            tau_d: torque,
            tau_star: torque,
            feedforward_torque: (self.weight() + led_over) / k_1,
            feedback_position: position / k_1,
            feedback_velocity: velocity / k_1,
            ..JointCommanded::default()
        };
        (torque + led_over) / k_1
    }

    /// Torque of the damping, N·m.
    fn braking(&mut self, parameters: &CarryParameters, dq: f64, trusted: bool) -> f64 {
        let torque = -parameters.damping * dq;
        self.misled |= match self.direction {
            _ if trusted => false,
            Some(0.0) | None => torque.abs() > DOUBTED_SHARE * parameters.torque,
            Some(direction) => dq * direction < 0.0,
        };
        if self.misled { 0.0 } else { torque }
    }

    /// Anchors a joint that has come to rest, and damps one whose encoders contradict each other.
    fn settle(&mut self, motion: &Motion, trusted: bool, rest: f64) {
        if !trusted || self.is_loose {
            self.anchor = None;
        } else if self.anchor.is_none() && motion.dq.abs() < SLOW * rest && self.damped_s > 0.0 {
            self.anchor = Some(Anchor::at(motion, 0.0, f64::INFINITY));
            self.damped_s = 0.0;
        }
    }

    /// The rest of the difference to the command before this state.
    fn lead_over(&mut self, torque: f64, limit: f64, dt: f64) -> f64 {
        if let Some(before) = self.before.take() {
            self.led_over = before - torque;
        }
        let change = limit * dt / LEAD_OVER_TIME;
        self.led_over -= self.led_over.clamp(-change, change);
        self.led_over
    }
}

impl Anchor {
    /// Where the joint is, going on at this velocity until it comes to rest.
    fn at(motion: &Motion, velocity: f64, deceleration: f64) -> Self {
        Self {
            q: motion.q,
            theta: motion.theta,
            velocity,
            stop: Stop::from(velocity, deceleration),
        }
    }

    fn advance(&mut self, dt: f64) {
        let way = self.stop.way(dt);
        self.velocity = way / dt;
        self.q += way;
        self.theta += way;
    }
}

/// The smaller of two signed values; zero where they have opposite signs or one is no number.
pub(super) fn smaller(a: f64, b: f64) -> f64 {
    if a * b > 0.0 {
        a.abs().min(b.abs()).copysign(a)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: CarryParameters = CarryParameters {
        k_s: 500.0,
        k_d: 5.0,
        damping: 25.0,
        k_1: 10.0,
        torque: 100.0,
        rest: 0.02,
    };

    /// Torque of a joint that moves at `dq`, rad/s, by both encoders.
    fn torque(carry: &mut Carry, dq: f64, trusted: bool) -> f64 {
        let motion = Motion {
            q: 0.3,
            theta: 0.3,
            dq,
            weight: 0.0,
        };
        let moved = (&motion, [dq, dq]);
        let current = carry.update(
            &PARAMETERS,
            moved,
            trusted,
            1e-3,
            &mut JointCommanded::default(),
        );
        PARAMETERS.k_1 * current
    }

    #[test]
    fn encoders_that_are_not_trusted_brake_only_against_the_motion_before() {
        let mut moving = Carry::stop(0.0);
        assert_eq!(torque(&mut moving, 1.0, true), -25.0);
        assert_eq!(torque(&mut moving, 0.5, false), -12.5);
        // Braked, it cannot turn round: their signs have changed.
        assert_eq!(torque(&mut moving, -0.5, false), 0.0);
        assert_eq!(torque(&mut moving, 0.5, false), 0.0);
        assert_eq!(torque(&mut moving, 0.5, true), -12.5);
    }

    #[test]
    fn a_joint_that_stood_is_braked_a_little_by_encoders_that_are_not_trusted() {
        let mut standing = Carry::stop(0.0);
        assert_eq!(torque(&mut standing, 0.0, true), 0.0);
        assert_eq!(torque(&mut standing, -0.4, false), 10.0);
        assert_eq!(torque(&mut standing, -0.8, false), 0.0);
        assert_eq!(torque(&mut standing, -0.4, false), 0.0);
    }
}
