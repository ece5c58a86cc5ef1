//! A bus with injected faults, reproducible by a seed.

use super::{Bus, BusCounters};
use can_codec::{Frame, Frames, Gather, MAX_FRAMES, Table};

/// Probability of each fault for a received frame, 0 to 1. A frame has at most one fault: their sum
/// must not exceed 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// The frame is lost.
    pub drop: f64,
    /// The frame arrives twice.
    pub duplicate: f64,
    /// The frame arrives with the next call of `receive` that finds it overdue.
    pub delay: f64,
    /// The frame arrives with another length.
    pub corrupt_length: f64,
    /// A frame with an id of no message arrives before it.
    pub unknown_id: f64,
    /// An error frame arrives before it.
    pub error_frame: f64,
}

/// Number of injected faults of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Injected {
    /// Frames lost.
    pub dropped: u64,
    /// Frames doubled.
    pub duplicated: u64,
    /// Frames that arrived a cycle late.
    pub delayed: u64,
    /// Frames whose length was changed.
    pub corrupted: u64,
    /// Frames with an unknown id that were added.
    pub unknown: u64,
    /// Error frames that were added.
    pub errors: u64,
}

/// An extended id that robots do not use: all 29 bits set.
const NOBODYS_ID: u32 = can_codec::EXTENDED_ID | 0x1fff_ffff;
/// `CAN_ERR_CRTL`: a problem of the controller.
const ERROR_CLASS: u32 = 4;

/// Wraps a bus and injects faults into received frames; sent frames pass unchanged.
pub struct FaultInjector<B> {
    inner: B,
    faults: Faults,
    random: SplitMix,
    injected: Injected,
    /// Frames that the wrapped bus has just received.
    fresh: Frames,
    /// Frames for the next call.
    delayed: Frames,
    /// The wrapped bus's own gather, without faults.
    gather: Gather,
    added: BusCounters,
}

impl<B: Bus> FaultInjector<B> {
    /// Wraps `inner`, whose frames are those of `table`.
    #[must_use]
    pub fn new(inner: B, table: &Table, faults: Faults, seed: u64) -> Self {
        Self {
            inner,
            faults,
            random: SplitMix(seed),
            injected: Injected::default(),
            fresh: Frames::new(MAX_FRAMES),
            delayed: Frames::new(MAX_FRAMES),
            gather: Gather::new(table.message_count()),
            added: BusCounters::default(),
        }
    }

    /// Sets the faults from now on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.faults = faults;
    }

    /// Faults injected so far.
    #[must_use]
    pub fn injected(&self) -> Injected {
        self.injected
    }

    /// The wrapped bus.
    pub fn inner_mut(&mut self) -> &mut B {
        &mut self.inner
    }

    fn spoil(&mut self, frame: Frame, out: &mut Deliver<'_>) {
        let faults = self.faults;
        let mut dice = self.random.unit();
        // True if the random number falls on this fault's share.
        let mut fell_on = |share: f64| {
            let hit = (0.0..share).contains(&dice);
            dice -= share;
            hit
        };
        if fell_on(faults.drop) {
            self.injected.dropped += 1;
        } else if fell_on(faults.duplicate) {
            self.injected.duplicated += 1;
            out.deliver(frame);
            out.deliver(frame);
        } else if fell_on(faults.delay) {
            self.injected.delayed += 1;
            self.delayed.push(frame);
        } else if fell_on(faults.corrupt_length) {
            self.injected.corrupted += 1;
            out.deliver(other_length(frame));
        } else if fell_on(faults.unknown_id) {
            self.injected.unknown += 1;
            out.deliver(Frame {
                id: NOBODYS_ID,
                ..frame
            });
            out.deliver(frame);
        } else if fell_on(faults.error_frame) {
            self.injected.errors += 1;
            let mut error = Frame::zeroed(frame.bus, ERROR_CLASS, 8, false);
            error.error = true;
            error.stamp_ns = frame.stamp_ns;
            out.deliver(error);
            out.deliver(frame);
        } else {
            out.deliver(frame);
        }
    }
}

/// Another length for the frame, its unused bytes zero.
fn other_length(mut frame: Frame) -> Frame {
    match usize::from(frame.len) {
        0 => frame.len = 1,
        used => {
            frame.len -= 1;
            if let Some(last) = frame.data.get_mut(used - 1) {
                *last = 0;
            }
        }
    }
    frame
}

/// The caller's list and gather, and the number of frames added.
struct Deliver<'a> {
    rx: &'a mut Frames,
    gather: &'a mut Gather,
    table: &'a Table,
    counters: BusCounters,
}

impl Deliver<'_> {
    fn deliver(&mut self, frame: Frame) {
        super::deliver(frame, self.rx, self.gather, self.table, &mut self.counters);
    }
}

impl<B: Bus> Bus for FaultInjector<B> {
    fn send(&mut self, frames: &Frames) -> usize {
        self.inner.send(frames)
    }

    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64) {
        let mut out = Deliver {
            rx,
            gather,
            table,
            counters: self.added,
        };
        for frame in &self.delayed {
            out.deliver(*frame);
        }
        self.delayed.clear();
        loop {
            self.fresh.clear();
            self.gather.wait_like(out.gather);
            let Self {
                inner,
                fresh,
                gather,
                ..
            } = self;
            inner.receive(fresh, gather, table, until_ns);
            for at in 0..self.fresh.len() {
                if let Some(&frame) = self.fresh.as_slice().get(at) {
                    self.spoil(frame, &mut out);
                }
            }
            // The wrapped bus may have finished too early: a frame was lost here.
            if out.gather.complete() || self.inner.now_ns() >= until_ns {
                break;
            }
        }
        self.added = out.counters;
    }

    /// Received frames as the caller saw them; sent and lost ones as the wrapped bus counts them.
    fn counters(&self) -> BusCounters {
        let inner = self.inner.counters();
        BusCounters {
            received: self.added.received,
            error_frames: self.added.error_frames,
            dropped: inner.dropped + self.added.dropped,
            ..inner
        }
    }

    fn now_ns(&self) -> u64 {
        self.inner.now_ns()
    }
}

/// Steele, Lea and Flood's SplitMix64: sufficient for fault injection, and identical on every machine.
struct SplitMix(u64);

impl SplitMix {
    /// Uniform in 0..1.
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        (z >> 11) as f64 / (1_u64 << 53) as f64
    }
}
