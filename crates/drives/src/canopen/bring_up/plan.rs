//! The steps of a set-up, as data.

use super::{Bound, Object};
use crate::canopen::Nmt;
use can_codec::Frame;

/// One step of a set-up.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Communication starts anew with the settings of power-on; ends with the node's boot-up.
    ResetCommunication,
    /// Reads an object, and what it must be.
    Read(Check),
    /// Writes an object and reads it back.
    Write(Write),
    /// Reads a limit of the node's own, if it has it: less than is asked ends the set-up, more is remarked.
    Compare(Bound),
    /// Switches a PDO off if there is one: its communication parameter.
    SwitchOff(u16),
    /// Copies an object to another one of the same length.
    Copy(Object, Object),
    /// Process data are exchanged from here on; ends when the node's heartbeat says so.
    Start,
}

impl Step {
    /// Purpose of the object.
    #[must_use]
    pub fn meaning(&self) -> &'static str {
        match self {
            Self::ResetCommunication => "reset of its communication",
            Self::Read(check) => check.meaning,
            Self::Write(write) => write.meaning,
            Self::Compare(_) => "limits of its own",
            Self::SwitchOff(_) => "process data that are not used",
            Self::Copy(..) => "set-point at where it stands",
            Self::Start => "start",
        }
    }
}

/// What an object must be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    /// The object.
    pub object: Object,
    /// What it is.
    pub meaning: &'static str,
    /// Bits that matter; 0: it is only shown.
    pub mask: u32,
    /// Their values.
    pub value: u32,
    /// What to do where it is something else.
    pub cure: String,
    /// A node may lack it.
    pub optional: bool,
    /// It may take a while: read again until the time is over.
    pub awaited: bool,
}

/// A write.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Write {
    /// The object.
    pub object: Object,
    /// Purpose of the object.
    pub meaning: &'static str,
    /// Little endian.
    pub value: Vec<u8>,
    /// Bits that must read back.
    pub mask: u32,
    /// A node may lack it.
    pub optional: bool,
    /// A node may have a value of its own that can only be read: any but zero will do.
    pub may_be_fixed: bool,
}

/// The set-up of a node.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Index of the bus.
    pub bus: u8,
    /// Node, 1 to 127.
    pub node: u8,
    /// What it moves, for messages.
    pub name: String,
    /// The steps in order.
    pub steps: Vec<Step>,
}

impl Plan {
    /// Restarts the node, for a drive that hears no control word: it starts anew with its power stage off.
    #[must_use]
    pub fn reset(&self) -> Frame {
        Nmt::Reset.frame(self.bus, self.node)
    }
}

/// Time limits of a set-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Longest wait for a boot-up, ns: drives that get their supply with the PC take seconds.
    pub boot_ns: u64,
    /// Longest wait for an answer by SDO, ns.
    pub answer_ns: u64,
    /// Requests that are sent again, at most, before a node counts as silent.
    pub repeats: u32,
    /// Longest wait for an object that takes a while, and for the state operational, ns.
    pub settle_ns: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            boot_ns: 5_000_000_000,
            answer_ns: 300_000_000,
            repeats: 3,
            settle_ns: 2_000_000_000,
        }
    }
}
