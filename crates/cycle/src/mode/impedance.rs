//! Impedance: stiffness and damping of a joint in space, which a client may change while the robot
//! moves.

use control::JointGains;
use robot_state::JointReference;

/// Stiffness, N·m/rad, and damping, N·m·s/rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Impedance {
    pub(crate) stiffness: f64,
    pub(crate) damping: f64,
}

/// Time in which an impedance changes from nothing to the configured one, s. A spring that is stretched while it
/// becomes stiffer pulls ever harder, and must not do so at once. Chosen; no experiment recorded.
const RAMP_S: f64 = 0.5;

impl Impedance {
    pub(crate) fn of(reference: &JointReference) -> Self {
        Self {
            stiffness: reference.stiffness,
            damping: reference.damping,
        }
    }

    /// The one asked for, or else the configured one.
    pub(crate) fn asked(asked: Option<Self>, configured: &JointGains) -> Self {
        asked.unwrap_or(Self {
            stiffness: configured.k_s,
            damping: configured.k_d,
        })
    }

    /// Leads it towards what is asked for, within `dt`.
    pub(crate) fn lead(&mut self, asked: Option<Self>, configured: &JointGains, dt: f64) {
        let asked = Self::asked(asked, configured);
        let share = dt / RAMP_S;
        let towards = |now: f64, asked: f64, most: f64| {
            now + (asked - now).clamp(-share * most, share * most)
        };
        self.stiffness = towards(self.stiffness, asked.stiffness, configured.k_s);
        self.damping = towards(self.damping, asked.damping, configured.k_d);
    }
}
