//! Every CAN interface through one raw socket.
//!
//! The socket is bound to no interface, so it receives the frames of all; a frame's address contains
//! its interface.
//! One system call reads or writes the frames of all buses, up to [`BATCH`] at a time. The kernel
//! stamps each frame as it arrives, counts dropped frames, and reports the controllers' error frames.
//! The socket does not receive its own frames; other programs on the same interface do.

mod clock;
mod interface;
mod messages;

use super::{Bus, BusCounters, deliver};
use crate::real_time::monotonic_ns;
use can_codec::{Frames, Gather, Table};
use clock::ReceiveClock;
use libc::c_int;
use messages::{BATCH, Messages, errno};
use problem::Problems;
use robot_config::BusParameters;
use std::io;
use std::mem::{size_of, zeroed};
use std::os::fd::{AsFd, AsRawFd, FromRawFd, OwnedFd};
use std::path::Path;
use std::ptr;

/// Room for frames between two reads, bytes as the kernel counts them (about 800 a frame): some
/// 20 ms of eight buses at their fullest.
const RECEIVE_BUFFER: c_int = 4 * 1024 * 1024;
const NS_PER_S: u64 = 1_000_000_000;

/// A bus of the config and the name of its interface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Line<'a> {
    /// Place of the interface in the config, as `file:line: key`: begins messages about it.
    pub place: &'a str,
    /// `bus.interface`.
    pub interface: &'a str,
    /// `bus.fd`: CAN FD frames must be able to pass.
    pub fd: bool,
}

impl<'a> From<&'a BusParameters> for Line<'a> {
    fn from(bus: &'a BusParameters) -> Self {
        Self {
            place: &bus.interface_place,
            interface: &bus.interface,
            fd: bus.fd,
        }
    }
}

