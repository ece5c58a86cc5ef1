//! The signals that are used, compiled once: frames to numbers and back.

mod compile;

use crate::dbc::{Dbc, Message};
use crate::frame::{EXTENDED_ID, Frame, Frames};
use crate::packing::Packing;
use compile::Compiler;
use core::ops::Range;
use problem::{Problem, Problems};

/// Number of standard (11-bit) identifiers.
const STANDARD_IDS: usize = 1 << 11;

/// A DBC file on a bus.
#[derive(Clone, Copy, Debug)]
pub struct BusDbc<'a> {
    /// Index of the bus.
    pub bus: u8,
    /// The bus carries CAN FD frames.
    pub fd: bool,
    /// The messages on it. Several files may describe one bus.
    pub dbc: &'a Dbc,
}

/// A signal that is used: `slots[slot] = (raw * dbc scale + dbc offset) * scale + offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalMap {
    /// Place among the values.
    pub slot: usize,
    /// The message's name.
    pub message: String,
    /// The signal's name.
    pub signal: String,
    /// Slot's units per unit of the DBC file.
    pub scale: f64,
    /// Slot's value where the DBC file's is zero.
    pub offset: f64,
    /// The signal starts again at its range's end, as an encoder's count does: what is encoded is
    /// taken modulo the range instead of being limited to it.
    pub wraps: bool,
}

impl SignalMap {
    /// All signals of a bus's messages but the multiplexed ones, in successive slots and in the DBC
    /// file's units, each with the index of the bus.
    #[must_use]
    pub fn all<'a>(bus: u8, messages: impl IntoIterator<Item = &'a Message>) -> Vec<(u8, Self)> {
        let pairs = messages.into_iter().flat_map(|message| {
            let signals = message.signals.iter().filter(|signal| !signal.multiplexed);
            signals.map(|signal| (message.name.clone(), signal.name.clone()))
        });
        let map = |(slot, (message, signal))| Self {
            slot,
            message,
            signal,
            scale: 1.0,
            offset: 0.0,
            wraps: false,
        };
        pairs.enumerate().map(|pair| (bus, map(pair))).collect()
    }
}

/// Reason why a frame was not decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecodeError {
    /// No message of the bus has that identifier.
    UnknownId,
    /// The message has another length.
    WrongLength,
}

/// One thing that keeps the signals from being compiled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TableProblem {
    /// Index of the mapped signal it is about; none if it is about the DBC files alone.
    pub map: Option<usize>,
    /// The problem; its place is in the DBC file, where it is about one.
    pub problem: Problem,
}

/// Everything that keeps the signals from being compiled.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.problems())]
pub struct TableError(pub Vec<TableProblem>);

impl TableError {
    /// The problems without their signals.
    #[must_use]
    pub fn problems(&self) -> Problems {
        Problems(self.0.iter().map(|p| p.problem.clone()).collect())
    }
}

/// A message of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Index of the bus.
    pub bus: u8,
    /// Identifier; bit 31 marks an extended one.
    pub id: u32,
    /// Length of its data, bytes.
    pub len: u8,
    /// It travels as a CAN FD frame.
    pub fd: bool,
    /// Name.
    pub name: String,
    /// What is sent with nothing mapped: see [`Message::at_start`].
    start: Frame,
}

/// Parts of a message that decoding needs, together for all: one line of the cache has several.
#[derive(Clone, Debug)]
struct Layout {
    len: u8,
    signals: Range<u32>,
}

/// A mapped signal: one load, one shift, one mask, one multiplication, one addition.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Compiled {
    slot: usize,
    packing: Packing,
    scale: f64,
    offset: f64,
    /// Counts that `encode` may write: the signal's range, whatever its sign of scale.
    raw_min: f64,
    raw_max: f64,
    wraps: bool,
}

