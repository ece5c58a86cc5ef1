//! The torque that a joint carries, fed back to its motor: motion with joint torque feedback (Z IV-B).
//!
//! ```text
//! c''   = w_c² (tau - c) - 1.4 w_c c'                      c: the carried torque
//! tau_d = c + K_s (q_d - q) + K_d (dq_d - dq)
//! ```
//!
//! Whatever the link carries (weight, payload, inertia) reaches the motor by its own measurement, and no
//! model of the links is needed: the joint is a controller of its own, as in the distributed control that Z
//! applies. With a torque that follows `tau_d` this is `(K_s e + K_d e') (1 + w_c² / (s (s + 1.4 w_c)))`: an
//! integral action below `w_c`, which cannot wind up, since it integrates what the joint really bears and
//! not what was asked for.
//!
//! All of the torque at once would be a feedback of gain 1 around the joint, hence the low-pass. It is of second
//! order: at the frequency `w` at which a link swings on `K_s`, one of first order takes `w_c / w` of `K_s` from
//! the damping, this one `1.4 (w_c / w)³`.

use crate::JointGains;
use crate::predictive::LawParameters;
use std::f64::consts::TAU;

/// The carried torque of one joint.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CarriedTorque {
    value: f64,
    rate: f64,
}

/// Twice the low-pass's damping ratio of 0.7: Z Section IV-B, as the equation below.
const DAMPING: f64 = 1.4;

impl CarriedTorque {
    /// A joint that carries this torque, N·m.
    #[must_use]
    pub fn at(torque: f64) -> Self {
        Self {
            value: torque,
            rate: 0.0,
        }
    }

    /// c: the carried torque, N·m.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.value
    }

    /// State of the low-pass: c and c'.
    pub(crate) fn state(&self) -> [f64; 2] {
        [self.value, self.rate]
    }

    /// A low-pass with this state: c and c'.
    pub(crate) fn with_state([value, rate]: [f64; 2]) -> Self {
        Self { value, rate }
    }

    /// Takes the torque of a cycle, N·m; `follow`: w_c, rad/s, `dt` in s. Returns c.
    //= Z Section IV-B: c'' = w_c^2 (tau - c) - 1.4 w_c c', tau_d = c + K_s (q_d - q) + K_d (dq_d - dq)
    pub fn follow(&mut self, torque: f64, follow: f64, dt: f64) -> f64 {
        let curvature = follow * follow * (torque - self.value) - DAMPING * follow * self.rate;
        self.rate += dt * curvature;
        self.value += dt * self.rate;
        self.value
    }
}

/// Share of the damping that the carried torque may take; the rest stays for the impedance.
/// Chosen; no experiment recorded. `crates/control/tests/margins` shows what margins it leaves.
const OF_DAMPING: f64 = 0.5;
/// Inertia of the heaviest link, over that of the stretched-out robot, by which margins in space are judged
/// (docs/control-law.md, Margins).
const HEAVIEST: f64 = 5.0;
/// Largest w_c over the frequency at which the link swings on `K_s`: at one half the low-pass passes a quarter of a
/// swing. Chosen; no experiment recorded.
const OF_SWING: f64 = 0.5;
/// Largest w_c, rad/s. Chosen; no experiment recorded.
const LARGEST: f64 = TAU * 5.0;
/// Part of `K_d / K_s` that is left at least when the torque's lag has taken its own. Chosen; no experiment recorded.
const LEAST_LEFT: f64 = 0.1;

/// w_c for a joint with these gains in space, this law and this inertia of its link (kg·m²), rad/s; 0 without
/// stiffness.
#[must_use]
pub fn largest_follow(gains: &JointGains, law: &LawParameters, inertia: f64) -> f64 {
    if gains.k_s <= 0.0 || inertia <= 0.0 {
        return 0.0;
    }
    let swing = (gains.k_s / (HEAVIEST * inertia)).sqrt();
    let ratio = gains.k_d / gains.k_s;
    // A torque that is late turns stiffness into negative damping.
    let damped = (ratio - law.reference_lag()).max(LEAST_LEFT * ratio);
    let bound = (OF_DAMPING / DAMPING * swing.powi(4) * damped).cbrt();
    bound.min(OF_SWING * swing).min(LARGEST)
}
