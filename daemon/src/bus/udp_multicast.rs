//! CAN frames as datagrams to a multicast group, one frame in each, as python-can's `udp_multicast`
//! sends them: the bus of simulated robots that are other people's programs.
//!
//! It is no bus for a real robot. Datagrams have no priority, any program on the machine may send
//! them, and a lost one is not sent again; those lost in this socket's own queue are counted, those
//! lost elsewhere show by what is missing.
//!
//! Each bus has two sockets. What is sent comes back to the group's members on this machine, and so to
//! the sender; python-can's sockets all send from the group's port, so neither address nor port
//! would distinguish one sender from another. Here a socket of its own sends, whose port nobody
//! else has: what comes from there is our own, and is passed over. The kernel stamps each datagram
//! as it arrives, as it does CAN frames.

use super::messages::{self, BATCH, Messages};
use super::receive_clock::ReceiveClock;
use super::translation::Translation;
use super::{Bus, BusCounters, OpenError, Sockets, deliver, receive_until};
use crate::real_time::monotonic_ns;
use can_codec::{DATAGRAM_BYTES, Frame, Frames, Gather, Table, from_datagram, to_datagram};
use nix::ifaddrs::{InterfaceAddress, getifaddrs};
use nix::net::if_::InterfaceFlags;
use problem::{Problem, Problems, listed};
use robot_config::UdpGroup;
use socket2::{Domain, Protocol, Socket, Type};
use std::io;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::AsFd;

/// Room for a received datagram, bytes: python-can's longest has 220, and the name of a channel more.
const ROOM: usize = 512;

/// A bus of the config and its group.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Member<'a> {
    /// Place of the interface in the config, as `file:line: key`: begins messages about it.
    pub place: &'a str,
    /// The group, and the way to it.
    pub group: &'a UdpGroup,
}

/// The buses of a robot on multicast groups.
pub struct UdpMulticast {
    groups: Vec<Group>,
    polled: Vec<libc::pollfd>,
    clock: ReceiveClock,
    counters: BusCounters,
    /// Of actuators' frames, if there are any.
    translation: Option<Translation>,
}

/// One bus.
struct Group {
    bus: u8,
    receiver: Socket,
    sender: Socket,
    /// Where our own datagrams come from.
    own: SocketAddrV4,
    /// Datagrams of other machines are refused.
    local: bool,
    received: Messages<libc::sockaddr_in, [u8; ROOM]>,
    sending: Messages<[u8; 0], [u8; DATAGRAM_BYTES]>,
    /// Number of messages in `received`, and the first that was not looked at.
    count: usize,
    next: usize,
    /// The socket was empty when it was last read.
    drained: bool,
    /// The next frame and the kernel's time of it on CLOCK_REALTIME, ns.
    head: Option<(Frame, u64)>,
    /// The kernel's count of drops when last seen.
    kernel_dropped: u32,
}

