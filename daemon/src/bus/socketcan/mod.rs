//! Every CAN interface through one raw socket.
//!
//! The socket is bound to no interface, so it receives the frames of all; a frame's address contains
//! its interface.
//! One system call reads or writes the frames of all buses, up to [`BATCH`] at a time. The kernel
//! stamps each frame as it arrives, counts dropped frames, and reports the controllers' error frames.
//! The socket does not receive its own frames; other programs on the same interface do.

mod interface;

use super::messages::{self, BATCH, Messages, Received, errno, set_option};
use super::receive_clock::ReceiveClock;
use super::translation::Translation;
use super::{Bus, BusCounters, OpenError, SendFailure, Sockets, deliver, receive_until};
use crate::real_time::monotonic_ns;
use can_codec::{Frame, Frames, Gather, Table};
use libc::c_int;
use std::io;
use std::mem::{size_of, zeroed};
use std::os::fd::{AsFd, AsRawFd, FromRawFd, OwnedFd};
use std::path::Path;

/// Data of a classic frame, bytes.
const CLASSIC_DATA: usize = 8;

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

/// The buses of a robot on SocketCAN.
pub struct SocketCan {
    socket: OwnedFd,
    /// Index of each bus's interface.
    interfaces: Vec<c_int>,
    messages: Messages<libc::sockaddr_can, libc::canfd_frame>,
    /// Bus of each message in `messages` that is being sent.
    sending: [u8; BATCH],
    clock: ReceiveClock,
    counters: BusCounters,
    /// Of actuators' frames, if there are any.
    translation: Option<Translation>,
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
            translation: None,
            kernel_dropped: 0,
            send_failure: None,
        })
    }

    /// Waits for a frame until `until_ns`; true if one is there.
    pub fn wait(&self, until_ns: u64) -> bool {
        messages::wait(&mut [messages::readable(self.socket.as_fd())], until_ns)
    }

    /// Receives from now on only frames of 11-bit identifiers that begin, bits 7 to 10, as one of
    /// `first`.
    pub(super) fn hear_only(&self, first: &[u32]) -> Result<(), OpenError> {
        let mask = 0x780 | libc::CAN_EFF_FLAG | libc::CAN_RTR_FLAG;
        let filter = |&can_id| libc::can_filter {
            can_id,
            can_mask: mask,
        };
        let filters: Vec<_> = first.iter().map(filter).collect();
        // SAFETY: the filters are alive during the call and their size is stated.
        let answer = unsafe {
            libc::setsockopt(
                self.socket.as_raw_fd(),
                libc::SOL_CAN_RAW,
                libc::CAN_RAW_FILTER,
                filters.as_ptr().cast(),
                std::mem::size_of_val(&filters[..]) as libc::socklen_t,
            )
        };
        if answer == 0 {
            Ok(())
        } else {
            let error = io::Error::last_os_error();
            Err(OpenError::Socket("CAN_RAW_FILTER", error))
        }
    }

    /// The translation of actuators' frames.
    pub(super) fn translation(&mut self) -> &mut Option<Translation> {
        &mut self.translation
    }

    /// The newest failure to send a frame.
    #[must_use]
    pub fn send_failure(&self) -> Option<SendFailure> {
        self.send_failure
    }

    /// The frame of message `at`, if that is one of our buses.
    fn frame(&mut self, at: usize) -> Option<Frame> {
        let message = self.messages.received(at)?;
        if let Some(dropped) = message.dropped {
            let more = dropped.wrapping_sub(self.kernel_dropped);
            self.counters.dropped += u64::from(more);
            self.kernel_dropped = dropped;
        }
        // The socket also receives from interfaces of no bus: such frames are left out.
        let interface = message.address.can_ifindex;
        let bus = self.interfaces.iter().position(|&it| it == interface)?;
        let mut frame = read(&message)?;
        frame.bus = bus as u8;
        frame.stamp_ns = self.clock.stamp(message.real_ns);
        Some(frame)
    }

    /// Writes the frame as message `at`; false if no interface can carry it.
    fn write(&mut self, at: usize, frame: &Frame) -> bool {
        let Some(&interface) = self.interfaces.get(usize::from(frame.bus)) else {
            return false;
        };
        let (capacity, size) = if frame.fd {
            (can_codec::MAX_DATA, libc::CANFD_MTU)
        } else {
            (CLASSIC_DATA, libc::CAN_MTU)
        };
        if frame.error || usize::from(frame.len) > capacity {
            return false;
        }
        let Some((address, raw)) = self.messages.at(at) else {
            return false;
        };
        address.can_family = libc::AF_CAN as libc::sa_family_t;
        address.can_ifindex = interface;
        raw.can_id = frame.id;
        raw.len = frame.len;
        // Data bytes at the data bit rate; the flag means nothing in a classic frame.
        raw.flags = if frame.fd { libc::CANFD_BRS as u8 } else { 0 };
        raw.data = frame.data;
        self.messages.ready(at, size);
        true
    }

    /// Sends the first `count` messages; returns the number that the kernel took.
    fn send_batch(&mut self, count: usize) -> usize {
        let Self {
            socket,
            messages,
            sending,
            counters,
            send_failure,
            ..
        } = self;
        messages.send(socket.as_fd(), count, |at, errno| {
            let bus = sending.get(at).copied().unwrap_or(0);
            *send_failure = Some(SendFailure { bus, errno });
            counters.count_refused(errno);
        })
    }
}

