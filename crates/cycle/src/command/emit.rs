//! Emit: from commands to frames.

use can_codec::{Frames, Table};
use robot_config::{Robot, slots};
use robot_state::Event;

use super::Command;
use crate::events::Counts;

/// The frames that carry the commands.
#[derive(Debug)]
pub(crate) struct Emit {
    table: Table,
    /// NaN while a joint is not engaged: no frame follows from NaN.
    slots: Vec<f64>,
}

impl Emit {
    pub(crate) fn new(robot: &Robot) -> Self {
        Self {
            slots: vec![f64::NAN; slots::send_len(&robot.parameters)],
            table: robot.send.clone(),
        }
    }

    /// Appends this cycle's command frames: those whose joints are all engaged.
    pub(crate) fn update(&mut self, command: &Command, tx: &mut Frames, counts: &mut Counts) {
        for (j, last) in command.last().enumerate() {
            if let Some(slot) = self.slots.get_mut(slots::command(j)) {
                *slot = last.unwrap_or(f64::NAN);
            }
        }
        self.table.encode_all(&self.slots, tx);
        counts.add_many(Event::SendFailed, tx.overflow());
    }
}