impl UdpMulticast {
    /// Opens the buses, numbered in the order of `members`.
    ///
    /// # Errors
    /// Interfaces that cannot be used, and the system's refusals.
    pub fn open(members: &[Member<'_>]) -> Result<Self, OpenError> {
        let found: Vec<InterfaceAddress> = getifaddrs().map(Iterator::collect).unwrap_or_default();
        let addresses = match_interfaces(members, &found).map_err(OpenError::Interfaces)?;
        let mut groups = Vec::new();
        for (bus, (member, address)) in members.iter().zip(addresses).enumerate() {
            let UdpGroup { group, port, .. } = member.group;
            let failed =
                |(call, error)| OpenError::Group(format!("{group}:{port}"), call, advised(error));
            groups.push(Group::open(bus as u8, member.group, address).map_err(failed)?);
        }
        Ok(Self {
            polled: groups
                .iter()
                .map(|group| messages::readable(group.receiver.as_fd()))
                .collect(),
            groups,
            clock: ReceiveClock::new(monotonic_ns()),
            counters: BusCounters::default(),
            translation: None,
        })
    }

    /// Waits for a datagram until `until_ns`; true if one is there.
    pub fn wait(&mut self, until_ns: u64) -> bool {
        self.groups.iter().any(|group| group.head.is_some())
            || messages::wait(&mut self.polled, until_ns)
    }

    /// The translation of actuators' frames.
    pub(super) fn translation(&mut self) -> &mut Option<Translation> {
        &mut self.translation
    }

    /// Looks for the next frame of every bus; true if there is one.
    fn look(&mut self) -> bool {
        let mut fresh = false;
        for group in &mut self.groups {
            fresh |= group.look(&mut self.counters);
        }
        if fresh {
            self.clock.update();
        }
        self.groups.iter().any(|group| group.head.is_some())
    }
}

impl Group {
    /// `interface`: the address of the network interface; none: that of the route to the group.
    fn open(
        bus: u8,
        parameters: &UdpGroup,
        interface: Option<Ipv4Addr>,
    ) -> Result<Self, (&'static str, io::Error)> {
        let UdpGroup { group, port, .. } = *parameters;
        let to = SocketAddrV4::new(group, port);
        let sender = socket().map_err(|e| ("socket", e))?;
        let ttl = u32::from(parameters.hop_limit);
        (sender.set_multicast_ttl_v4(ttl)).map_err(|e| ("IP_MULTICAST_TTL", e))?;
        if let Some(address) = &interface {
            (sender.set_multicast_if_v4(address)).map_err(|e| ("IP_MULTICAST_IF", e))?;
        }
        sender.connect(&to.into()).map_err(|e| ("connect", e))?;
        let own = sender.local_addr().map_err(|e| ("getsockname", e))?;
        let own = own.as_socket_ipv4().unwrap_or(to);
        let receiver = socket().map_err(|e| ("socket", e))?;
        // As python-can: several programs of this machine may be members.
        (receiver.set_reuse_address(true)).map_err(|e| ("SO_REUSEADDR", e))?;
        (receiver.set_reuse_port(true)).map_err(|e| ("SO_REUSEPORT", e))?;
        // No datagram of an interface that only another program has joined.
        (receiver.set_multicast_all_v4(false)).map_err(|e| ("IP_MULTICAST_ALL", e))?;
        receiver.bind(&to.into()).map_err(|e| ("bind", e))?;
        let joined = receiver.join_multicast_v4(&group, &interface.unwrap_or(*own.ip()));
        joined.map_err(|e| ("IP_ADD_MEMBERSHIP", e))?;
        messages::stamp_and_count(receiver.as_fd())?;
        Ok(Self {
            bus,
            receiver,
            sender,
            own,
            local: parameters.hop_limit == 0,
            received: Messages::new(),
            sending: Messages::new(),
            count: 0,
            next: 0,
            drained: false,
            head: None,
            kernel_dropped: 0,
        })
    }

    /// Moves to the next frame if there is none at hand; reads at most one batch for it. True if it
    /// has read one.
    fn look(&mut self, counters: &mut BusCounters) -> bool {
        self.take(counters);
        if self.head.is_some() || self.drained {
            return false;
        }
        let count = self.received.receive(self.receiver.as_fd()).unwrap_or(0);
        (self.count, self.next, self.drained) = (count, 0, count < BATCH);
        self.take(counters);
        count > 0
    }

    /// Takes the next frame from the messages that were read.
    fn take(&mut self, counters: &mut BusCounters) {
        while self.head.is_none() && self.next < self.count {
            let Some(message) = self.received.received(self.next) else {
                return;
            };
            self.next += 1;
            if let Some(dropped) = message.dropped {
                counters.dropped += u64::from(dropped.wrapping_sub(self.kernel_dropped));
                self.kernel_dropped = dropped;
            }
            let address = Ipv4Addr::from(u32::from_be(message.address.sin_addr.s_addr));
            let port = u16::from_be(message.address.sin_port);
            if (address, port) == (*self.own.ip(), self.own.port()) {
                continue;
            }
            let here =
                address == *self.own.ip() || address.is_loopback() || address.is_unspecified();
            let content = message.content.get(..message.length).unwrap_or_default();
            let allowed = !message.cut && (here || !self.local);
            match from_datagram(self.bus, content).filter(|_| allowed) {
                Some(frame) => self.head = Some((frame, message.real_ns)),
                None => counters.refused_datagrams += 1,
            }
        }
    }

