//! Two ends in two threads, a lock-free queue each way.

use super::super::{Bus, BusCounters, deliver};
use crate::real_time::{monotonic_ns, sleep_until};
use can_codec::{Frames, Gather, Table};
use crossbeam::queue::ArrayQueue;
use std::sync::Arc;

/// Pause of an end that finds no frame, ns: short against a cycle, long enough to leave
/// the CPU to the other end.
const NAP_NS: u64 = 20_000;

/// One end of a [`pair`]: the other end receives the frames that it sends.
pub struct InProcess {
    incoming: Arc<ArrayQueue<can_codec::Frame>>,
    outgoing: Arc<ArrayQueue<can_codec::Frame>>,
    counters: BusCounters,
}

/// Two ends, with room for `capacity` frames (at least one) on the way in each direction.
#[must_use]
pub fn pair(capacity: usize) -> (InProcess, InProcess) {
    let there = Arc::new(ArrayQueue::new(capacity.max(1)));
    let back = Arc::new(ArrayQueue::new(capacity.max(1)));
    let end = |incoming: &Arc<_>, outgoing: &Arc<_>| InProcess {
        incoming: Arc::clone(incoming),
        outgoing: Arc::clone(outgoing),
        counters: BusCounters::default(),
    };
    (end(&there, &back), end(&back, &there))
}

impl Bus for InProcess {
    fn send(&mut self, frames: &Frames) -> usize {
        let mut accepted = 0;
        for frame in frames {
            let mut frame = *frame;
            frame.stamp_ns = monotonic_ns();
            match self.outgoing.push(frame) {
                Ok(()) => accepted += 1,
                Err(_) => self.counters.send_failed += 1,
            }
        }
        self.counters.sent += accepted as u64;
        accepted
    }

    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64) {
        loop {
            let now_ns = monotonic_ns();
            // The other end may send faster than this one reads: no more than the queue holds.
            for _ in 0..self.incoming.capacity() {
                let Some(frame) = self.incoming.pop() else {
                    break;
                };
                deliver(frame, rx, gather, table, &mut self.counters);
            }
            if gather.complete() || now_ns >= until_ns {
                return;
            }
            sleep_until(until_ns.min(now_ns + NAP_NS));
        }
    }

    fn counters(&self) -> BusCounters {
        self.counters
    }

    fn now_ns(&self) -> u64 {
        monotonic_ns()
    }
}