impl Compiled {
    /// The count, not yet rounded, that stands for a value: within the signal's range.
    fn raw(&self, value: f64) -> f64 {
        let raw = (value - self.offset) / self.scale;
        let raw = if self.wraps {
            let counts = self.raw_max - self.raw_min + 1.0;
            let turned = self.raw_min + (raw.round_ties_even() - self.raw_min).rem_euclid(counts);
            // The remainder of a tiny negative number rounds to the whole range.
            if turned > self.raw_max {
                self.raw_min
            } else {
                turned
            }
        } else {
            raw
        };
        // max and min, not clamp: they cannot panic.
        raw.max(self.raw_min).min(self.raw_max)
    }
}

/// Identifiers of one bus.
#[derive(Clone, Debug, Default)]
struct BusIndex {
    standard: StandardIds,
    /// Identifier without bit 31 and index of the message, sorted.
    extended: Vec<(u32, u16)>,
}

/// Most standard identifiers of a bus that are searched one after the other: they fill one line of the cache.
const FEW: usize = 16;

/// Standard identifiers of one bus.
#[derive(Clone, Debug)]
enum StandardIds {
    /// Identifier and index of the message: of buses with one or two drives, of which a robot may have many.
    Few(Vec<(u16, u16)>),
    /// Index of the message plus one; 0: unknown.
    Many(Box<[u16; STANDARD_IDS]>),
}

impl Default for StandardIds {
    fn default() -> Self {
        Self::Few(Vec::new())
    }
}

impl StandardIds {
    /// `index`: at most 65,534.
    fn insert(&mut self, id: u16, index: u16) {
        match self {
            Self::Few(ids) if ids.len() < FEW => ids.push((id, index)),
            Self::Few(ids) => {
                let mut all = Box::new([0; STANDARD_IDS]);
                for &(id, index) in ids.iter().chain(&[(id, index)]) {
                    all[usize::from(id)] = index + 1;
                }
                *self = Self::Many(all);
            }
            Self::Many(all) => all[usize::from(id)] = index + 1,
        }
    }

    fn find(&self, id: u32) -> Option<usize> {
        match self {
            Self::Few(ids) => {
                let mut ids = ids.iter();
                let found = ids.find(|&&(own, _)| u32::from(own) == id)?;
                Some(usize::from(found.1))
            }
            Self::Many(all) => usize::from(*all.get(id as usize)?).checked_sub(1),
        }
    }
}

/// Messages and mapped signals of all buses.
///
/// Messages that carry a mapped signal come first and have the indices below
/// [`message_count`](Self::message_count); the others are known, and ignored.
#[derive(Clone, Debug)]
pub struct Table {
    entries: Vec<Entry>,
    /// One for each entry.
    layouts: Vec<Layout>,
    mapped: usize,
    signals: Vec<Compiled>,
    buses: Vec<BusIndex>,
    slots: usize,
}