    /// Sends frames of this bus, at most [`BATCH`]; returns the number accepted.
    fn send(&mut self, frames: &[Frame], counters: &mut BusCounters) -> usize {
        let mut count = 0;
        for frame in frames {
            let Some((_, content)) = self.sending.at(count) else {
                break;
            };
            match to_datagram(frame, content) {
                Some(length) => {
                    self.sending.ready(count, length);
                    count += 1;
                }
                None => counters.send_failed += 1,
            }
        }
        let socket = self.sender.as_fd();
        let refused = |_, errno| counters.count_refused(errno);
        self.sending.send(socket, count, refused)
    }
}

impl Sockets for UdpMulticast {
    fn wait(&mut self, until_ns: u64) -> bool {
        Self::wait(self, until_ns)
    }

    /// The frames of all buses in the order of their arrival.
    fn read(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table) -> bool {
        let before = monotonic_ns();
        for group in &mut self.groups {
            group.drained = false;
        }
        for _ in 0..BATCH {
            if !self.look() {
                // The bytes read, if any, were no frame: they count as a batch.
                let drained = self.groups.iter().all(|group| group.drained);
                if drained {
                    self.clock.seen_empty(before);
                }
                return !drained;
            }
            let heads = self.groups.iter_mut().filter(|group| group.head.is_some());
            let first = heads.min_by_key(|group| group.head.map(|(_, real_ns)| real_ns));
            if let Some((mut frame, real_ns)) = first.and_then(|group| group.head.take()) {
                frame.stamp_ns = self.clock.stamp(real_ns);
                if Translation::arrived(&mut self.translation, &mut frame) {
                    deliver(frame, rx, gather, table, &mut self.counters);
                }
            }
        }
        true
    }
}

impl Bus for UdpMulticast {
    fn send(&mut self, frames: &Frames) -> usize {
        let mut accepted = 0;
        let same_bus = |one: &Frame, next: &Frame| one.bus == next.bus;
        for run in frames.as_slice().chunk_by(same_bus) {
            for chunk in run.chunks(BATCH) {
                let bus = chunk.first().map_or(0, |frame| usize::from(frame.bus));
                match self.groups.get_mut(bus) {
                    Some(group) => accepted += group.send(chunk, &mut self.counters),
                    None => self.counters.send_failed += chunk.len() as u64,
                }
            }
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

fn socket() -> io::Result<Socket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// The error with the way out, where the machine has no route to the group.
fn advised(error: io::Error) -> io::Error {
    let number = error.raw_os_error();
    if ![Some(libc::ENETUNREACH), Some(libc::ENODEV)].contains(&number) {
        return error;
    }
    io::Error::other(format!(
        "{error}; this machine has no route to the group: name an interface (bus.interface), or, for \
         programs on this machine alone, `ip link set lo up multicast on && ip route add 224.0.0.0/4 \
         dev lo`"
    ))
}

/// The address of each member's interface, if it names one; or every obstacle.
fn match_interfaces(
    members: &[Member<'_>],
    found: &[InterfaceAddress],
) -> Result<Vec<Option<Ipv4Addr>>, Problems> {
    let mut problems = Vec::new();
    let mut addresses = Vec::new();
    for member in members {
        let named = member.group.interface.as_deref();
        match named.map(|name| address(name, found)).transpose() {
            Ok(address) => addresses.push(address),
            Err(problem) => problems.push(problem.of(member.place)),
        }
    }
    if problems.is_empty() {
        Ok(addresses)
    } else {
        Err(Problems(problems))
    }
}

fn address(name: &str, found: &[InterfaceAddress]) -> Result<Ipv4Addr, Problem> {
    let its = || found.iter().filter(|it| it.interface_name == name);
    let first = its().find_map(|it| Some(it.address.as_ref()?.as_sockaddr_in()?.ip()));
    let up = its().any(|it| it.flags.contains(InterfaceFlags::IFF_UP));
    match first {
        Some(address) if up => Ok(address),
        _ => {
            let what = match its().next() {
                None => "does not exist",
                Some(_) if !up => "is down",
                Some(_) => "has no IPv4 address",
            };
            let with_address = |it: &&InterfaceAddress| {
                it.address
                    .as_ref()
                    .is_some_and(|a| a.as_sockaddr_in().is_some())
            };
            let others = found.iter().filter(with_address);
            let names = listed(others.map(|it| it.interface_name.as_str()));
            Err(Problem::new(format!("{name} {what}"), names))
        }
    }
}