/// The frame of a message, without bus and stamp; `None` if it is neither a CAN nor a CAN FD frame.
fn read(message: &Received<'_, libc::sockaddr_can, libc::canfd_frame>) -> Option<Frame> {
    let fd = match message.length {
        libc::CANFD_MTU => true,
        libc::CAN_MTU => false,
        _ => return None,
    };
    let raw = message.content;
    let error = raw.can_id & libc::CAN_ERR_FLAG != 0;
    let capacity = if fd { raw.data.len() } else { CLASSIC_DATA };
    let mut frame = Frame::zeroed(0, raw.can_id, raw.len.min(capacity as u8), fd);
    frame.error = error;
    if error {
        frame.id &= libc::CAN_ERR_MASK;
    }
    // A remote frame (RTR) has a length but no data. Its flag stays in the id, so that it is
    // unknown to every table, not decoded as a message of zeros.
    let used = usize::from(frame.len);
    if let (Some(to), Some(from)) = (frame.data.get_mut(..used), raw.data.get(..used)) {
        to.copy_from_slice(from);
    }
    Some(frame)
}

impl Sockets for SocketCan {
    fn wait(&mut self, until_ns: u64) -> bool {
        Self::wait(self, until_ns)
    }

    fn read(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table) -> bool {
        let before = monotonic_ns();
        let count = self.messages.receive(self.socket.as_fd()).unwrap_or(0);
        if count > 0 {
            self.clock.update();
        }
        for at in 0..count {
            if let Some(mut frame) = self.frame(at)
                && Translation::arrived(&mut self.translation, &mut frame)
            {
                deliver(frame, rx, gather, table, &mut self.counters);
            }
        }
        if count < BATCH {
            self.clock.seen_empty(before);
        }
        count == BATCH
    }
}

impl Bus for SocketCan {
    fn send(&mut self, frames: &Frames) -> usize {
        let mut accepted = 0;
        for chunk in frames.as_slice().chunks(BATCH) {
            let mut count = 0;
            for frame in chunk {
                if self.write(count, frame) {
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
        receive_until(self, rx, gather, table, until_ns);
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
    let every_error = libc::CAN_ERR_MASK as c_int;
    let set = |name, value| set_option(socket.as_fd(), libc::SOL_CAN_RAW, name, value);
    let failed = |(call, error)| OpenError::Socket(call, error);
    // FD frames also where a bus has fd = false: there they are counted as unknown.
    set(libc::CAN_RAW_FD_FRAMES, 1).map_err(|e| failed(("CAN_RAW_FD_FRAMES", e)))?;
    set(libc::CAN_RAW_ERR_FILTER, every_error).map_err(|e| failed(("CAN_RAW_ERR_FILTER", e)))?;
    messages::stamp_and_count(socket.as_fd()).map_err(failed)
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