impl Table {
    /// Compiles the signals in `maps`, each with the index of its bus.
    ///
    /// # Errors
    /// Two messages of a bus with one identifier, a CAN FD message on a classic bus, a signal that
    /// no DBC file of its bus has, one that is multiplexed, a slot or a signal that is mapped twice.
    pub fn compile(dbcs: &[BusDbc<'_>], maps: &[(u8, SignalMap)]) -> Result<Self, TableError> {
        let mut compiler = Compiler {
            messages: Vec::new(),
            problems: Vec::new(),
        };
        compiler.collect(dbcs);
        let signals = compiler.resolve(maps);
        compiler.finish(signals)
    }

    /// Number of messages that carry a mapped signal.
    #[must_use]
    pub fn message_count(&self) -> usize {
        self.mapped
    }

    /// The message with that index.
    #[must_use]
    pub fn message(&self, index: usize) -> Option<&Entry> {
        self.entries.get(index)
    }

    /// The slots that the message with that index fills.
    pub fn slots(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        self.signals_of(index).iter().map(|signal| signal.slot)
    }

    /// One more than the greatest mapped slot.
    #[must_use]
    pub fn slot_count(&self) -> usize {
        self.slots
    }

    /// The index of the frame's message if it carries a mapped signal.
    #[must_use]
    pub fn classify(&self, frame: &Frame) -> Option<usize> {
        self.find(frame).filter(|&index| index < self.mapped)
    }

    /// The frame is as long as the message with that index.
    #[must_use]
    pub fn has_its_length(&self, index: usize, frame: &Frame) -> bool {
        self.layouts
            .get(index)
            .is_some_and(|layout| layout.len == frame.len)
    }

    /// Puts the frame's mapped signals into their slots; the result is its message's index.
    ///
    /// `Ok(None)`: a message of the bus that carries no mapped signal. Slots beyond the end of
    /// `slots` are left out.
    ///
    /// # Errors
    /// An identifier that no message of the bus has (error frames have none), another length.
    pub fn decode(&self, frame: &Frame, slots: &mut [f64]) -> Result<Option<usize>, DecodeError> {
        let index = self.find(frame).ok_or(DecodeError::UnknownId)?;
        self.decode_as(index, frame, slots)?;
        Ok((index < self.mapped).then_some(index))
    }

    /// As [`decode`](Self::decode), of a frame whose message is known: that of [`find`](Self::find).
    ///
    /// # Errors
    /// Another length than the message's.
    pub fn decode_as(
        &self,
        index: usize,
        frame: &Frame,
        slots: &mut [f64],
    ) -> Result<(), DecodeError> {
        if !self.has_its_length(index, frame) {
            return Err(DecodeError::WrongLength);
        }
        for signal in self.signals_of(index) {
            if let Some(slot) = slots.get_mut(signal.slot) {
                *slot = signal.packing.read(&frame.data) * signal.scale + signal.offset;
            }
        }
        Ok(())
    }

    /// Makes the frame of the message with that index from the slots: nearest count, within the
    /// signal's range. Signals that are not mapped are as [`Message::at_start`] has them: no joint is
    /// sent a torque because its message's count zero stands for one.
    ///
    /// False, with `frame` untouched, if a value is missing or not finite: no position follows
    /// from NaN.
    #[must_use]
    pub fn encode(&self, index: usize, slots: &[f64], frame: &mut Frame) -> bool {
        let Some(entry) = self.entries.get(index) else {
            return false;
        };
        let signals = self.signals_of(index);
        let value = |signal: &Compiled| slots.get(signal.slot).filter(|value| value.is_finite());
        // Most control words are not due: their frames are not begun.
        if !signals.iter().all(|signal| value(signal).is_some()) {
            return false;
        }
        *frame = entry.start;
        for (signal, value) in signals.iter().filter_map(|s| Some((s, value(s)?))) {
            signal.packing.write(&mut frame.data, signal.raw(*value));
        }
        true
    }

    /// Appends the frame of every message that carries a mapped signal, except those with values
    /// that are not finite and those that find no room. The result is the number appended.
    pub fn encode_all(&self, slots: &[f64], frames: &mut Frames) -> usize {
        let mut frame = Frame::zeroed(0, 0, 0, false);
        (0..self.mapped)
            .filter(|&index| self.encode(index, slots, &mut frame) && frames.push(frame))
            .count()
    }

    fn signals_of(&self, index: usize) -> &[Compiled] {
        let range = |layout: &Layout| layout.signals.start as usize..layout.signals.end as usize;
        self.layouts
            .get(index)
            .and_then(|layout| self.signals.get(range(layout)))
            .unwrap_or_default()
    }

    /// The index of the frame's message, whether it carries a mapped signal or not.
    #[must_use]
    pub fn find(&self, frame: &Frame) -> Option<usize> {
        if frame.error {
            return None;
        }
        let bus = self.buses.get(usize::from(frame.bus))?;
        if frame.id & EXTENDED_ID == 0 {
            bus.standard.find(frame.id)
        } else {
            let id = frame.id & !EXTENDED_ID;
            let at = bus.extended.binary_search_by_key(&id, |&(id, _)| id).ok()?;
            bus.extended.get(at).map(|&(_, index)| usize::from(index))
        }
    }
}
