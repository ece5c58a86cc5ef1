//! The messages of a cycle that have arrived.

use crate::frame::Frame;
use crate::table::Table;

/// Late answers of one message that a cycle waits for at most.
const MOST_LATE: u8 = 2;

/// The messages that a cycle waits for, ticked off as they arrive.
///
/// An answer that has not come may be lost or late, and a late one looks like one to this SYNC. So the
/// cycle after waits for that one too: if both come, the last is this cycle's.
#[derive(Clone, Debug)]
pub struct Gather {
    /// The message is waited for.
    awaited: Vec<bool>,
    /// A frame of the message has arrived in this cycle.
    arrived: Vec<bool>,
    /// A frame of the message has ever arrived: before, nothing of it can be late.
    known: Vec<bool>,
    /// Frames of each message that are still waited for.
    to_come: Vec<u8>,
    /// Messages that are still waited for.
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
        let mut this = Self {
            awaited: awaited.to_vec(),
            arrived: vec![false; awaited.len()],
            known: vec![false; awaited.len()],
            to_come: vec![0; awaited.len()],
            remaining: 0,
        };
        this.begin();
        this
    }

    /// A new cycle begins: nothing has arrived but what the last one still waited for.
    pub fn begin(&mut self) {
        self.remaining = 0;
        for (m, to_come) in self.to_come.iter_mut().enumerate() {
            let late = if self.known[m] && !self.arrived[m] {
                (*to_come).min(MOST_LATE)
            } else {
                0
            };
            *to_come = if self.awaited[m] { 1 + late } else { 0 };
            self.arrived[m] = false;
            self.remaining += usize::from(self.awaited[m]);
        }
    }

    /// Waits for what `other` waits for, as far as it has the same messages.
    pub fn wait_like(&mut self, other: &Self) {
        let copy = |mine: &mut Vec<bool>, theirs: &[bool]| {
            (mine.iter_mut().zip(theirs)).for_each(|(mine, theirs)| *mine = *theirs);
        };
        copy(&mut self.awaited, &other.awaited);
        copy(&mut self.arrived, &other.arrived);
        copy(&mut self.known, &other.known);
        for (mine, theirs) in self.to_come.iter_mut().zip(&other.to_come) {
            *mine = *theirs;
        }
        self.remaining = self.to_come.iter().filter(|left| **left > 0).count();
    }

    /// Ticks off the frame's message if it is well formed; true once every message has arrived.
    pub fn note(&mut self, table: &Table, frame: &Frame) -> bool {
        if let Some(message) = table.classify(frame)
            && table.has_its_length(message, frame)
            && let Some(to_come) = self.to_come.get_mut(message)
            && *to_come > 0
        {
            *to_come -= 1;
            (self.arrived[message], self.known[message]) = (true, true);
            self.remaining -= usize::from(*to_come == 0);
        }
        self.complete()
    }

    /// Every awaited message has arrived.
    #[must_use]
    pub fn complete(&self) -> bool {
        self.remaining == 0
    }

    /// Indices of the messages of which no frame has arrived.
    pub fn missing(&self) -> impl Iterator<Item = usize> + '_ {
        let messages = self.awaited.iter().zip(&self.arrived).enumerate();
        messages
            .filter_map(|(message, (awaited, arrived))| (*awaited && !arrived).then_some(message))
    }
}
