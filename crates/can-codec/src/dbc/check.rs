//! From a DBC file's text to its messages, with every problem that is found on the way.

use super::{Dbc, Message, Signal, frame_format, show_id, types};
use crate::frame::{EXTENDED_ID, MAX_DATA};
use crate::line_index::{MessageLines, message_lines};
use crate::packing::{Coding, Packing, covered_bits};
use can_dbc::{ByteOrder, DbcError, MultiplexIndicator, SignalExtendedValueType, ValueType};
use pest::error::LineColLocation;
use problem::{Problem, Problems};

/// A file is refused unread above this size: it is no description of a robot.
const MAX_TEXT: usize = 16 << 20;

/// Data lengths that CAN FD frames can have.
const FD_LENGTHS: [u64; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// Characters of a faulty line that a message shows.
const MAX_SHOWN: usize = 60;

/// Name that tools give to a collection of signals which belong to no message.
const NO_MESSAGE: &str = "VECTOR__INDEPENDENT_SIG_MSG";

/// The validated file.
pub(super) fn read(text: &str, file: &str) -> Result<Dbc, Problems> {
    let mut check = Check {
        file,
        problems: Vec::new(),
        untyped: false,
    };
    if text.len() > MAX_TEXT {
        check.note(0, "the file is too long", "at most 16 MiB");
        return Err(check.into_problems());
    }
    let text = types::with_colons(text);
    let parsed = match can_dbc::Dbc::try_from(&*text) {
        Ok(parsed) => parsed,
        Err(error) => {
            check.syntax(&error, &text);
            return Err(check.into_problems());
        }
    };
    let lines = message_lines(&text);
    let mut messages = Vec::new();
    for (i, message) in parsed.messages.iter().enumerate() {
        if message.name == NO_MESSAGE {
            continue;
        }
        // Lines and messages run in step unless the text hides one from the line index.
        let lines = lines
            .get(i)
            .filter(|_| lines.len() == parsed.messages.len());
        messages.push(check.message(&parsed, message, lines));
    }
    check.unique(&messages);
    for (line, problem) in types::unmatched(&parsed, &text) {
        check.problems.push(problem.at(file, line));
    }
    if check.problems.is_empty() {
        Ok(Dbc {
            file: file.to_owned(),
            messages,
        })
    } else {
        Err(check.into_problems())
    }
}

/// The problems found so far.
struct Check<'a> {
    file: &'a str,
    problems: Vec<Problem>,
    /// The signal at hand has no `SIG_VALTYPE_`.
    untyped: bool,
}

