//! Margins of the predictive law: how wrong the model may be, and how late, before a joint rings.
//!
//! The loop is linear: gear of constant stiffness, no friction but viscous, drive, bus and law with
//! its own code ([`crate::predictive`]). It is opened at the motor's torque, inside the drive: there
//! everything acts through one number, and a gain or a phase there stands for errors of motor, drive,
//! inertia and delay alike. The law runs once in a period, the plant in `SUBSTEPS` steps; the
//! response to a sine is that of the whole period, averaged over its steps.

mod design;
mod hold;
mod lifted;
mod motor_side;
mod response;
mod standing;

pub use design::choose_design;
pub use hold::{HoldLoop, INTEGRAL_TIMES};
pub use motor_side::MotorSideLoop;
pub use response::{ClosedLoop, Point};
pub use standing::{StandingMargins, pendulum, standing};

use crate::predictive::LawParameters;
use lifted::Lifted;

/// Load of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Load {
    /// The link cannot move.
    Blocked,
    /// The link cannot move, and the rotor hangs in its friction: bristles twice as stiff as the
    /// gear, or as the law knows them, if that is more.
    Stuck,
    /// The link moves freely.
    Free,
    /// The link moves freely with a fifth of its inertia.
    Light,
    /// The link moves freely with five times its inertia.
    Heavy,
    /// The link touches a spring of a third of the gear's stiffness, which damps by a millisecond.
    Spring,
}

impl Load {
    /// The loads by which the law is judged.
    pub const ALL: [Self; 5] = [
        Self::Blocked,
        Self::Stuck,
        Self::Free,
        Self::Light,
        Self::Spring,
    ];
    /// The loads by which stiffness and damping in space are judged.
    pub const MOVING: [Self; 3] = [Self::Free, Self::Light, Self::Heavy];

    /// Inertia of the link over the joint's own.
    fn inertia_share(self) -> f64 {
        match self {
            Self::Light => 0.2,
            Self::Heavy => 5.0,
            _ => 1.0,
        }
    }

    /// Name of the load.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Blocked => "blocked",
            Self::Stuck => "stuck",
            Self::Free => "free",
            Self::Light => "light",
            Self::Heavy => "heavy",
            Self::Spring => "spring",
        }
    }
}

/// Stiffness of a stuck rotor's bristles over that of the gear: the own plant's are once to twice as stiff.
const STUCK: f64 = 2.0;

/// A joint with its drive and its law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointLoop {
    /// The joint's parameters as the law has them.
    pub law: LawParameters,
    /// The joint's true parameters. Its `design` is not used.
    pub truth: LawParameters,
    /// Part of the truth's delay that is within the drive, s.
    pub drive_lag: f64,
    /// Inertia of the link, kg·m².
    pub link_inertia: f64,
    /// Damping of the gear, as a share of that which is critical for the rotor.
    pub gear_damping: f64,
    /// Torque that the joint carries, N·m: it determines the gear's stiffness.
    pub torque: f64,
    /// Torque measured per torque.
    pub torque_gain: f64,
    /// K_s: stiffness in space, N·m/rad.
    pub stiffness: f64,
    /// K_d: damping in space, N·m·s/rad.
    pub damping: f64,
    /// Bandwidth in which the carried torque is fed back (Z IV-B), rad/s; 0: it is not.
    pub load_follow: f64,
}

impl JointLoop {
    /// Stiffness of the friction in which a stuck rotor hangs, N·m/rad, with this one of the gear.
    fn stick(&self, gear: f64) -> f64 {
        self.truth.friction.stiffness.max(STUCK * gear)
    }

    /// A joint that is as the law takes it, without stiffness in space.
    #[must_use]
    pub fn nominal(law: LawParameters, drive_lag: f64, link_inertia: f64) -> Self {
        Self {
            law,
            truth: law,
            drive_lag,
            link_inertia,
            gear_damping: 0.02,
            torque: 0.15 * law.torque_limit,
            torque_gain: 1.0,
            stiffness: 0.0,
            damping: 0.0,
            load_follow: 0.0,
        }
    }

    /// The loop with a load.
    #[must_use]
    pub fn with(&self, load: Load) -> ClosedLoop {
        ClosedLoop::new(Lifted::new(self, load))
    }
}

