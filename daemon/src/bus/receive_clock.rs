//! From the kernel's receive time stamps to the loop's clock.

use crate::real_time::{monotonic_ns, realtime_ns};

/// A pair of readings closer together than this is not worth trying again, ns.
const NEAR_NS: u64 = 2_000;
const TRIES: u32 = 3;

/// Converts stamps on `CLOCK_REALTIME`, which is set and slewed while the loop runs, to
/// `CLOCK_MONOTONIC`.
///
/// The difference of the two clocks is taken anew for each batch of frames. It may still have
/// changed since a frame's stamp: so a frame's time is kept between the moment when the queue was
/// last seen empty and now, and never before that of the frame ahead of it. A stepped clock
/// can move a stamp by no more than the frame's time in the queue.
#[derive(Debug, Clone)]
pub(super) struct ReceiveClock {
    /// `CLOCK_REALTIME` minus `CLOCK_MONOTONIC`, ns.
    difference_ns: i64,
    /// Time before which no frame now waiting had arrived, ns.
    empty_ns: u64,
    /// Stamp of the newest frame, ns.
    last_ns: u64,
    /// Time at which the difference was taken, ns.
    now_ns: u64,
}

impl ReceiveClock {
    pub(super) fn new(now_ns: u64) -> Self {
        Self {
            difference_ns: 0,
            empty_ns: now_ns,
            last_ns: 0,
            now_ns,
        }
    }

    /// Updates the difference of the clocks; call it after the frames of a batch have been read and
    /// before they are stamped.
    pub(super) fn update(&mut self) {
        let mut nearest = u64::MAX;
        for _ in 0..TRIES {
            let before = monotonic_ns();
            let real = realtime_ns();
            let after = monotonic_ns();
            let apart = after.saturating_sub(before);
            if apart < nearest {
                nearest = apart;
                let middle = before + apart / 2;
                self.difference_ns = (real as i64).wrapping_sub(middle as i64);
            }
            self.now_ns = after;
            if nearest < NEAR_NS {
                break;
            }
        }
    }

    /// The loop's time of a frame that the kernel stamped `real_ns`; 0 if it has no stamp.
    pub(super) fn stamp(&mut self, real_ns: u64) -> u64 {
        let earliest = self.empty_ns.max(self.last_ns);
        let converted = match real_ns {
            0 => self.now_ns,
            real => (real as i64).wrapping_sub(self.difference_ns).max(0) as u64,
        };
        self.last_ns = converted.min(self.now_ns).max(earliest);
        self.last_ns
    }

    /// The queue was empty at some moment after `at_ns`.
    pub(super) fn seen_empty(&mut self, at_ns: u64) {
        self.empty_ns = at_ns;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn clock(difference_ns: i64) -> ReceiveClock {
        ReceiveClock {
            difference_ns,
            empty_ns: 1_000,
            last_ns: 0,
            now_ns: 2_000,
        }
    }

    #[test]
    fn a_steady_clock_is_converted_exactly() {
        let mut clock = clock(1_000_000);
        assert_eq!(clock.stamp(1_001_234), 1_234);
        assert_eq!(clock.stamp(1_001_235), 1_235);
    }

    #[test]
    fn two_readings_of_the_same_moment_agree() {
        let mut clock = ReceiveClock::new(monotonic_ns());
        let before = monotonic_ns();
        let real = realtime_ns();
        let after = monotonic_ns();
        clock.update();
        clock.empty_ns = 0;
        let stamp = clock.stamp(real);
        // A preempted thread widens the brackets, never the error beyond them.
        let slack = 10_000_000;
        assert!(stamp + slack > before && stamp < after + slack);
    }

    proptest! {
        #[test]
        fn a_stepped_clock_never_leaves_the_time_in_the_queue(
            step in -5_000_000_000_i64..5_000_000_000,
            arrivals in prop::collection::vec(0_u64..10_000, 1..20),
        ) {
            let mut clock = clock(step);
            let mut last = 0;
            for real in arrivals {
                let stamp = clock.stamp(real);
                prop_assert!((1_000..=2_000).contains(&stamp));
                prop_assert!(stamp >= last);
                last = stamp;
            }
        }
    }
}
