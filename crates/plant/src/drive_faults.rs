//! What is wrong with a drive itself. Faults enter here, where they arise: the drive's own loop, its frames
//! and so the daemon see the same.

use std::f64::consts::TAU;

/// An encoder that errs: it shows `angle + offset`, the offset growing at a rate, or what it showed last.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EncoderFault {
    /// Offset of the shown angle, rad.
    pub offset: f64,
    /// Rate at which the offset grows, rad/s.
    pub rate: f64,
    /// The angle that it shows whatever the true one is, rad; none: it moves.
    pub stuck: Option<f64>,
}

impl EncoderFault {
    /// The angle that is shown for the true one, rad.
    #[must_use]
    pub fn shown(&self, angle: f64) -> f64 {
        self.stuck.unwrap_or(angle + self.offset)
    }

    fn advance(&mut self, dt: f64) {
        self.offset += self.rate * dt;
    }
}

/// What a drive makes of the set-points that arrive: `scale * set_point + offset`, or always the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SetPointFault {
    /// Factor, e.g. -1 for a wrong sign.
    pub scale: f64,
    /// Offset, rad (link side) or A.
    pub offset: f64,
}

impl Default for SetPointFault {
    fn default() -> Self {
        Self {
            scale: 1.0,
            offset: 0.0,
        }
    }
}

impl SetPointFault {
    /// The set-point that the drive follows, rad (link side) or A.
    #[must_use]
    pub fn followed(&self, set_point: f64) -> f64 {
        self.scale * set_point + self.offset
    }
}

/// The faults of one drive; by default there is none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DriveFaults {
    /// Motor encoder: the drive's own loop runs on it.
    pub motor: EncoderFault,
    /// Link encoder.
    pub link: EncoderFault,
    /// What it makes of set-points.
    pub set_point: SetPointFault,
    /// It hears no control words.
    pub deaf: bool,
    /// When it is enabled it goes to the set-point of its memory, not to where it stands: of a drive that
    /// was never sent one, 0.
    pub keeps_target: bool,
    /// Its current reads this value, A, whatever it is.
    pub current_reads: Option<f64>,
}

impl DriveFaults {
    /// Time passes.
    pub(crate) fn advance(&mut self, dt: f64) {
        self.motor.advance(dt);
        self.link.advance(dt);
    }

    /// The drive restarts, and its counter begins elsewhere by so many turns of the motor.
    pub fn lose_turns(&mut self, turns: f64) {
        self.motor.offset += turns * TAU;
    }
}
