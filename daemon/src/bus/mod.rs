//! Sending and receiving of frames.
//!
//! The loop knows only [`Bus`]. Behind it stands [`SocketCan`] (all CAN interfaces through one
//! socket), [`UdpMulticast`] (datagrams in python-can's format, for simulators of other people),
//! [`in_process`] (no kernel: two threads, or a simulated robot called in lock-step), or
//! [`FaultInjector`] around one of them.

mod fault_injector;
pub mod in_process;
mod messages;
mod network;
mod receive_clock;
mod socketcan;
mod translation;
mod udp_multicast;

pub use fault_injector::{FaultInjector, Faults, Injected};
pub use in_process::{InProcess, Listener, LockStep, Peer};
pub use network::{Network, OpenError};
pub use socketcan::{Line, SocketCan};
pub use udp_multicast::{Member, UdpMulticast};

use crate::real_time::monotonic_ns;
use can_codec::{Frames, Gather, MAX_FRAMES, Table};

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
    /// Datagrams that are no data frames, or come from a machine that is not allowed to send any.
    pub refused_datagrams: u64,
}

impl BusCounters {
    /// Counts a frame that the kernel did not take, by its errno.
    fn count_refused(&mut self, errno: i32) {
        use libc::{EADDRNOTAVAIL, ENETDOWN, ENETUNREACH, ENODEV, ENXIO};
        self.send_failed += 1;
        if [ENETDOWN, ENETUNREACH, ENXIO, ENODEV, EADDRNOTAVAIL].contains(&errno) {
            self.link_down += 1;
        }
    }
}

/// The newest failure to send.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SendFailure {
    /// The bus.
    pub bus: u8,
    /// The kernel's answer: ENOBUFS (queue full: not acknowledged, or `txqueuelen` too short),
    /// ENETDOWN, ENXIO (interface gone), EINVAL.
    pub errno: i32,
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

/// A bus on which a thread waits that has nothing else to do.
pub trait Waiting: Bus {
    /// Waits for a frame until `until_ns`; true if one is there.
    fn wait(&mut self, until_ns: u64) -> bool;
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

/// Sockets that are read batch by batch.
trait Sockets {
    /// Waits for a frame until `until_ns`; true if one is there.
    fn wait(&mut self, until_ns: u64) -> bool;

    /// Reads one batch; true if more may be waiting.
    fn read(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table) -> bool;
}

/// Batches that are read once the deadline has passed, at most: a flood of what is not handed over
/// has an end, too.
const LAST_BATCHES: usize = 2 * MAX_FRAMES / messages::BATCH;

/// [`Bus::receive`] of sockets.
fn receive_until(
    sockets: &mut impl Sockets,
    rx: &mut Frames,
    gather: &mut Gather,
    table: &Table,
    until_ns: u64,
) {
    let mut last = 0;
    loop {
        let in_time = monotonic_ns() < until_ns;
        if in_time && !gather.complete() && !sockets.wait(until_ns) {
            continue;
        }
        let more = sockets.read(rx, gather, table);
        // After the deadline, frames without room in `rx` stay for the next call: so a flood has
        // an end, and a list of whole batches works off a backlog without loss.
        if in_time && !gather.complete() {
            continue;
        }
        last += 1;
        if !more || rx.is_full() || last == LAST_BATCHES {
            return;
        }
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
