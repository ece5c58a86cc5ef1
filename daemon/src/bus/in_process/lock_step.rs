//! A peer in the same thread, called when frames are sent: the frames do not depend on the machine's
//! speed, so the same start gives the same bytes.

use super::super::translation::Translation;
use super::super::{Bus, BusCounters, Waiting, deliver};
use crate::real_time::{Deadline, Pace, Schedule, WakeReport, monotonic_ns, sleep_until};
use can_codec::{Frame, Frames, Gather, MAX_FRAMES, Table};
use crossbeam::queue::ArrayQueue;
use drives::family::translation::{Actuator, Reports};
use plant::CanRobot;
use problem::Problem;
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
    /// Of another thread's end, if there is one.
    listened: Option<Arc<Listened>>,
    said: Frames,
    /// Of actuators' frames, if there are any.
    translation: Option<Translation>,
}

/// What goes between the bus and the end of another thread.
struct Listened {
    heard: ArrayQueue<Frame>,
    said: ArrayQueue<Frame>,
}

/// Frames on their way to or from another thread's end, at most.
const ON_THE_WAY: usize = 1024;

/// Another thread's end of a [`LockStep`]: it hears what CANopen nodes say besides process data.
pub struct Listener {
    listened: Arc<Listened>,
    clock: VirtualClock,
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
            listened: None,
            said: Frames::new(MAX_FRAMES),
            translation: None,
        }
    }

    /// Turns frames of these actuators into the loop's messages from now on, and back. Returns where they report
    /// errors and what else they send; none without actuators.
    ///
    /// # Errors
    /// A family that there is not.
    pub fn translate(&mut self, actuators: &[Actuator]) -> Result<Option<Reports>, Problem> {
        self.translation = Translation::new(actuators)?;
        Ok(self.translation.as_ref().map(Translation::reports))
    }

    /// The end of another thread, from now on.
    #[must_use]
    pub fn listener(&mut self) -> Listener {
        let listened = Arc::new(Listened {
            heard: ArrayQueue::new(ON_THE_WAY),
            said: ArrayQueue::new(ON_THE_WAY),
        });
        self.listened = Some(Arc::clone(&listened));
        Listener {
            listened,
            clock: self.clock.clone(),
            counters: BusCounters::default(),
        }
    }

    /// Hands over what the other thread has sent, and to it what it listens for.
    fn pass_on(&mut self, first: usize) {
        let Some(listened) = &self.listened else {
            return;
        };
        for frame in self.answers.iter().skip(first) {
            if is_of_a_node(frame) {
                // A thread that does not listen loses the rest.
                let _ = listened.heard.push(*frame);
            }
        }
        self.said.clear();
        while let Some(frame) = listened.said.pop() {
            self.said.push(frame);
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
        let now = self.clock.now_ns();
        let first = self.answers.len();
        if !self.said.is_empty() {
            self.peer.exchange(&self.said, now, &mut self.answers);
        }
        let mut translation = self.translation.take();
        let leaving = match &mut translation {
            Some(translation) => translation.leaving(frames),
            None => frames,
        };
        self.peer.exchange(leaving, now, &mut self.answers);
        self.translation = translation;
        self.pass_on(first);
        self.counters.sent += frames.len() as u64;
        frames.len()
    }

    /// With an answer missing the clock leaps to `until_ns`: in this thread no further
    /// answer can arrive.
    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64) {
        let stamp_ns = self.clock.now_ns();
        for answer in &self.answers {
            // What another thread listens for is none of the loop's.
            if self.listened.is_some() && is_of_a_node(answer) {
                continue;
            }
            let mut frame = *answer;
            if frame.stamp_ns == 0 {
                frame.stamp_ns = stamp_ns;
            }
            if Translation::arrived(&mut self.translation, &mut frame) {
                deliver(frame, rx, gather, table, &mut self.counters);
            }
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

/// An emergency, an answer by SDO, a heartbeat or boot-up.
fn is_of_a_node(frame: &Frame) -> bool {
    matches!(frame.id, 0x081..=0x0FF | 0x581..=0x5FF | 0x701..=0x77F)
}

impl<P: Peer> Waiting for LockStep<P> {
    /// The peer's time passes, and what it says by its own clock is received.
    fn wait(&mut self, until_ns: u64) -> bool {
        self.clock.advance_to(until_ns);
        self.peer
            .exchange(&Frames::new(0), until_ns, &mut self.answers);
        !self.answers.is_empty()
    }
}

/// Pause of another thread that finds no frame, ns.
const NAP_NS: u64 = 1_000_000;

impl Bus for Listener {
    fn send(&mut self, frames: &Frames) -> usize {
        let sent = frames
            .iter()
            .filter(|frame| self.listened.said.push(**frame).is_ok())
            .count();
        self.counters.sent += sent as u64;
        sent
    }

    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, _until_ns: u64) {
        for _ in 0..ON_THE_WAY {
            let Some(frame) = self.listened.heard.pop() else {
                return;
            };
            deliver(frame, rx, gather, table, &mut self.counters);
        }
    }

    fn counters(&self) -> BusCounters {
        self.counters
    }

    fn now_ns(&self) -> u64 {
        self.clock.now_ns()
    }
}

impl Waiting for Listener {
    /// In the time of the loop's thread, which is that of the bus.
    fn wait(&mut self, until_ns: u64) -> bool {
        let waited = until_ns.saturating_sub(self.clock.now_ns());
        let end = monotonic_ns() + waited;
        while self.listened.heard.is_empty() && monotonic_ns() < end {
            sleep_until(monotonic_ns() + NAP_NS);
        }
        !self.listened.heard.is_empty()
    }
}
