//! CANopen (CiA 301): what a master says and hears, without a clock or a bus of its own.

pub mod abort;
pub mod bring_up;
pub mod eds;
pub mod emcy;
pub mod pdo;
pub mod sdo;
pub mod server;

use can_codec::Frame;
use core::fmt;

/// Node identifiers, 1 to 127.
pub const NODES: core::ops::RangeInclusive<u8> = 1..=127;

/// COB-ID of NMT commands.
pub const NMT_ID: u32 = 0x000;
/// COB-ID of SYNC.
pub const SYNC_ID: u32 = 0x080;
/// COB-ID of emergencies, plus the node.
pub const EMCY_ID: u32 = 0x080;
/// COB-ID of a node's answers by SDO, plus the node.
pub const SDO_ANSWER_ID: u32 = 0x580;
/// COB-ID of requests by SDO, plus the node.
pub const SDO_REQUEST_ID: u32 = 0x600;
/// COB-ID of boot-up and heartbeat, plus the node.
pub const HEARTBEAT_ID: u32 = 0x700;

/// An entry of an object dictionary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Object {
    /// Index.
    pub index: u16,
    /// Sub-index.
    pub sub: u8,
}

impl Object {
    /// The entry at that index and sub-index.
    #[must_use]
    pub const fn new(index: u16, sub: u8) -> Self {
        Self { index, sub }
    }
}

impl fmt::Display for Object {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04X}:{:02X}", self.index, self.sub)
    }
}

/// Commands of network management.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nmt {
    /// To operational: process data are exchanged.
    Start,
    /// To stopped: nothing but network management is heard.
    Stop,
    /// To pre-operational: set-up by SDO, no process data.
    PreOperational,
    /// The node starts anew altogether.
    Reset,
    /// The node's communication starts anew, with the settings of its power-on.
    ResetCommunication,
}

impl Nmt {
    /// The command's frame for one node of a bus.
    #[must_use]
    pub fn frame(self, bus: u8, node: u8) -> Frame {
        let command = match self {
            Self::Start => 0x01,
            Self::Stop => 0x02,
            Self::PreOperational => 0x80,
            Self::Reset => 0x81,
            Self::ResetCommunication => 0x82,
        };
        with_data(bus, NMT_ID, &[command, node])
    }
}

/// State of a node's communication, from its heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeState {
    /// It has just started: sent once.
    BootUp,
    /// Nothing but network management is heard.
    Stopped,
    /// Process data are exchanged.
    Operational,
    /// Set-up by SDO, no process data.
    PreOperational,
}

impl NodeState {
    /// The state in words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::BootUp => "boot-up",
            Self::Stopped => "stopped",
            Self::Operational => "operational",
            Self::PreOperational => "pre-operational",
        }
    }

    /// Node and state of a heartbeat or boot-up; none if the frame is neither.
    #[must_use]
    pub fn of(frame: &Frame) -> Option<(u8, Self)> {
        let node = node_of(frame, HEARTBEAT_ID)?;
        // Bit 7 toggles in answers to node guarding.
        let state = match frame.payload() {
            [0x00] => Self::BootUp,
            [byte] => match byte & 0x7F {
                0x04 => Self::Stopped,
                0x05 => Self::Operational,
                0x7F => Self::PreOperational,
                _ => return None,
            },
            _ => return None,
        };
        Some((node, state))
    }
}

/// The heartbeat of a node in operation: what drives that watch the master listen for.
#[must_use]
pub fn heartbeat(bus: u8, node: u8) -> Frame {
    with_data(bus, HEARTBEAT_ID + u32::from(node), &[0x05])
}

/// The node of a frame whose identifier is `base` plus a node.
pub(crate) fn node_of(frame: &Frame, base: u32) -> Option<u8> {
    let node = frame.id.checked_sub(base).filter(|_| !frame.error)?;
    let node = u8::try_from(node).ok()?;
    NODES.contains(&node).then_some(node)
}

/// A classic frame with at most 8 bytes.
pub(crate) fn with_data(bus: u8, id: u32, data: &[u8]) -> Frame {
    let len = data.len().min(8);
    let mut frame = Frame::zeroed(bus, id, len as u8, false);
    frame.data[..len].copy_from_slice(&data[..len]);
    frame
}
