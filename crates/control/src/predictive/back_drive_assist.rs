//! Help for a hand that turns a joint round: a part of the law that acts on evidence.
//!
//! The law's own estimates of the link's velocity are slow, because quick ones cost margins, and turn an encoder's
//! error into torque. A hand feels what they are late by. Quicker estimates would have the motor make another torque,
//! `m_q`; a part of it is added, as far as the joint's torque shows that somebody moves the link:
//!
//! ```text
//! m_q  = (D - d_d) (dq_2 - dq) + d_d (slow_2 - slow)
//! help = s_h least(m_q, w - T+, w - (T+ - d))        of one sign, else zero
//! ```
//!
//! `T+` is the torque by the gear's torsion, `T+ - d` the one that the rotor's motion shows. Encoders that drift as one
//! make a joint drive its link, where a hand has the link drive the joint: `w - T+` has the other sign. An encoder that
//! drifts alone shows in the torsion and not in the rotor's motion. A blocked link has no `m_q`, a free one a `w - T+`
//! against it.

use super::observers::Link;
use super::parameters::LawParameters;

/// The link's velocity by quicker estimates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BackDriveAssist {
    link: Link,
    /// Velocity that the drive's damping would go along with, rad/s.
    slow_velocity: f64,
    follow_share: f64,
}

impl BackDriveAssist {
    /// Makes the assist; none for a design without help.
    pub(super) fn new(p: &LawParameters) -> Option<Self> {
        let helps = p.design.assist > 0.0 && p.drive_stiffness() > 0.0;
        helps.then(|| Self {
            link: Link::with_bandwidth(p.design.assist_bandwidth, p.sample_period),
            slow_velocity: 0.0,
            follow_share: 1.0 - (-p.design.assist_bandwidth * p.sample_period).exp(),
        })
    }

    pub(super) fn start(&mut self, q: f64) {
        self.link.start(q);
        self.slow_velocity = 0.0;
    }

    /// Takes over the law's own estimates: an assist that is no quicker than these has nothing to help with.
    pub(super) fn join(&mut self, link: &Link, slow_velocity: f64) {
        self.link.set_state(link.state());
        self.slow_velocity = slow_velocity;
    }

    pub(super) fn advance(&mut self) {
        self.link.advance();
    }

    pub(super) fn correct(&mut self, q: f64) {
        self.link.correct(q, None);
    }

    /// After each period.
    pub(super) fn follow(&mut self) {
        self.slow_velocity += self.follow_share * (self.link.velocity() - self.slow_velocity);
    }

    /// A desired velocity changes by so much, rad/s.
    pub(super) fn lead(&mut self, change: f64) {
        self.slow_velocity += change;
    }

    /// m_q: further torque of the motor by these estimates, N·m, with the law's own ones and both dampings.
    pub(super) fn further_torque(
        &self,
        link: &Link,
        slow_velocity: f64,
        [damping, own_damping]: [f64; 2],
    ) -> f64 {
        (damping - own_damping) * (self.link.velocity() - link.velocity())
            + own_damping * (self.slow_velocity - slow_velocity)
    }

    pub(super) fn is_finite(&self) -> bool {
        self.link.is_finite() && self.slow_velocity.is_finite()
    }

    pub(super) fn state(&self) -> [f64; Self::STATES] {
        let [q, dq, ddq] = self.link.state();
        [q, dq, ddq, self.slow_velocity]
    }

    pub(super) fn set_state(&mut self, [q, dq, ddq, slow]: [f64; Self::STATES]) {
        self.link.set_state([q, dq, ddq]);
        self.slow_velocity = slow;
    }

    /// Numbers of the state.
    pub(super) const STATES: usize = 4;
}

/// The value nearest to zero where all have one sign, else zero.
pub(super) fn least<const N: usize>(values: [f64; N]) -> f64 {
    let lowest = values.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    lowest.max(0.0) + highest.min(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn witnesses_that_disagree_let_nothing_through() {
        assert_eq!(least([2.0, 1.0, 3.0]), 1.0);
        assert_eq!(least([-2.0, -1.0, -3.0]), -1.0);
        assert_eq!(least([2.0, -1.0, 3.0]), 0.0);
        assert_eq!(least([2.0, 0.0, 3.0]), 0.0);
    }
}
