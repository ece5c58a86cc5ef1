//! The buses of a configuration, opened: on CAN interfaces or on multicast groups.

use super::translation::Translation;
use super::{Bus, BusCounters, Line, Member, SocketCan, UdpMulticast, Waiting};
use can_codec::{Frames, Gather, Table};
use drives::family::translation::{Actuator, Reports};
use problem::{Problem, Problems};
use robot_config::{BusParameters, Carrier};
use std::io;

/// An obstacle to opening the buses.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Interfaces that are missing, down, or not able to carry the bus: all of them.
    #[error("{0}")]
    Interfaces(Problems),
    /// The kernel has no CAN sockets.
    #[error(
        "this kernel has no CAN sockets ({0}); `modprobe can_raw`, or a kernel with \
         CONFIG_CAN_RAW; `torqued demo` and `torqued run --simulate` need none"
    )]
    NoCan(io::Error),
    /// A failed call of the socket's set-up, and its error.
    #[error("CAN socket: {0}: {1}")]
    Socket(&'static str, io::Error),
    /// A failed call of the set-up of a multicast group, and its error.
    #[error("UDP group {0}: {1}: {2}")]
    Group(String, &'static str, io::Error),
}

/// The buses of a robot, all of one kind. Frames of actuators are turned into the loop's messages as
/// they arrive, and back as they leave.
pub enum Network {
    /// On CAN interfaces.
    SocketCan(SocketCan),
    /// On multicast groups.
    UdpMulticast(UdpMulticast),
}

impl Network {
    /// Opens the buses, numbered in the order of the configuration.
    ///
    /// # Errors
    /// Interfaces that cannot be used, and the system's refusals.
    pub fn open(buses: &[BusParameters]) -> Result<Self, OpenError> {
        let mut lines = Vec::new();
        let mut members = Vec::new();
        for bus in buses {
            let place = &bus.interface_place;
            match &bus.carrier {
                Carrier::SocketCan(interface) => lines.push(Line {
                    place,
                    interface,
                    fd: bus.fd,
                }),
                Carrier::UdpMulticast(group) => members.push(Member { place, group }),
            }
        }
        if members.is_empty() {
            SocketCan::open(&lines).map(Self::SocketCan)
        } else {
            UdpMulticast::open(&members).map(Self::UdpMulticast)
        }
    }

    /// Hears from now on only what CANopen nodes say besides process data: emergencies, answers by
    /// SDO, heartbeats. On a multicast group everything is heard.
    ///
    /// # Errors
    /// The system's refusal.
    pub fn hear_only_nodes(&mut self) -> Result<(), OpenError> {
        match self {
            Self::SocketCan(bus) => bus.hear_only(&[0x080, 0x580, 0x700]),
            Self::UdpMulticast(_) => Ok(()),
        }
    }
}

impl Waiting for Network {
    fn wait(&mut self, until_ns: u64) -> bool {
        match self {
            Self::SocketCan(bus) => bus.wait(until_ns),
            Self::UdpMulticast(bus) => bus.wait(until_ns),
        }
    }
}

impl Network {
    /// Turns frames of these actuators into the loop's messages from now on, and back. Returns what
    /// they tell besides; none: there are none.
    ///
    /// # Errors
    /// A family that there is not.
    pub fn translate(&mut self, actuators: &[Actuator]) -> Result<Option<Reports>, Problem> {
        *self.translation() = Translation::new(actuators)?;
        Ok(self.translation().as_ref().map(Translation::reports))
    }

    fn translation(&mut self) -> &mut Option<Translation> {
        match self {
            Self::SocketCan(bus) => bus.translation(),
            Self::UdpMulticast(bus) => bus.translation(),
        }
    }

    fn send_as_is(&mut self, frames: &Frames) -> usize {
        match self {
            Self::SocketCan(bus) => bus.send(frames),
            Self::UdpMulticast(bus) => bus.send(frames),
        }
    }
}

impl Bus for Network {
    fn send(&mut self, frames: &Frames) -> usize {
        let Some(mut translation) = self.translation().take() else {
            return self.send_as_is(frames);
        };
        let leaving = translation.leaving(frames);
        let refused = leaving.len().saturating_sub(self.send_as_is(leaving));
        *self.translation() = Some(translation);
        frames.len().saturating_sub(refused)
    }

    fn receive(&mut self, rx: &mut Frames, gather: &mut Gather, table: &Table, until_ns: u64) {
        match self {
            Self::SocketCan(bus) => bus.receive(rx, gather, table, until_ns),
            Self::UdpMulticast(bus) => bus.receive(rx, gather, table, until_ns),
        }
    }

    fn counters(&self) -> BusCounters {
        match self {
            Self::SocketCan(bus) => bus.counters(),
            Self::UdpMulticast(bus) => bus.counters(),
        }
    }

    fn now_ns(&self) -> u64 {
        match self {
            Self::SocketCan(bus) => bus.now_ns(),
            Self::UdpMulticast(bus) => bus.now_ns(),
        }
    }
}
