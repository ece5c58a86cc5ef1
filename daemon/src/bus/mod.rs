//! Sending and receiving of frames.
//!
//! The loop knows only [`Bus`]. Behind it stands [`SocketCan`] (all CAN interfaces through one
//! socket), [`in_process`] (no kernel: two threads, or a simulated robot called in lock-step), or
//! [`FaultInjector`] around one of them.

mod fault_injector;
pub mod in_process;
mod socketcan;

pub use fault_injector::{FaultInjector, Faults, Injected};
pub use in_process::{InProcess, LockStep, Peer};
pub use socketcan::{Line, OpenError, SendFailure, SocketCan};

use can_codec::{Frames, Gather, Table};

/// Counts of frames since the bus was opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BusCounters {
    /// Frames handed to the caller, without error frames.
    pub received: u64,
    /// Frames accepted for sending.
    pub sent: u64,
    /// Frames that could not be accepted: the bus is down, or its queue is full.
    pub send_failed: u64,
    /// Error frames of the CAN controllers, handed to the caller as frames with `error` set.
    pub error_frames: u64,
    /// Error frames of controllers that went bus-off.
    pub bus_off: u64,
    /// Frames that could not be accepted because an interface is down or gone.
    pub link_down: u64,
    /// Frames that arrived but found no room, on their way or in the caller's list.
    pub dropped: u64,
}

/// All buses of the robot: a frame carries the number of its bus.
///
/// Neither call allocates or takes a lock.
pub trait Bus {
    /// Sends the frames, in order, without ever waiting; returns the number accepted.
    fn send(&mut self, frames: &Frames) -> usize;

    /// Appends arriving frames to `rx`, in order of arrival, and records them in `gather`. Returns
    /// when `gather` is complete and no more frames are waiting, or `until_ns` has passed.
    ///
    /// With `until_ns` in the past it takes the frames that are waiting. A cycle does so before its SYNC:
    /// an answer of the last cycle would otherwise count as one of this cycle.
    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64);

    /// Counts of frames since the bus was opened.
    fn counters(&self) -> BusCounters;

    /// The time now, on the clock of the frames' stamps and of `until_ns`.
    fn now_ns(&self) -> u64;
}

impl<B: Bus + ?Sized> Bus for Box<B> {
    fn send(&mut self, frames: &Frames) -> usize {
        (**self).send(frames)
    }

    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64) {
        (**self).receive(rx, gather, table, until_ns);
    }

    fn counters(&self) -> BusCounters {
        (**self).counters()
    }

    fn now_ns(&self) -> u64 {
        (**self).now_ns()
    }
}

/// `CAN_ERR_BUSOFF`, in the identifier of an error frame.
const BUS_OFF: u32 = 0x40;

/// Hands a frame that arrived to the caller: into `rx` and `gather` if there is room, and into
/// the counters in any case.
fn deliver(
    frame: can_codec::Frame,
    rx: &mut Frames,
    gather: &mut Gather,
    table: &Table,
    counters: &mut BusCounters,
) {
    if frame.error && frame.id & BUS_OFF != 0 {
        counters.bus_off += 1;
    }
    if !rx.push(frame) {
        counters.dropped += 1;
    } else if frame.error {
        counters.error_frames += 1;
    } else {
        counters.received += 1;
        gather.note(table, &frame);
    }
}
