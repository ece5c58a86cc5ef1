//! The messages of a cycle that have arrived.

use crate::frame::Frame;
use crate::table::Table;

/// The messages that a cycle waits for, ticked off as they arrive.
#[derive(Clone, Debug)]
pub struct Gather {
    /// Messages that are not awaited.
    unasked: Vec<bool>,
    /// Messages that have arrived, or are not awaited.
    seen: Vec<bool>,
    remaining: usize,
}

impl Gather {
    /// Waits for `message_count` messages, none of which has arrived.
    #[must_use]
    pub fn new(message_count: usize) -> Self {
        Self::only(&vec![true; message_count])
    }

    /// Waits for those messages that are `awaited`, none of which has arrived.
    #[must_use]
    pub fn only(awaited: &[bool]) -> Self {
        let unasked: Vec<bool> = awaited.iter().map(|awaited| !awaited).collect();
        let mut this = Self {
            seen: unasked.clone(),
            unasked,
            remaining: 0,
        };
        this.begin();
        this
    }

    /// A new cycle begins: nothing has arrived.
    pub fn begin(&mut self) {
        self.seen.copy_from_slice(&self.unasked);
        self.remaining = self.seen.iter().filter(|seen| !**seen).count();
    }

    /// A new cycle begins, which waits for the messages that `other` waits for.
    pub fn begin_like(&mut self, other: &Self) {
        for (mine, theirs) in self.unasked.iter_mut().zip(&other.unasked) {
            *mine = *theirs;
        }
        self.begin();
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

    /// Every awaited message has arrived.
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
