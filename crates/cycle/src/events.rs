//! Counts of numbered events.

use robot_state::{EVENT_COUNT, Event};

/// Count of each event since start, in the order of `Event::ALL`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Counts([u64; EVENT_COUNT]);

impl Counts {
    pub(crate) const fn new() -> Self {
        Self([0; EVENT_COUNT])
    }

    pub(crate) fn add(&mut self, event: Event) {
        self.add_many(event, 1);
    }

    pub(crate) fn add_many(&mut self, event: Event, times: u64) {
        if let Some(count) = self.0.get_mut(event.index()) {
            *count = count.saturating_add(times);
        }
    }

    pub(crate) fn as_array(&self) -> [u64; EVENT_COUNT] {
        self.0
    }
}