impl Check<'_> {
    fn note(&mut self, line: usize, reason: impl Into<String>, allowed: impl Into<String>) {
        let problem = Problem::new(reason, allowed);
        self.problems.push(problem.at(self.file, line));
    }

    fn into_problems(mut self) -> Problems {
        self.problems.sort_by_key(|problem| problem.line);
        Problems(self.problems)
    }

    fn syntax(&mut self, error: &DbcError, text: &str) {
        let (line, reason) = match error {
            DbcError::Pest(error) => {
                let (LineColLocation::Pos((line, column))
                | LineColLocation::Span((line, column), _)) = error.line_col;
                let written = text
                    .lines()
                    .nth(line.saturating_sub(1))
                    .unwrap_or("")
                    .trim();
                let shown: String = written.chars().take(MAX_SHOWN).collect();
                let reason = if written.is_empty() {
                    "not a DBC file: a line is empty, or the file ends, within a statement"
                        .to_owned()
                } else {
                    format!("not a DBC file from column {column} of `{shown}` on")
                };
                (line, reason)
            }
            // The other kinds have no place.
            DbcError::MessageIdOutOfRange(id) => (0, format!("a message has id {id}")),
            DbcError::MultipleMultiplexors => (
                0,
                "a message has two signals marked as multiplexers (`M`)".to_owned(),
            ),
            DbcError::SignalWithoutMessage => (0, "a signal stands before any message".to_owned()),
            DbcError::UnknownMultiplexIndicator(mark) => {
                (0, format!("`{mark}` marks a signal as multiplexed"))
            }
            DbcError::InvalidFloat(number)
            | DbcError::InvalidInt(number)
            | DbcError::InvalidUint(number)
            | DbcError::InvalidNumericValue(number) => {
                (line_of(text, number), format!("`{number}` is no number"))
            }
            _ => (0, "not a DBC file".to_owned()),
        };
        let written = text.lines().nth(line.saturating_sub(1)).unwrap_or("");
        let allowed = if types::is_one(written) {
            types::FORM
        } else {
            "BO_ id name: length node, then SG_ name : start|size@order sign (scale,offset) [min|max] \"unit\" receivers"
        };
        self.note(line, reason, allowed);
    }

    fn message(
        &mut self,
        dbc: &can_dbc::Dbc,
        message: &can_dbc::Message,
        lines: Option<&MessageLines>,
    ) -> Message {
        let line = lines.map_or(0, |lines| lines.line);
        let name = &message.name;
        let written = lines.map_or(u64::from(message.id.raw()), |lines| lines.id);
        let extended = written & u64::from(EXTENDED_ID) != 0;
        let allowed_id = if extended { 0x1FFF_FFFF } else { 0x7FF };
        if written & !u64::from(EXTENDED_ID) > allowed_id {
            self.note(
                line,
                format!("message {name} has id {written}"),
                "0 to 2047, or an extended id of 29 bits plus 2147483648",
            );
        }
        if let Err(problem) = frame_format::check_id(dbc, message, extended) {
            self.problems.push(problem.at(self.file, line));
        }
        if !FD_LENGTHS.contains(&message.size) {
            self.note(
                line,
                format!("message {name} is {} bytes long", message.size),
                "0 to 8, and 12, 16, 20, 24, 32, 48, 64 for CAN FD",
            );
        }
        let len = message.size.min(MAX_DATA as u64) as u8;
        let signals = self.signals(dbc, message, usize::from(len), lines);
        let fd = frame_format::is_fd(dbc, message).unwrap_or_else(|problem| {
            self.problems.push(problem.at(self.file, line));
            false
        });
        Message {
            name: name.clone(),
            id: message.id.raw(),
            len,
            fd: len > 8 || fd,
            line,
            signals,
        }
    }

    fn signals(
        &mut self,
        dbc: &can_dbc::Dbc,
        message: &can_dbc::Message,
        len: usize,
        lines: Option<&MessageLines>,
    ) -> Vec<Signal> {
        let mut signals = Vec::<Signal>::new();
        // Signals that cover each bit of the frame so far.
        let mut owners = vec![Vec::<&can_dbc::Signal>::new(); 8 * len];
        for (i, signal) in message.signals.iter().enumerate() {
            let line = lines.map_or(0, |lines| lines.signal_line(i, &signal.name));
            let path = format!("{}.{}", message.name, signal.name);
            if signals.iter().any(|other| other.name == signal.name) {
                self.note(
                    line,
                    format!("signal {path} occurs twice"),
                    "one signal of a name in a message",
                );
            }
            if let Some(coding) = self.coding(dbc, message, signal, &path, line)
                && self.place(signal, len, &path, line)
            {
                self.overlap(signal, &mut owners, &path, line);
                let mut made = self.signal(signal, coding, &path, line);
                made.start = self.start(dbc, message, &made, &path);
                signals.push(made);
            }
        }
        signals
    }

    fn coding(
        &mut self,
        dbc: &can_dbc::Dbc,
        message: &can_dbc::Message,
        signal: &can_dbc::Signal,
        path: &str,
        line: usize,
    ) -> Option<Coding> {
        use SignalExtendedValueType::{IEEEdouble64bit, IEEEfloat32Bit, SignedOrUnsignedInteger};
        let written = dbc.extended_value_type_for_signal(message.id, &signal.name);
        self.untyped = written.is_none();
        let (coding, size) = match written {
            Some(IEEEfloat32Bit) => (Coding::Float32, Some(32)),
            Some(IEEEdouble64bit) => (Coding::Float64, Some(64)),
            None | Some(SignedOrUnsignedInteger) => match signal.value_type {
                ValueType::Signed => (Coding::Signed, None),
                ValueType::Unsigned => (Coding::Unsigned, None),
            },
        };
        if let Some(size) = size
            && signal.size != size
        {
            self.note(
                line,
                format!("float signal {path} has {} bits", signal.size),
                format!("{size} bits, as its SIG_VALTYPE_ requires"),
            );
            return None;
        }
        Some(coding)
    }

    /// True if the signal's bits lie inside the frame.
    fn place(&mut self, signal: &can_dbc::Signal, len: usize, path: &str, line: usize) -> bool {
        if !(1..=64).contains(&signal.size) {
            let reason = format!("signal {path} has {} bits", signal.size);
            self.note(line, reason, "1 to 64 bits");
            return false;
        }
        let bits = 8 * len as u64;
        let inside = signal.start_bit < bits
            && covered_bits(
                signal.start_bit as usize,
                signal.size as usize,
                is_big_endian(signal),
            )
            .all(|bit| (bit as u64) < bits);
        if !inside {
            self.note(
                line,
                format!(
                    "signal {path}, start bit {} and {} bits, passes the end of its message",
                    signal.start_bit, signal.size
                ),
                format!("bits within the message's {len} bytes"),
            );
        }
        inside
    }

    fn overlap<'s>(
        &mut self,
        signal: &'s can_dbc::Signal,
        owners: &mut [Vec<&'s can_dbc::Signal>],
        path: &str,
        line: usize,
    ) {
        let mut overlapped: Vec<&str> = Vec::new();
        let bits = covered_bits(
            signal.start_bit as usize,
            signal.size as usize,
            is_big_endian(signal),
        );
        for bit in bits {
            if let Some(owners) = owners.get_mut(bit) {
                for other in owners.iter() {
                    if share_a_frame(signal, other) && !overlapped.contains(&other.name.as_str()) {
                        overlapped.push(&other.name);
                    }
                }
                owners.push(signal);
            }
        }
        for other in overlapped {
            self.note(
                line,
                format!("signal {path} overlaps signal {other}"),
                "one signal for each bit of a message",
            );
        }
    }

    fn signal(
        &mut self,
        signal: &can_dbc::Signal,
        coding: Coding,
        path: &str,
        line: usize,
    ) -> Signal {
        if !(signal.factor.is_finite() && signal.factor != 0.0) {
            let reason = format!("signal {path} has scale {}", signal.factor);
            self.note(line, reason, "a finite number other than 0");
        }
        if !signal.offset.is_finite() {
            let reason = format!("signal {path} has offset {}", signal.offset);
            self.note(line, reason, "a finite number");
        }
        let packing = Packing::new(
            signal.start_bit as usize,
            signal.size as usize,
            is_big_endian(signal),
            coding,
        );
        let (raw_min, raw_max) = packing.range();
        let ends = [raw_min, raw_max].map(|raw| raw * signal.factor + signal.offset);
        let held = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let written = (number(signal.min), number(signal.max));
        if written.0 > written.1 || !written.0.is_finite() || !written.1.is_finite() {
            self.note(
                line,
                format!("signal {path} has range [{}|{}]", written.0, written.1),
                "a least value that does not exceed the greatest, or [0|0] for none",
            );
        }
        if self.untyped
            && coding.is_integer()
            && let Some(problem) = types::range_of_float(signal, written, held, path)
        {
            self.problems.push(problem.at(self.file, line));
        }
        // [0|0] means: not given.
        let (min, max) = if written == (0.0, 0.0) {
            held
        } else {
            (written.0.max(held.0), written.1.min(held.1))
        };
        if min > max {
            self.note(
                line,
                format!("no count of signal {path} lies in its range"),
                format!("a range that meets [{}|{}]", held.0, held.1),
            );
        }
        Signal {
            name: signal.name.clone(),
            unit: signal.unit.clone(),
            coding,
            size: signal.size as u8,
            scale: signal.factor,
            offset: signal.offset,
            min,
            max,
            multiplexed: matches!(
                signal.multiplexer_indicator,
                MultiplexIndicator::MultiplexedSignal(_)
                    | MultiplexIndicator::MultiplexorAndMultiplexedSignal(_)
            ),
            selector: selector(signal),
            multiplexer: matches!(
                signal.multiplexer_indicator,
                MultiplexIndicator::Multiplexor
            ),
            start: None,
            line,
            packing,
        }
    }

    /// The count that the attribute `GenSigStartValue` gives this signal; what the attribute has as
    /// its default for all signals nobody has chosen for this one.
    fn start(
        &mut self,
        dbc: &can_dbc::Dbc,
        message: &can_dbc::Message,
        signal: &Signal,
        path: &str,
    ) -> Option<f64> {
        use can_dbc::AttributeValue::{Double, Int, String, Uint};
        let written = dbc.signal_attribute(message.id, &signal.name, "GenSigStartValue")?;
        let value = match written {
            Uint(value) => Some(*value as f64),
            Int(value) => Some(*value as f64),
            Double(value) => Some(*value),
            String(text) => text.trim().parse().ok(),
        };
        let (least, greatest) = signal.packing.range();
        let whole = |value: f64| !signal.coding.is_integer() || value.fract() == 0.0;
        let fits = |&value: &f64| value >= least && value <= greatest && whole(value);
        let start = value.filter(fits);
        if start.is_none() {
            self.note(
                signal.line,
                format!("signal {path} has a GenSigStartValue that its bits cannot hold"),
                format!("a count, before scaling, from {least} to {greatest}"),
            );
        }
        start
    }

    fn unique(&mut self, messages: &[Message]) {
        for (i, message) in messages.iter().enumerate() {
            let before = &messages[..i];
            if let Some(other) = before.iter().find(|other| other.id == message.id) {
                self.note(
                    message.line,
                    format!(
                        "message {} has CAN id {} like message {} of line {}",
                        message.name,
                        show_id(message.id),
                        other.name,
                        other.line
                    ),
                    "one message for each id",
                );
            } else if let Some(other) = before.iter().find(|other| other.name == message.name) {
                self.note(
                    message.line,
                    format!(
                        "a second message is called {}, see line {}",
                        message.name, other.line
                    ),
                    "one message of a name",
                );
            }
        }
    }
}

fn is_big_endian(signal: &can_dbc::Signal) -> bool {
    signal.byte_order == ByteOrder::BigEndian
}

/// Signals for different multiplexer values never share a frame, so their bits may overlap.
fn share_a_frame(a: &can_dbc::Signal, b: &can_dbc::Signal) -> bool {
    match (selector(a), selector(b)) {
        (Some(a), Some(b)) => a == b,
        _ => true,
    }
}

fn selector(signal: &can_dbc::Signal) -> Option<u64> {
    match signal.multiplexer_indicator {
        MultiplexIndicator::MultiplexedSignal(value)
        | MultiplexIndicator::MultiplexorAndMultiplexedSignal(value) => Some(value),
        MultiplexIndicator::Multiplexor | MultiplexIndicator::Plain => None,
    }
}

/// The first line that holds `part`; 0 if none does.
fn line_of(text: &str, part: &str) -> usize {
    let found = text.lines().position(|line| line.contains(part));
    found.map_or(0, |line| line + 1)
}

fn number(value: can_dbc::NumericValue) -> f64 {
    match value {
        can_dbc::NumericValue::Uint(value) => value as f64,
        can_dbc::NumericValue::Int(value) => value as f64,
        can_dbc::NumericValue::Double(value) => value,
    }
}
