//! Every fit: a row each.

use super::{Fitted, feeds_forward};
use crate::inputs::LogKind;
use crate::learned::Progress;
use crate::log::LogRow;
use crate::record::Record;
use core::fmt;
use problem::Problem;

/// One fit.
pub struct Step {
    /// Its name, also on the command line.
    pub name: &'static str,
    /// What it fits, for a user.
    pub about: &'static str,
    /// The log it is fitted to.
    pub log: LogKind,
    /// Its share of the time that all take, 1.
    pub(super) share: f64,
    /// It makes more of the gear than its stiffness, without priors of its own.
    pub(super) needs_stiffness: bool,
    /// The other fits do not need it.
    failure: Failure,
    /// Whether a log has what it takes.
    applies: fn(&[LogRow]) -> bool,
    pub(super) fit: Fit,
}

type Fit = fn(&mut Fitted, Record, &[LogRow], Progress<'_>) -> Result<(), Problem>;

/// What follows where a step cannot be fitted.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Failure {
    /// Nothing is fitted.
    OfAll,
    /// The same after an unloaded turn; without one it is noted.
    OfAllAfterTurn,
    /// It is noted.
    Noted,
}

impl fmt::Debug for Step {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl Step {
    /// Kinematic error, from an unloaded turn each way; all others need loaded motion.
    pub const KINEMATIC_ERROR: Self = Self {
        log: LogKind::NoLoad,
        ..Self::new(
            "kinematic-error",
            "Kinematic error, from one unloaded output turn each way",
            0.01,
            |fitted, record, _, _| fitted.kinematic_error(&record),
        )
    };
    /// Motor friction and the constants of the current-based torque (D3).
    pub const CURRENT: Self = Self {
        log: LogKind::Current,
        ..Self::new(
            "current",
            "Motor friction and the constants of the current-based torque",
            0.01,
            |fitted, record, _, _| fitted.current(&record),
        )
    };
    /// The feed-forward as a source, of logs that have it.
    pub const FEED_FORWARD: Self = Self {
        log: LogKind::Current,
        applies: feeds_forward,
        ..Self::new(
            "feed-forward",
            "Feed-forward (column tau_feedforward) as a further source",
            0.0,
            |fitted, record, _, _| fitted.feed_forward(&record),
        )
    };
    /// Z's compliance, and the skew between the encoders.
    pub const COMPLIANCE: Self = Self {
        failure: Failure::OfAllAfterTurn,
        ..Self::new(
            "compliance",
            "Compliance of the harmonic drive (Zhang et al.), and the skew between the encoders",
            0.05,
            |fitted, record, rows, _| fitted.compliance(&record, rows),
        )
    };
    /// Gear with slipping springs.
    pub const HYSTERESIS: Self = Self::new(
        "hysteresis",
        "Gear model with slipping springs (hysteresis)",
        0.1,
        |fitted, record, rows, _| {
            // It makes its own, and two of a long log take much memory.
            drop(record);
            fitted.hysteresis(rows)
        },
    );
    /// S's deformation model.
    pub const DEFORMATION: Self = Self::new(
        "deformation",
        "Piecewise deformation model (Song et al.)",
        0.01,
        |fitted, record, _, _| fitted.deformation(&record),
    )
    .beyond_stiffness();
    /// Noise of the Kalman filters (U).
    pub const KALMAN: Self = Self::new(
        "kalman",
        "Noise of the Kalman filters; needs the compliance and the hysteresis",
        0.15,
        |fitted, record, _, _| fitted.kalman(&record),
    )
    .beyond_stiffness();
    /// S's network.
    pub const NETWORK: Self = Self::new(
        "network",
        "Back-propagation network (Song et al.)",
        0.45,
        |fitted, record, _, progress| fitted.network(&record, progress),
    )
    .beyond_stiffness();
    /// Local Gaussian processes (G) on the compliance model and on the gear with slipping springs.
    pub const LOCAL_GP: Self = Self::new(
        "local-gp",
        "Local Gaussian processes; need the compliance and the hysteresis",
        0.2,
        |fitted, record, _, progress| fitted.local_gp(&record, progress),
    )
    .beyond_stiffness();
    /// Errors of every source.
    pub const FUSION: Self = Self::new(
        "fusion",
        "Error of every source, for the fusion; fit it last",
        0.02,
        |fitted, record, rows, _| fitted.errors_of_sources(&record, rows),
    );

    /// Every step in its order.
    pub const ALL: [Self; 10] = [
        Self::KINEMATIC_ERROR,
        Self::CURRENT,
        Self::FEED_FORWARD,
        Self::COMPLIANCE,
        Self::HYSTERESIS,
        Self::DEFORMATION,
        Self::KALMAN,
        Self::NETWORK,
        Self::LOCAL_GP,
        Self::FUSION,
    ];

    const fn new(name: &'static str, about: &'static str, share: f64, fit: Fit) -> Self {
        Self {
            name,
            about,
            log: LogKind::Training,
            share,
            needs_stiffness: false,
            failure: Failure::OfAll,
            applies: |_| true,
            fit,
        }
    }

    const fn beyond_stiffness(self) -> Self {
        Self {
            needs_stiffness: true,
            failure: Failure::Noted,
            ..self
        }
    }

    /// Whether a log has what this step takes.
    #[must_use]
    pub fn applies_to(&self, rows: &[LogRow]) -> bool {
        (self.applies)(rows)
    }

    /// Whether the other steps are fitted without this one, if it cannot be; `turned`: there is an unloaded turn.
    pub(super) fn may_fail(&self, turned: bool) -> bool {
        match self.failure {
            Failure::OfAll => false,
            Failure::OfAllAfterTurn => !turned,
            Failure::Noted => true,
        }
    }
}