/// Distances of a loop from instability.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margins {
    /// Phase that turns the loop unstable, rad; zero if it is unstable.
    pub phase: f64,
    /// Gain above 1 that turns the loop unstable; 1 if it is unstable.
    pub gain: f64,
    /// The inverse of the gain below 1 that turns the loop unstable; 1 if it is unstable, infinite if
    /// less gain does no harm.
    pub reduction: f64,
}

impl Margins {
    /// Margins of an unstable loop: none.
    pub const NONE: Self = Self {
        phase: 0.0,
        gain: 1.0,
        reduction: 1.0,
    };

    /// The lesser of both, each by itself.
    #[must_use]
    pub fn least(self, other: Self) -> Self {
        Self {
            phase: self.phase.min(other.phase),
            gain: self.gain.min(other.gain),
            reduction: self.reduction.min(other.reduction),
        }
    }

    /// Phase margin, degrees, and gain margin, dB.
    #[must_use]
    pub fn in_degrees_and_db(&self) -> (f64, f64) {
        (self.phase.to_degrees(), 20.0 * self.gain.log10())
    }

    /// Phase and gain are at least these; a reduction is not judged.
    #[must_use]
    pub fn keeps(&self, needed: &Self) -> bool {
        self.phase >= needed.phase && self.gain >= needed.gain
    }
}

/// Margins below which a joint is refused: 30 degrees and 6 dB.
pub const NEEDED: Margins = Margins {
    phase: 30.0 * std::f64::consts::PI / 180.0,
    gain: 1.995_262_314_968_879_5,
    reduction: 1.0,
};

/// The least margins over some loads, each with the load at which it occurs.
#[must_use]
pub fn least_margins(joint: &JointLoop, loads: &[Load]) -> (Margins, [Load; 2]) {
    least(loads, |load| joint.with(load).margins())
}

fn least(loads: &[Load], of: impl Fn(Load) -> Margins) -> (Margins, [Load; 2]) {
    let mut least = Margins {
        phase: f64::INFINITY,
        gain: f64::INFINITY,
        reduction: f64::INFINITY,
    };
    let mut at = [Load::Blocked; 2];
    for &load in loads {
        let margins = of(load);
        if margins.phase < least.phase {
            at[0] = load;
        }
        if margins.gain < least.gain {
            at[1] = load;
        }
        least = least.least(margins);
    }
    (least, at)
}

/// The largest stiffness in space, N·m/rad, with a damping of `ratio` (s) times that stiffness, at
/// which the moving loads keep these margins; zero if there is none.
#[must_use]
pub fn largest_stiffness(joint: &JointLoop, ratio: f64, needed: Margins) -> f64 {
    let (drive, gear) = (joint.law.drive_stiffness(), joint.law.gear.at(joint.torque));
    let scale = if drive > 0.0 {
        drive * gear / (drive + gear)
    } else {
        gear
    };
    let keeps = |stiffness: f64| {
        let tried = JointLoop {
            stiffness,
            damping: ratio * stiffness,
            ..*joint
        };
        all_keep(&Load::MOVING, needed, |load| tried.with(load).margins())
    };
    largest(scale * 0.05, scale * 2.0, keeps)
}

/// The largest damping in space, N·m·s/rad, without stiffness, at which the moving loads keep these
/// margins; zero if there is none.
#[must_use]
pub fn largest_damping(joint: &JointLoop, needed: Margins) -> f64 {
    let (_, scale) = joint.law.feedback(joint.law.gear.at(joint.torque));
    let keeps = |damping: f64| {
        let tried = JointLoop { damping, ..*joint };
        all_keep(&Load::MOVING, needed, |load| tried.with(load).margins())
    };
    largest(scale * 0.01, scale * 1.0, keeps)
}

/// Every load keeps these margins.
fn all_keep(loads: &[Load], needed: Margins, of: impl Fn(Load) -> Margins) -> bool {
    loads.iter().all(|&load| of(load).keeps(&needed))
}

/// The largest number between two that passes, by bisection of its logarithm; zero if the least
/// fails.
fn largest(least: f64, most: f64, passes: impl Fn(f64) -> bool) -> f64 {
    if !passes(least) {
        return 0.0;
    }
    if passes(most) {
        return most;
    }
    let (mut low, mut high) = (least, most);
    for _ in 0..6 {
        let middle = (low * high).sqrt();
        if passes(middle) {
            low = middle
        } else {
            high = middle
        }
    }
    low
}
