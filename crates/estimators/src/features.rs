//! Inputs of the learned estimators.

use crate::joint::JointSample;

/// Inputs of the largest set.
pub const MAX_FEATURES: usize = 9;

/// A set of inputs of a learned estimator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FeatureSet {
    /// `i, sin theta, cos theta, sin 2 theta, cos 2 theta, q, omega, dq, torsion`: theta grows
    /// over many turns, so its phase is the input (with the harmonic of a wave generator's two
    /// lobes), not its value.
    #[default]
    Phase,
    /// `i, theta, q, omega, dq, torsion`, as S 28 has them.
    Published,
    /// `q, theta, i` as G has them, theta by its phase: `q, sin theta, cos theta, i`.
    Position,
    /// `torsion, i, dq`: for residuals that do not depend on the place.
    Load,
    /// Position, velocity and acceleration of a joint and of its two neighbours: for a feed-forward of the
    /// motion. A joint's sample does not have them.
    Motion,
}

impl FeatureSet {
    /// Number of inputs of the set.
    #[must_use]
    pub const fn len(self) -> usize {
        match self {
            Self::Phase | Self::Motion => 9,
            Self::Published => 6,
            Self::Position => 4,
            Self::Load => 3,
        }
    }

    /// False: every set has inputs.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        false
    }

    /// The inputs; `current` stands for the sample's own where it has been filtered.
    #[must_use]
    pub fn of(self, s: &JointSample, current: f64, gear_ratio: f64) -> [f64; MAX_FEATURES] {
        let torsion = s.theta / gear_ratio - s.q;
        let mut x = [0.0; MAX_FEATURES];
        match self {
            Self::Phase => {
                let (sin, cos) = s.theta.sin_cos();
                let (sin2, cos2) = (2.0 * sin * cos, cos * cos - sin * sin);
                x = [current, sin, cos, sin2, cos2, s.q, s.omega, s.dq, torsion];
            }
            Self::Published => {
                x[..6].copy_from_slice(&[current, s.theta, s.q, s.omega, s.dq, torsion]);
            }
            Self::Position => {
                let (sin, cos) = s.theta.sin_cos();
                x[..4].copy_from_slice(&[s.q, sin, cos, current]);
            }
            Self::Load => x[..3].copy_from_slice(&[torsion, current, s.dq]),
            Self::Motion => {}
        }
        x
    }
}
