//! A peer in the same thread, called when frames are sent: the frames do not depend on the machine's
//! speed, so the same start gives the same bytes.

use super::super::{Bus, BusCounters, deliver};
use crate::real_time::{Deadline, Pace, Schedule, WakeReport};
use can_codec::{Frames, Gather, MAX_FRAMES, Table};
use plant::CanRobot;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The other end of a bus: a simulated robot. Its answers arrive at once, or at their stamp.
pub trait Peer {
    /// Takes the frames and appends the answers to `out`.
    fn exchange(&mut self, frames: &Frames, now_ns: u64, out: &mut Frames);
}

impl Peer for CanRobot {
    fn exchange(&mut self, frames: &Frames, now_ns: u64, out: &mut Frames) {
        Self::exchange(self, frames, now_ns, out);
    }
}

/// A clock that only `advance_to` moves; clones share the same time.
#[derive(Debug, Clone, Default)]
pub struct VirtualClock(Arc<AtomicU64>);

impl VirtualClock {
    /// A clock at 0.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The time, ns.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    /// Moves it forwards to `to_ns`, never back.
    pub fn advance_to(&self, to_ns: u64) {
        self.0.fetch_max(to_ns, Ordering::Relaxed);
    }
}

/// Cycle starts on a [`VirtualClock`], which leaps from one to the next.
#[derive(Debug, Clone)]
pub struct VirtualDeadline {
    clock: VirtualClock,
    schedule: Schedule,
}

impl VirtualDeadline {
    /// Cycles every `period_ns`, the first one period from the clock's time.
    #[must_use]
    pub fn new(clock: &VirtualClock, period_ns: u64) -> Self {
        Self {
            clock: clock.clone(),
            schedule: Schedule::new(clock.now_ns() + period_ns, period_ns),
        }
    }
}

impl Pace for VirtualDeadline {
    fn wait(&mut self) -> WakeReport {
        let (scheduled_ns, late, skipped) = self.schedule.take(self.clock.now_ns());
        self.clock.advance_to(scheduled_ns);
        WakeReport {
            scheduled_ns,
            woke_ns: self.clock.now_ns(),
            late,
            skipped,
        }
    }
}

/// Cycle starts of a robot that is simulated in the loop's thread: in real time, while the robot's
/// [`VirtualClock`] leaps from one to the next. A simulated robot waits for a loop that is late: no
/// start is skipped, the robot's time passes more slowly instead.
#[derive(Debug, Clone)]
pub struct SimulatedDeadline {
    simulated: VirtualDeadline,
    real: Deadline,
    period_ns: u64,
}

impl SimulatedDeadline {
    /// Cycles every `period_ns` of both clocks, the first one period from now.
    #[must_use]
    pub fn new(clock: &VirtualClock, period_ns: u64) -> Self {
        Self {
            simulated: VirtualDeadline::new(clock, period_ns),
            real: Deadline::new(period_ns),
            period_ns,
        }
    }
}

impl Pace for SimulatedDeadline {
    fn wait(&mut self) -> WakeReport {
        self.simulated.wait();
        let met = self.real.wait();
        if met.skipped > 0 {
            self.real = Deadline::new(self.period_ns);
        }
        WakeReport { skipped: 0, ..met }
    }
}

/// A bus to a [`Peer`] in the same thread, on a virtual clock.
pub struct LockStep<P> {
    peer: P,
    clock: VirtualClock,
    /// Frames that the peer has sent and that are not yet received.
    answers: Frames,
    counters: BusCounters,
}

impl<P: Peer> LockStep<P> {
    /// A bus to the peer.
    #[must_use]
    pub fn new(peer: P, clock: &VirtualClock) -> Self {
        Self {
            peer,
            clock: clock.clone(),
            answers: Frames::new(MAX_FRAMES),
            counters: BusCounters::default(),
        }
    }

    /// The peer.
    #[must_use]
    pub fn peer(&self) -> &P {
        &self.peer
    }

    /// The peer, mutable.
    pub fn peer_mut(&mut self) -> &mut P {
        &mut self.peer
    }
}

impl<P: Peer> Bus for LockStep<P> {
    fn send(&mut self, frames: &Frames) -> usize {
        self.peer
            .exchange(frames, self.clock.now_ns(), &mut self.answers);
        self.counters.sent += frames.len() as u64;
        frames.len()
    }

    /// With an answer missing the clock leaps to `until_ns`: in this thread no further
    /// answer can arrive.
    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64) {
        let stamp_ns = self.clock.now_ns();
        for answer in &self.answers {
            let mut frame = *answer;
            if frame.stamp_ns == 0 {
                frame.stamp_ns = stamp_ns;
            }
            deliver(frame, rx, gather, table, &mut self.counters);
        }
        self.counters.dropped += self.answers.overflow();
        self.answers.clear();
        if !gather.complete() {
            self.clock.advance_to(until_ns);
        }
    }

    fn counters(&self) -> BusCounters {
        self.counters
    }

    fn now_ns(&self) -> u64 {
        self.clock.now_ns()
    }
}
