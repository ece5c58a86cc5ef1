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
    /// NaN until there is a command: no frame follows from NaN.
    slots: Vec<f64>,
}

impl Emit {
    pub(crate) fn new(robot: &Robot) -> Self {
        Self {
            slots: vec![f64::NAN; slots::send_len(&robot.parameters)],
            table: robot.send.clone(),
        }
    }

    /// Appends this cycle's command frames. None are sent until every joint has answered once: the
    /// drives hold by themselves, and their positions are not yet known.
    pub(crate) fn update(
        &mut self,
        command: &Command,
        all_seen: bool,
        tx: &mut Frames,
        counts: &mut Counts,
    ) {
        if !all_seen {
            return;
        }
        for (j, last) in command.last().enumerate() {
            if let Some(slot) = self.slots.get_mut(slots::command(j)) {
                *slot = last.unwrap_or(f64::NAN);
            }
        }
        let encoded = self.table.encode_all(&self.slots, tx);
        let unsent = self.table.message_count().saturating_sub(encoded);
        counts.add_many(Event::SendFailed, unsent as u64);
    }
}
