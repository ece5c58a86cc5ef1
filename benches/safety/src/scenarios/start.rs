//! The states of the robot in which a fault begins.

use robot_state::Mode;

use crate::robots::{Drives, Prepared};

/// State of the robot when the fault begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Start {
    /// It has just been switched on, and is enabled without an operator.
    PowerOn,
    /// It holds.
    Hold,
    /// A client has it in mode torque, with the torques that it carries.
    Torque,
    /// A client has it in mode inverse dynamics, at rest.
    InverseDynamics,
    /// The same, in motion: 0.25 rad at 0.5 Hz; of the humanoid the arms move.
    Motion,
    /// A client has let its joints go, of the humanoid those of the arms: a hand could move them.
    Passive,
    /// Mode torque-feedback motion, at rest.
    TorqueFeedback,
    /// Mode low-gain tracking with a learned torque at one joint, at rest.
    LowGain,
    /// A client has it stand on its feet: mode stand, at rest.
    Stand,
    /// A client leads the first frame by springs, at rest.
    Cartesian,
    /// The same without springs: it presses on something stiff, its force fed back.
    Pressing,
}

impl Start {
    /// The states in which a robot that is in order may be for hours.
    pub const LASTING: [Self; 9] = [
        Self::Hold,
        Self::Torque,
        Self::InverseDynamics,
        Self::Motion,
        Self::Passive,
        Self::TorqueFeedback,
        Self::LowGain,
        Self::Stand,
        Self::Cartesian,
    ];

    /// Its name on the page.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::PowerOn => "power-on",
            Self::Hold => "hold",
            Self::Torque => "torque",
            Self::InverseDynamics => "inverse dynamics",
            Self::Motion => "motion",
            Self::Passive => "passive",
            Self::TorqueFeedback => "torque feedback",
            Self::LowGain => "low gains",
            Self::Stand => "stand",
            Self::Cartesian => "Cartesian",
            Self::Pressing => "pressing",
        }
    }

    /// The client's mode.
    pub(crate) fn mode(self) -> Mode {
        match self {
            Self::PowerOn | Self::Hold => Mode::Hold,
            Self::Torque => Mode::Torque,
            Self::InverseDynamics | Self::Motion => Mode::InverseDynamics,
            Self::Passive => Mode::Passive,
            Self::TorqueFeedback => Mode::TorqueFeedbackMotion,
            Self::LowGain => Mode::LowGainTracking,
            Self::Stand => Mode::Stand,
            Self::Cartesian | Self::Pressing => Mode::Cartesian,
        }
    }

    /// Held by torques alone, or softly: it gives way to loads.
    pub(crate) fn gives_way(self) -> bool {
        matches!(
            self,
            Self::Torque
                | Self::Passive
                | Self::LowGain
                | Self::Stand
                | Self::Cartesian
                | Self::Pressing
        )
    }

    /// Whether a robot can be in that state.
    #[must_use]
    pub fn is_possible(self, prepared: &Prepared) -> bool {
        let variant = prepared.variant;
        match self {
            Self::Cartesian | Self::Pressing => prepared.clamped.is_some(),
            // By the torque without delay, which takes two encoders and drives with position loops.
            Self::TorqueFeedback | Self::LowGain => {
                variant.drives == Drives::Position && variant.robot != "hrp2-like"
            }
            // With current drives it hangs in a harness.
            Self::Stand => {
                variant.drives == Drives::Position && prepared.robot.cannot_stand().is_none()
            }
            _ => true,
        }
    }
}
