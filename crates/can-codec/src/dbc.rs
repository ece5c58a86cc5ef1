//! A DBC file, read and validated.

mod check;

use crate::frame::{EXTENDED_ID, Frame};
use crate::packing::{Coding, Packing};
use problem::Problems;

/// The messages of one DBC file.
#[derive(Clone, Debug)]
pub struct Dbc {
    /// The file's name as it was given.
    pub file: String,
    /// The messages in the file's order.
    pub messages: Vec<Message>,
}

/// One message.
#[derive(Clone, Debug)]
pub struct Message {
    /// Name.
    pub name: String,
    /// Identifier; bit 31 marks an extended one.
    pub id: u32,
    /// Length of its data, bytes.
    pub len: u8,
    /// It travels as a CAN FD frame: longer than 8 bytes, or of such a `VFrameFormat`.
    pub fd: bool,
    /// Line in the file, from 1.
    pub line: usize,
    /// The signals in the file's order.
    pub signals: Vec<Signal>,
}

/// One signal: `value = raw * scale + offset` in `unit`.
#[derive(Clone, Debug)]
pub struct Signal {
    /// Name.
    pub name: String,
    /// Unit as written.
    pub unit: String,
    /// Meaning of the bits.
    pub coding: Coding,
    /// Bits.
    pub size: u8,
    /// Units per count.
    pub scale: f64,
    /// Value of count zero.
    pub offset: f64,
    /// Least value that the signal may have: as written, or else the least that its bits can hold.
    pub min: f64,
    /// Greatest value that the signal may have.
    pub max: f64,
    /// It is present only if the message's multiplexer has a certain value.
    pub multiplexed: bool,
    /// Line in the file, from 1.
    pub line: usize,
    pub(crate) packing: Packing,
}

impl Dbc {
    /// Reads a DBC file; `file` only names it in errors.
    ///
    /// # Errors
    /// Text that is no DBC file, and messages or signals that no frame could carry.
    pub fn parse(text: &str, file: &str) -> Result<Self, Problems> {
        check::read(text, file)
    }

    /// The message of that name.
    #[must_use]
    pub fn message(&self, name: &str) -> Option<&Message> {
        self.messages.iter().find(|message| message.name == name)
    }

    /// The signal of that name in the message of that name.
    #[must_use]
    pub fn signal(&self, message: &str, signal: &str) -> Option<&Signal> {
        self.message(message)?.signal(signal)
    }
}

impl Message {
    /// The signal of that name.
    #[must_use]
    pub fn signal(&self, name: &str) -> Option<&Signal> {
        self.signals.iter().find(|signal| signal.name == name)
    }

    /// The message on a bus, all of its bytes zero.
    #[must_use]
    pub fn zeroed(&self, bus: u8) -> Frame {
        Frame::zeroed(bus, self.id, self.len, self.fd)
    }
}

impl Signal {
    /// Least and greatest number that the signal's bits can hold, before scaling.
    #[must_use]
    pub fn raw_range(&self) -> (f64, f64) {
        self.packing.range()
    }
}

/// An identifier for messages: decimal and hexadecimal, without the extended bit.
pub(crate) fn show_id(id: u32) -> String {
    let bare = id & !EXTENDED_ID;
    let kind = if id & EXTENDED_ID == 0 {
        ""
    } else {
        ", extended"
    };
    format!("{bare} ({bare:#x}{kind})")
}
