//! Transition: a change of mode without a step in the command, and a stop without a step in the
//! torque.

use core::f64::consts::PI;

/// Duration of a transition, s. A step in the command would be a step in torque. Chosen; no experiment recorded.
const DURATION_S: f64 = 0.3;

/// Difference between the last command of the mode before and the first of this one, fading out.
#[derive(Debug, Clone)]
pub(crate) struct Transition {
    /// The last command of the mode before, until the first of this one is known.
    last: Option<f64>,
    difference: f64,
    /// A torque that stands, from which all of the command fades in.
    held: Option<f64>,
    duration_s: f64,
    left_s: f64,
}

/// Duration within which a torque that a drive has led to in a gap of the loop becomes the desired one, s.
/// Chosen on the simulated leg, lift-gripper and humanoid: over 20 ms to 50 ms the torque steps no more than during the
/// gap. The longer it is the further the joint stays behind, and the faster it then catches up.
const RESUMING_S: f64 = 0.03;

/// Duration of the transition of a limb that yields to a contact, s: as [`RESUMING_S`].
const YIELDING_S: f64 = 0.03;

impl Transition {
    /// From the last command of the mode before.
    pub(crate) fn from(last: f64) -> Self {
        Self {
            last: Some(last),
            difference: 0.0,
            held: None,
            duration_s: DURATION_S,
            left_s: DURATION_S,
        }
    }

    /// From the last command of the mode before, in the shorter time that a contact demands.
    pub(crate) fn yielding(last: f64) -> Self {
        Self {
            duration_s: YIELDING_S,
            left_s: YIELDING_S,
            ..Self::from(last)
        }
    }

    /// From the torque to which a drive has led its joint on its own. Not only the difference to the first command
    /// fades: the links swing, and what answers their velocity at once would wind their gears up again.
    pub(crate) fn resuming(torque: f64) -> Self {
        Self {
            held: Some(torque),
            duration_s: RESUMING_S,
            left_s: RESUMING_S,
            ..Self::from(torque)
        }
    }

    /// The command of this cycle, plus the rest of the difference.
    pub(crate) fn blend(&mut self, command: f64, dt: f64) -> f64 {
        if let Some(held) = self.held {
            let gone = 1.0 - self.left_s / self.duration_s;
            let share = gone * gone * (3.0 - 2.0 * gone);
            self.left_s = (self.left_s - dt).max(0.0);
            if self.left_s <= 0.0 {
                (self.held, self.last) = (None, None);
            }
            return held + share * (command - held);
        }
        if let Some(last) = self.last.take() {
            self.difference = last - command;
        }
        let blended = command + self.difference * (self.left_s / self.duration_s);
        self.left_s = (self.left_s - dt).max(0.0);
        blended
    }
}

/// Shortest duration of a stop, s. A deceleration that begins at once is a step of the torque that inertia makes of it.
/// Chosen on the simulated robots: within this time it rises and falls such that the torque of their joints changes by
/// less than 4 % of their limits in 5 ms.
const SHORTEST_STOP_S: f64 = 0.1;

/// Shortest duration of a stop of a joint whose encoders contradict each other, s: it was led by a wrong one, and must
/// not go on as far. Half of [`SHORTEST_STOP_S`]. Chosen; no experiment recorded.
const DOUBTED_STOP_S: f64 = 0.05;

/// A set-point that goes on as the joint did, ever slower, and then stays:
/// `v = v_0 (1 + cos(pi t / T)) / 2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stop {
    velocity: f64,
    duration_s: f64,
    gone_s: f64,
}

impl Stop {
    /// From a velocity, rad/s, decelerating by at most `deceleration`, rad/s².
    pub(crate) fn from(velocity: f64, deceleration: f64) -> Self {
        Self::lasting(velocity, deceleration, SHORTEST_STOP_S)
    }

    /// From a velocity, rad/s, of a joint whose encoders contradict each other.
    pub(crate) fn doubted(velocity: f64, deceleration: f64) -> Self {
        Self::lasting(velocity, deceleration, DOUBTED_STOP_S)
    }

    fn lasting(velocity: f64, deceleration: f64, shortest: f64) -> Self {
        // The profile's greatest deceleration is pi v_0 / (2 T).
        let needed = 0.5 * PI * velocity.abs() / deceleration;
        Self {
            velocity,
            duration_s: needed.max(shortest),
            gone_s: 0.0,
        }
    }

    /// The way in the next `dt`, rad.
    pub(crate) fn way(&mut self, dt: f64) -> f64 {
        // At the middle of the period.
        let phase = ((self.gone_s + 0.5 * dt) / self.duration_s).min(1.0);
        self.gone_s = (self.gone_s + dt).min(self.duration_s);
        0.5 * self.velocity * (1.0 + (PI * phase).cos()) * dt
    }
}
