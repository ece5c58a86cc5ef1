//! The messages of the last seconds, in memory that is taken once.

use std::collections::VecDeque;

/// A message's place.
#[derive(Debug, Clone, Copy)]
struct Entry {
    start: usize,
    len: usize,
    stamp_ns: u64,
}

/// The newest messages, numbered from 0; the oldest make room.
#[derive(Debug)]
pub(super) struct History {
    bytes: Vec<u8>,
    entries: VecDeque<Entry>,
    /// Number of the oldest entry.
    oldest: u64,
    /// Place behind the newest entry.
    end: usize,
}

impl History {
    /// With room for so many bytes and messages.
    pub(super) fn new(bytes: usize, messages: usize) -> Self {
        let mut memory = vec![0; bytes];
        // Written, so that the memory is there before it is needed.
        memory.fill(1);
        Self {
            bytes: memory,
            entries: VecDeque::with_capacity(messages + 1),
            oldest: 0,
            end: 0,
        }
    }

    /// Appends a message; gives its number.
    pub(super) fn push(&mut self, message: &[u8], stamp_ns: u64) -> u64 {
        let len = message.len();
        if self.end + len > self.bytes.len() {
            // Messages are whole: what is left at the end is not used.
            self.drop_between(self.end, self.bytes.len());
            self.end = 0;
        }
        let start = self.end;
        self.drop_between(start, start + len);
        if let Some(place) = self.bytes.get_mut(start..start + len) {
            place.copy_from_slice(message);
            self.entries.push_back(Entry {
                start,
                len,
                stamp_ns,
            });
            self.end = start + len;
        }
        self.next().saturating_sub(1)
    }

    /// Drops the oldest entries that stand in these bytes.
    fn drop_between(&mut self, from: usize, to: usize) {
        while let Some(entry) = self.entries.front() {
            let apart = entry.start >= to || entry.start + entry.len <= from;
            if apart {
                return;
            }
            self.entries.pop_front();
            self.oldest += 1;
        }
    }

    /// Number of the next message.
    pub(super) fn next(&self) -> u64 {
        self.oldest + self.entries.len() as u64
    }

    /// Number of the oldest message that is still there.
    pub(super) fn oldest(&self) -> u64 {
        self.oldest
    }

    /// Number and stamp of the newest message.
    pub(super) fn newest(&self) -> Option<(u64, u64)> {
        let newest = self.entries.back()?;
        Some((self.next() - 1, newest.stamp_ns))
    }

    /// The message of that number, and its stamp.
    pub(super) fn get(&self, number: u64) -> Option<(&[u8], u64)> {
        let index = usize::try_from(number.checked_sub(self.oldest)?).ok()?;
        let entry = self.entries.get(index)?;
        let bytes = self.bytes.get(entry.start..entry.start + entry.len)?;
        Some((bytes, entry.stamp_ns))
    }

    /// Number of the first message from that instant on; `otherwise` if there is none.
    pub(super) fn since(&self, stamp_ns: u64, otherwise: u64) -> u64 {
        let index = self
            .entries
            .iter()
            .position(|entry| entry.stamp_ns >= stamp_ns);
        index.map_or(otherwise, |index| self.oldest + index as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::History;
    use test_support::Random;

    #[test]
    fn the_newest_messages_are_there_whole_and_in_order() {
        let mut random = Random::new(7);
        let mut history = History::new(1000, 50);
        for number in 0..2000_u64 {
            let len = 1 + (random.unit() * 90.0) as usize;
            let message = vec![number as u8; len];
            assert_eq!(history.push(&message, 10 * number), number);
            assert_eq!(history.newest(), Some((number, 10 * number)));
            let mut held = 0;
            for older in history.oldest()..=number {
                let (bytes, stamp_ns) = history.get(older).expect("in the history");
                assert!(bytes.iter().all(|byte| *byte == older as u8));
                assert_eq!(stamp_ns, 10 * older);
                held += bytes.len();
            }
            // The longest message, and what is left at the end, may be missing.
            assert!(number < 40 || held > 1000 - 2 * 91, "{held} bytes of 1000");
            assert_eq!(history.get(number + 1), None);
            let from = history.oldest() + 1;
            assert!(from > number || history.since(10 * from - 3, 0) == from);
            assert_eq!(history.since(10 * number + 1, 77), 77);
        }
    }
}
