//! Which messages of a cycle have arrived.

use crate::frame::Frame;
use crate::table::Table;

/// The messages that a cycle waits for, ticked off as they arrive.
#[derive(Clone, Debug)]
pub struct Gather {
    seen: Vec<bool>,
    remaining: usize,
}

impl Gather {
    /// Waits for `message_count` messages, none of which has arrived.
    #[must_use]
    pub fn new(message_count: usize) -> Self {
        Self {
            seen: vec![false; message_count],
            remaining: message_count,
        }
    }

    /// A new cycle begins: nothing has arrived.
    pub fn begin(&mut self) {
        self.seen.fill(false);
        self.remaining = self.seen.len();
    }

    /// Ticks off the frame's message if it is well formed; true once every message has arrived.
    pub fn note(&mut self, table: &Table, frame: &Frame) -> bool {
        if let Some(message) = table.classify(frame)
            && table.has_its_length(message, frame)
            && let Some(seen) = self.seen.get_mut(message)
            && !*seen
        {
            *seen = true;
            self.remaining -= 1;
        }
        self.complete()
    }

    /// Every message has arrived.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.remaining == 0
    }

    /// Indices of the messages that have not arrived.
    pub fn missing(&self) -> impl Iterator<Item = usize> + '_ {
        self.seen
            .iter()
            .enumerate()
            .filter_map(|(message, &seen)| (!seen).then_some(message))
    }
}