/// An obstacle to opening the buses.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Interfaces that are missing, down, or not able to carry CAN FD: all of them.
    #[error("{0}")]
    Interfaces(Problems),
    /// The kernel has no CAN sockets.
    #[error(
        "this kernel has no CAN sockets ({0}); `modprobe can_raw`, or a kernel with \
         CONFIG_CAN_RAW; `torqued demo` needs none"
    )]
    NoCan(io::Error),
    /// A failed call of the socket's set-up, and its error.
    #[error("CAN socket: {0}: {1}")]
    Socket(&'static str, io::Error),
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

/// The buses of a robot on SocketCAN.
pub struct SocketCan {
    socket: OwnedFd,
    /// Index of each bus's interface.
    interfaces: Vec<c_int>,
    messages: Messages,
    /// Bus of each message in `messages` that is being sent.
    sending: [u8; BATCH],
    clock: ReceiveClock,
    counters: BusCounters,
    /// The kernel's count of drops when last seen.
    kernel_dropped: u32,
    send_failure: Option<SendFailure>,
}

impl SocketCan {
    /// Opens the buses, numbered in the order of `lines`.
    pub fn open(lines: &[Line<'_>]) -> Result<Self, OpenError> {
        let found = interface::list(Path::new("/sys/class/net"));
        // The socket first: a kernel without CAN is the cause, a missing interface its effect.
        let socket = open_socket()?;
        let interfaces = interface::match_lines(lines, &found).map_err(OpenError::Interfaces)?;
        set_options(&socket)?;
        bind_to_all(&socket)?;
        Ok(Self {
            socket,
            interfaces: interfaces.iter().map(|it| it.index).collect(),
            messages: Messages::new(),
            sending: [0; BATCH],
            clock: ReceiveClock::new(monotonic_ns()),
            counters: BusCounters::default(),
            kernel_dropped: 0,
            send_failure: None,
        })
    }

    /// Waits for a frame until `until_ns`; true if one is there.
    pub fn wait(&self, until_ns: u64) -> bool {
        let left = until_ns.saturating_sub(monotonic_ns());
        let timeout = libc::timespec {
            tv_sec: (left / NS_PER_S) as libc::time_t,
            tv_nsec: (left % NS_PER_S) as libc::c_long,
        };
        let mut poll = libc::pollfd {
            fd: self.socket.as_raw_fd(),
            events: libc::POLLIN,
            revents: 0,
        };
        // SAFETY: one pollfd and a timeout, both alive during the call; no signal mask.
        let ready = unsafe { libc::ppoll(&raw mut poll, 1, &raw const timeout, ptr::null()) };
        ready > 0
    }

    /// The newest failure to send a frame.
    #[must_use]
    pub fn send_failure(&self) -> Option<SendFailure> {
        self.send_failure
    }

    /// Reads one batch; returns its number of frames.
    fn read_batch(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table) -> usize {
        let before = monotonic_ns();
        let count = self.messages.receive(self.socket.as_fd()).unwrap_or(0);
        if count > 0 {
            self.clock.update();
        }
        for at in 0..count {
            let Some((mut frame, origin)) = self.messages.received(at) else {
                continue;
            };
            if let Some(dropped) = origin.dropped {
                let more = dropped.wrapping_sub(self.kernel_dropped);
                self.counters.dropped += u64::from(more);
                self.kernel_dropped = dropped;
            }
            // The socket also receives from interfaces of no bus: such frames are left out.
            let is_ours = |&index: &c_int| index == origin.interface;
            let Some(bus) = self.interfaces.iter().position(is_ours) else {
                continue;
            };
            frame.bus = bus as u8;
            frame.stamp_ns = self.clock.stamp(origin.real_ns);
            deliver(frame, rx, gather, table, &mut self.counters);
        }
        if count < BATCH {
            self.clock.seen_empty(before);
        }
        count
    }

    /// Sends the first `count` messages. A frame that the kernel refuses is counted and passed
    /// over: those behind it may belong to another bus.
    fn send_batch(&mut self, count: usize) -> usize {
        let (mut at, mut accepted) = (0, 0);
        while at < count {
            match self.messages.send(self.socket.as_fd(), at, count) {
                Ok(sent) if sent > 0 => {
                    at += sent;
                    accepted += sent;
                }
                Err(libc::EINTR) => {}
                Ok(_) => self.refused(&mut at, 0),
                Err(errno) => self.refused(&mut at, errno),
            }
        }
        accepted
    }

    fn refused(&mut self, at: &mut usize, errno: i32) {
        let bus = self.sending.get(*at).copied().unwrap_or(0);
        self.send_failure = Some(SendFailure { bus, errno });
        self.counters.send_failed += 1;
        if matches!(errno, libc::ENETDOWN | libc::ENXIO | libc::ENODEV) {
            self.counters.link_down += 1;
        }
        *at += 1;
    }
}

impl Bus for SocketCan {
    fn send(&mut self, frames: &Frames) -> usize {
        let mut accepted = 0;
        for chunk in frames.as_slice().chunks(BATCH) {
            let mut count = 0;
            for frame in chunk {
                let interface = self.interfaces.get(usize::from(frame.bus));
                if interface.is_some_and(|&it| self.messages.write(count, frame, it)) {
                    self.sending[count] = frame.bus;
                    count += 1;
                } else {
                    self.counters.send_failed += 1;
                    self.send_failure = Some(SendFailure {
                        bus: frame.bus,
                        errno: libc::EINVAL,
                    });
                }
            }
            accepted += self.send_batch(count);
        }
        self.counters.sent += accepted as u64;
        accepted
    }

    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64) {
        loop {
            let in_time = monotonic_ns() < until_ns;
            if in_time && !gather.complete() && !self.wait(until_ns) {
                continue;
            }
            let more = self.read_batch(rx, gather, table) == BATCH;
            // After the deadline, frames without room in `rx` stay for the next call: so a flood has
            // an end, and a list of whole batches works off a backlog without loss.
            let waiting = in_time && !gather.complete();
            if !waiting && (!more || rx.is_full()) {
                return;
            }
        }
    }

    fn counters(&self) -> BusCounters {
        self.counters
    }

    fn now_ns(&self) -> u64 {
        monotonic_ns()
    }
}

fn open_socket() -> Result<OwnedFd, OpenError> {
    let kind = libc::SOCK_RAW | libc::SOCK_NONBLOCK | libc::SOCK_CLOEXEC;
    // SAFETY: takes no pointer.
    let number = unsafe { libc::socket(libc::AF_CAN, kind, libc::CAN_RAW) };
    if number >= 0 {
        // SAFETY: a descriptor that was just opened and that nobody else owns.
        return Ok(unsafe { OwnedFd::from_raw_fd(number) });
    }
    Err(match errno() {
        libc::EAFNOSUPPORT | libc::EPROTONOSUPPORT => OpenError::NoCan(io::Error::last_os_error()),
        number => OpenError::Socket("socket", io::Error::from_raw_os_error(number)),
    })
}

fn set_options(socket: &OwnedFd) -> Result<(), OpenError> {
    let (raw, any) = (libc::SOL_CAN_RAW, libc::SOL_SOCKET);
    let every_error = libc::CAN_ERR_MASK as c_int;
    let set = |level, name, value| set_option(socket, level, name, value);
    // FD frames also where a bus has fd = false: there they are counted as unknown.
    set(raw, libc::CAN_RAW_FD_FRAMES, 1).map_err(|e| OpenError::Socket("CAN_RAW_FD_FRAMES", e))?;
    set(raw, libc::CAN_RAW_ERR_FILTER, every_error)
        .map_err(|e| OpenError::Socket("CAN_RAW_ERR_FILTER", e))?;
    set(any, libc::SO_TIMESTAMPNS, 1).map_err(|e| OpenError::Socket("SO_TIMESTAMPNS", e))?;
    set(any, libc::SO_RXQ_OVFL, 1).map_err(|e| OpenError::Socket("SO_RXQ_OVFL", e))?;
    // Beyond the system's limit only for the privileged; the limit itself will do.
    set(any, libc::SO_RCVBUFFORCE, RECEIVE_BUFFER)
        .or_else(|_| set(any, libc::SO_RCVBUF, RECEIVE_BUFFER))
        .map_err(|e| OpenError::Socket("SO_RCVBUF", e))
}

fn set_option(socket: &OwnedFd, level: c_int, name: c_int, value: c_int) -> io::Result<()> {
    // SAFETY: the value is alive during the call and its size is stated.
    let answer = unsafe {
        libc::setsockopt(
            socket.as_raw_fd(),
            level,
            name,
            (&raw const value).cast(),
            size_of::<c_int>() as libc::socklen_t,
        )
    };
    if answer == 0 {
        Ok(())
    } else {
        Err(io::Error::last_os_error())
    }
}

fn bind_to_all(socket: &OwnedFd) -> Result<(), OpenError> {
    // SAFETY: a plain C struct, for which zero is a valid value.
    let mut address: libc::sockaddr_can = unsafe { zeroed() };
    address.can_family = libc::AF_CAN as libc::sa_family_t;
    // SAFETY: the address is alive during the call and its size is stated.
    let answer = unsafe {
        libc::bind(
            socket.as_raw_fd(),
            (&raw const address).cast(),
            size_of::<libc::sockaddr_can>() as libc::socklen_t,
        )
    };
    if answer == 0 {
        Ok(())
    } else {
        Err(OpenError::Socket("bind", io::Error::last_os_error()))
    }
}
