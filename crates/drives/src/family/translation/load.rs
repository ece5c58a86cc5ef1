//! Frames that actuators and loop exchange: what a bus has to carry.

use super::live::POLL_EVERY;
use super::{Actuator, named};
use crate::family::{Feedback, SetPoint, State};
use can_codec::Frame;

/// Period in which what changes slowly is told, s: makers preset 0.1 s and more.
const SLOW_S: f64 = 0.1;

/// A kind of frame on a bus.
#[derive(Clone, Copy, Debug)]
pub struct Exchanged {
    /// One of them.
    pub frame: Frame,
    /// How often it is sent in a cycle.
    pub per_cycle: f64,
    /// The actuator sends it.
    pub received: bool,
}

impl Actuator {
    /// What is exchanged with it while it follows set-points, in cycles of that period, s.
    #[must_use]
    pub fn exchanged(&self, period: f64) -> Vec<Exchanged> {
        let Some(family) = named(self.family) else {
            return Vec::new();
        };
        // The last set-point again as a question, then the new one; each is answered.
        let asked = if family.tells_apart() { 1.0 } else { 2.0 };
        let polled = 1.0 / f64::from(POLL_EVERY);
        let slow = if family.polls_apart() {
            polled
        } else {
            (period / SLOW_S).min(1.0)
        };
        let told = Feedback {
            position: Some(0.0),
            velocity: Some(0.0),
            torque: Some(0.0),
            current: Some(0.0),
            temperature: Some(25.0),
            voltage: Some(48.0),
            state: Some(State::Enabled),
            error: Some(0),
        };
        let hold = SetPoint::default();
        let sent = |frame, per_cycle| Exchanged {
            frame,
            per_cycle,
            received: false,
        };
        let command = family.command(self.at, &self.model, &hold);
        let poll = family.poll(self.at).filter(|_| family.polls_apart());
        let mut all: Vec<_> = command
            .map(|frame| sent(frame, asked))
            .into_iter()
            .collect();
        all.extend(poll.map(|frame| sent(frame, polled)));
        let answers = family.answer(self.at, &self.model, &told);
        all.extend(answers.into_iter().map(|frame| {
            let tells = family.feedback(self.at, &self.model, &frame);
            let is_quick = tells.is_some_and(|told| {
                told.position.is_some() || told.current.is_some() && family.tells_apart()
            });
            Exchanged {
                frame,
                per_cycle: if is_quick { asked } else { slow },
                received: true,
            }
        }));
        all
    }
}
