//! Frames of actuators, and the loop's messages for them.

use can_codec::{Frame, Frames, MAX_FRAMES};
use drives::family::translation::{Actuator, Reports, Translator};
use problem::Problem;

/// Turns one into the other, in memory taken once.
pub(super) struct Translation {
    translator: Translator,
    leaving: Frames,
}

impl Translation {
    /// For these actuators; none: there are none.
    pub(super) fn new(actuators: &[Actuator]) -> Result<Option<Self>, Problem> {
        let translator = Translator::new(actuators)?;
        Ok(translator.map(|translator| Self {
            leaving: Frames::new(MAX_FRAMES + translator.most()),
            translator,
        }))
    }

    /// What the actuators tell besides what the loop takes.
    pub(super) fn reports(&self) -> Reports {
        self.translator.reports()
    }

    /// Turns an actuator's frame into its message of state; whether the loop is to have the frame.
    pub(super) fn arrived(translation: &mut Option<Self>, frame: &mut Frame) -> bool {
        (translation.as_mut()).is_none_or(|this| this.translator.receive(frame))
    }

    /// What leaves on the buses for the loop's frames.
    pub(super) fn leaving(&mut self, frames: &Frames) -> &Frames {
        self.leaving.clear();
        for frame in frames {
            self.translator.send(frame, &mut self.leaving);
        }
        &self.leaving
    }
}
