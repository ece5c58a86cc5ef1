//! Emit: from commands and control words to frames.

use can_codec::{Frames, Table};
use robot_config::{Robot, slots};
use robot_state::Event;
use supervisor::Drive;

use super::{Command, Supervisor};
use crate::events::Counts;

/// Control words are repeated after so many cycles, for a drive that lost one.
const REPEAT: u32 = 100;

/// The frames that carry set-points and control words.
#[derive(Debug)]
pub(crate) struct Emit {
    table: Table,
    /// NaN while a joint is not engaged or no control word is due: no frame follows from NaN.
    slots: Vec<f64>,
    /// Each drive's last control word.
    words: Vec<Option<u32>>,
    /// Cycles since control words were sent.
    since: u32,
}

impl Emit {
    pub(crate) fn new(robot: &Robot) -> Self {
        Self {
            slots: vec![f64::NAN; slots::send_len(&robot.parameters)],
            table: robot.send.clone(),
            words: vec![None; robot.parameters.joints.len()],
            since: 0,
        }
    }

    /// Appends this cycle's frames: set-points of messages whose joints are all engaged, and control
    /// words while a drive is not where it should be, when one changes, and every 100 cycles.
    pub(crate) fn update(
        &mut self,
        command: &Command,
        supervisor: &Supervisor,
        tx: &mut Frames,
        counts: &mut Counts,
    ) {
        for (j, last) in command.last().enumerate() {
            // Also not where the command itself was the fault.
            let last = last.filter(|_| supervisor.is_engaged(j));
            self.set(slots::command(j), last);
        }
        let due = self.control_words_due(supervisor.drives());
        for j in 0..self.words.len() {
            self.set(
                slots::control(j),
                self.words[j].filter(|_| due).map(f64::from),
            );
        }
        self.table.encode_all(&self.slots, tx);
        counts.add_many(Event::SendFailed, tx.overflow());
    }

    fn control_words_due(&mut self, drives: &[Drive]) -> bool {
        self.since += 1;
        let mut due = self.since >= REPEAT;
        for (last, drive) in self.words.iter_mut().zip(drives) {
            let word = drive.control_word();
            due |= word != *last || !drive.is_settled();
            *last = word;
        }
        if due {
            self.since = 0;
        }
        due
    }

    fn set(&mut self, slot: usize, value: Option<f64>) {
        if let Some(slot) = self.slots.get_mut(slot) {
            *slot = value.unwrap_or(f64::NAN);
        }
    }
}
