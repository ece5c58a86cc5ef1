//! Where the time of the loop's cycles goes: the loop hands its times over, the main thread keeps them as histograms
//! and says of each late cycle what made it late.
//!
//! The loop only reads its clock. What the system did meanwhile (other threads, page faults, a host that took the
//! CPU away) is read by the main thread from `/proc`, so that the loop makes no further system call.

mod book;
mod system;

use rtrb::{Consumer, Producer, RingBuffer};

pub use book::Book;
pub use system::LoopThread;

/// Cycles that wait for the main thread: four seconds at 1 kHz, while a slow disk holds it up.
const ROOM: usize = 4096;
/// No message.
pub(crate) const NONE: u16 = u16::MAX;

/// Times of one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CycleTimes {
    /// The cycle's number, from 1.
    pub cycle: u64,
    /// Delay of the thread's wake-up, ns.
    pub wake_ns: u64,
    /// From SYNC until all answers had come, or the deadline, ns.
    pub gather_ns: u64,
    /// The stages of the computation, ns, in the order of [`cycle::STAGES`].
    pub stages_ns: [u64; cycle::STAGES.len()],
    /// To hand the commands to the bus, ns.
    pub send_ns: u64,
    /// The cycle before this one ended too late.
    pub after_late: bool,
    /// Starts that were skipped before this cycle.
    pub skipped: u64,
    /// The message that came last, by its number in the receive table; `u16::MAX` for none.
    pub last_message: u16,
    /// The first message that was waited for in vain; `u16::MAX` for none.
    pub missing_message: u16,
}

/// The loop's end of a way to the main thread.
#[derive(Debug)]
pub struct TimesSender(Producer<CycleTimes>);

/// The main thread's end.
#[derive(Debug)]
pub struct TimesReceiver(Consumer<CycleTimes>);

/// A way for times from the loop to the main thread.
#[must_use]
pub fn channel() -> (TimesSender, TimesReceiver) {
    let (producer, consumer) = RingBuffer::new(ROOM);
    (TimesSender(producer), TimesReceiver(consumer))
}

impl TimesSender {
    /// Hands a cycle's times over; they are lost where the main thread is seconds behind. Never waits.
    pub(crate) fn send(&mut self, times: CycleTimes) {
        let _ = self.0.push(times);
    }
}

impl TimesReceiver {
    fn next(&mut self) -> Option<CycleTimes> {
        self.0.pop().ok()
    }
}
