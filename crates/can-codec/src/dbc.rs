//! A DBC file, read and validated.
//!
//! The reader is our own: the grammar of the crate `can-dbc` refuses sound files of other programs (statements over
//! several lines, signals without receivers), and a frame's layout depends on statements that it leaves unread.

mod check;
mod frame_format;
mod given;
mod multiplexing;
mod scan;
mod statements;
mod types;

use crate::frame::{EXTENDED_ID, Frame};
use crate::packing::{Coding, Packing};
use multiplexing::Condition;
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
    /// It is present only if a multiplexer of the message has certain values.
    pub multiplexed: bool,
    /// It is a multiplexer of the message.
    pub multiplexer: bool,
    /// What is sent where nothing else says it: the count, or a float's value, that the file gives
    /// this signal by the attribute `GenSigStartValue`. The attribute's default counts for none.
    pub start: Option<f64>,
    /// Line in the file, from 1.
    pub line: usize,
    pub(crate) packing: Packing,
    /// Values of a multiplexer on which the signal is present; none: it always is.
    pub(crate) condition: Option<Condition>,
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
    /// A message that no file describes, of at most 8 bytes.
    #[must_use]
    pub fn new(name: String, id: u32, len: u8, signals: Vec<Signal>) -> Self {
        Self {
            name,
            id,
            len: len.min(8),
            fd: false,
            line: 0,
            signals,
        }
    }

    /// The signal of that name.
    #[must_use]
    pub fn signal(&self, name: &str) -> Option<&Signal> {
        self.signals.iter().find(|signal| signal.name == name)
    }

    /// The message on a bus with every signal at its [start](Signal::start), or else at its
    /// physical zero; of multiplexed signals those that the multiplexer's start selects.
    #[must_use]
    pub fn at_start(&self, bus: u8) -> Frame {
        let mut frame = Frame::zeroed(bus, self.id, self.len, self.fd);
        for signal in self.signals.iter().filter(|s| self.is_selected(s)) {
            signal.packing.write(&mut frame.data, signal.start_raw());
        }
        frame
    }

    /// The signal is in the frames that [`at_start`](Self::at_start) makes.
    #[must_use]
    pub fn is_selected(&self, signal: &Signal) -> bool {
        let mut condition = signal.condition.as_ref();
        // As many multiplexers choose each other as there are signals.
        for _ in &self.signals {
            let Some(Condition {
                multiplexer,
                ranges,
            }) = condition
            else {
                break;
            };
            let Some(by) = self.signals.get(*multiplexer) else {
                return false;
            };
            let value = by.start_raw().round_ties_even();
            if !(ranges.iter()).any(|(from, to)| *from as f64 <= value && value <= *to as f64) {
                return false;
            }
            condition = by.condition.as_ref();
        }
        condition.is_none()
    }
}

impl Signal {
    /// A little endian signal that no file describes, from its least significant bit on; its range is
    /// that of its bits.
    ///
    /// # Panics
    /// A size beyond 1 to 64 bits, or a first bit beyond a frame's: in debug builds.
    #[must_use]
    pub fn new(
        name: &str,
        unit: &str,
        coding: Coding,
        first_bit: usize,
        size: u8,
        scale: f64,
    ) -> Self {
        let packing = Packing::new(first_bit, usize::from(size), false, coding);
        let (low, high) = packing.range();
        let ends = [low * scale, high * scale];
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            coding,
            size,
            scale,
            offset: 0.0,
            min: ends[0].min(ends[1]),
            max: ends[0].max(ends[1]),
            multiplexed: false,
            multiplexer: false,
            start: None,
            line: 0,
            packing,
            condition: None,
        }
    }

    /// Least and greatest number that the signal's bits can hold, before scaling.
    #[must_use]
    pub fn raw_range(&self) -> (f64, f64) {
        self.packing.range()
    }

    /// Bits that are all zero mean the value zero, and the signal may have it.
    #[must_use]
    pub fn zero_is_zero(&self) -> bool {
        self.offset == 0.0 && self.min <= 0.0 && self.max >= 0.0
    }

    /// The count, or a float's value, that is sent where nothing else says it.
    pub(crate) fn start_raw(&self) -> f64 {
        let (least, greatest) = self.packing.range();
        let zero = -self.offset / self.scale;
        self.start.unwrap_or(zero).max(least).min(greatest)
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
