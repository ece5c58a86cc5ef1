//! Transition: a change of mode without a step in the command.

/// Duration of a transition, s. A step in the command would be a step in torque.
const DURATION_S: f64 = 0.3;

/// Difference between the last command of the mode before and the first of this one, fading out.
#[derive(Debug, Clone)]
pub(crate) struct Transition {
    /// The last command of the mode before, until the first of this one is known.
    last: Option<f64>,
    difference: f64,
    left_s: f64,
}

impl Transition {
    /// From the last command of the mode before.
    pub(crate) fn from(last: f64) -> Self {
        Self {
            last: Some(last),
            difference: 0.0,
            left_s: DURATION_S,
        }
    }

    /// The command of this cycle, plus the rest of the difference.
    pub(crate) fn blend(&mut self, command: f64, dt: f64) -> f64 {
        if let Some(last) = self.last.take() {
            self.difference = last - command;
        }
        let blended = command + self.difference * (self.left_s / DURATION_S);
        self.left_s = (self.left_s - dt).max(0.0);
        blended
    }
}
