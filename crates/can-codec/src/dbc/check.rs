//! From a DBC file's statements to its messages, with every problem that is found on the way.

use super::multiplexing::{self, Condition};
use super::statements::{self, MessageText, SignalText, Statements};
use super::{Dbc, Message, Signal, frame_format, show_id, types};
use crate::frame::{EXTENDED_ID, MAX_DATA};
use crate::packing::{Coding, Packing, covered_bits};
use problem::{Problem, Problems};

/// A file is refused unread above this size: it is no description of a robot.
const MAX_TEXT: usize = 16 << 20;

/// Data lengths that CAN FD frames can have.
const FD_LENGTHS: [u64; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// Name that tools give to a collection of signals which belong to no message.
const NO_MESSAGE: &str = "VECTOR__INDEPENDENT_SIG_MSG";

/// Attribute with the count that a signal has before anything is set.
const START: &str = "GenSigStartValue";

/// The validated file.
pub(super) fn read(text: &str, file: &str) -> Result<Dbc, Problems> {
    let mut check = Check {
        file,
        problems: Vec::new(),
    };
    if text.len() > MAX_TEXT {
        check.note(0, "the file is too long", "at most 16 MiB");
        return Err(check.into_problems());
    }
    // Lines end with carriage returns, line feeds, or both.
    let text = text.replace("\r\n", "\n").replace('\r', "\n");
    let dbc = match statements::read(&text) {
        Ok(dbc) => dbc,
        Err(problem) => {
            check.add(problem);
            return Err(check.into_problems());
        }
    };
    let described = dbc.messages.iter().filter(|m| m.name != NO_MESSAGE);
    let messages: Vec<Message> = described.map(|m| check.message(&dbc, m)).collect();
    check.unique(&messages);
    check.unmatched(&dbc);
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

    fn add(&mut self, problem: Problem) {
        let line = problem.line;
        self.problems.push(problem.at(self.file, line));
    }

    fn unmatched(&mut self, dbc: &Statements) {
        let all = &dbc.messages;
        let found = [
            dbc.formats.unmatched(all, frame_format::ATTRIBUTE),
            dbc.starts.unmatched(all, START),
            dbc.types.unmatched(all, types::KEYWORD),
            dbc.selections.unmatched(all, "SG_MUL_VAL_"),
        ];
        found
            .into_iter()
            .flatten()
            .for_each(|problem| self.add(problem));
    }

    fn message(&mut self, dbc: &Statements, message: &MessageText) -> Message {
        let (line, name, written) = (message.line, &message.name, message.id);
        let extended = written & u64::from(EXTENDED_ID) != 0;
        let allowed_id = if extended { 0x1FFF_FFFF } else { 0x7FF };
        if written & !u64::from(EXTENDED_ID) > allowed_id {
            self.note(
                line,
                format!("message {name} has id {written}"),
                "0 to 2047, or an extended id of 29 bits plus 2147483648",
            );
        }
        if let Err(problem) = frame_format::check(dbc, message, extended) {
            self.add(problem.at("", line));
        }
        if !FD_LENGTHS.contains(&message.size) {
            self.note(
                line,
                format!("message {name} is {} bytes long", message.size),
                "0 to 8, and 12, 16, 20, 24, 32, 48, 64 for CAN FD",
            );
        }
        let len = message.size.min(MAX_DATA as u64) as u8;
        let signals = self.signals(dbc, message, usize::from(len));
        let fd = frame_format::is_fd(dbc, message).unwrap_or_else(|problem| {
            self.add(problem.at("", line));
            false
        });
        Message {
            name: name.clone(),
            id: written as u32,
            len,
            fd: len > 8 || fd,
            line,
            signals,
        }
    }

    fn signals(&mut self, dbc: &Statements, message: &MessageText, len: usize) -> Vec<Signal> {
        let (conditions, problems) = multiplexing::conditions(dbc, message);
        let unknown = !problems.is_empty();
        problems.into_iter().for_each(|problem| self.add(problem));
        let mut signals = Vec::<Signal>::new();
        // Indices of the signals that cover each bit of the frame so far.
        let mut owners = vec![Vec::<usize>::new(); 8 * len];
        for (i, signal) in message.signals.iter().enumerate() {
            let path = format!("{}.{}", message.name, signal.name);
            if message.signals[..i]
                .iter()
                .any(|other| other.name == signal.name)
            {
                self.note(
                    signal.line,
                    format!("signal {path} occurs twice"),
                    "one signal of a name in a message",
                );
            }
            if let Some(coding) = self.coding(dbc, message, signal, &path)
                && self.place(signal, len, &path)
            {
                if !unknown {
                    self.overlap(message, i, &conditions, &mut owners);
                }
                let typed = dbc.types.get(message.id, &signal.name).is_some();
                let mut made = self.signal(signal, coding, typed, &path);
                made.multiplexed = conditions[i].is_some();
                made.condition.clone_from(&conditions[i]);
                made.start = self.start(dbc, message, &made, &path);
                signals.push(made);
            }
        }
        if signals.len() == message.signals.len() {
            let unreachable = |s| multiplexing::unreachable(&signals, s, &message.name);
            let found: Vec<Problem> = signals.iter().filter_map(unreachable).collect();
            found.into_iter().for_each(|problem| self.add(problem));
        }
        signals
    }

    fn coding(
        &mut self,
        dbc: &Statements,
        message: &MessageText,
        signal: &SignalText,
        path: &str,
    ) -> Option<Coding> {
        let (coding, size) = match dbc.types.get(message.id, &signal.name) {
            Some(1) => (Coding::Float32, 32),
            Some(2) => (Coding::Float64, 64),
            _ if signal.signed => (Coding::Signed, signal.size),
            _ => (Coding::Unsigned, signal.size),
        };
        if signal.size != size {
            self.note(
                signal.line,
                format!("float signal {path} has {} bits", signal.size),
                format!("{size} bits, as its SIG_VALTYPE_ requires"),
            );
            return None;
        }
        Some(coding)
    }

    /// True if the signal's bits lie inside the frame.
    fn place(&mut self, signal: &SignalText, len: usize, path: &str) -> bool {
        let line = signal.line;
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
                signal.big_endian,
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

    fn overlap(
        &mut self,
        message: &MessageText,
        index: usize,
        conditions: &[Option<Condition>],
        owners: &mut [Vec<usize>],
    ) {
        let signal = &message.signals[index];
        let mut overlapped: Vec<usize> = Vec::new();
        let bits = covered_bits(
            signal.start_bit as usize,
            signal.size as usize,
            signal.big_endian,
        );
        for bit in bits {
            if let Some(owners) = owners.get_mut(bit) {
                for &other in owners.iter() {
                    if !overlapped.contains(&other)
                        && multiplexing::share_a_frame(conditions, index, other)
                    {
                        overlapped.push(other);
                    }
                }
                owners.push(index);
            }
        }
        for other in overlapped {
            let (own, other) = (&signal.name, &message.signals[other].name);
            self.note(
                signal.line,
                format!("signal {}.{own} overlaps signal {other}", message.name),
                "one signal for each bit of a message",
            );
        }
    }

    fn signal(&mut self, signal: &SignalText, coding: Coding, typed: bool, path: &str) -> Signal {
        let line = signal.line;
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
            signal.big_endian,
            coding,
        );
        let (raw_min, raw_max) = packing.range();
        let ends = [raw_min, raw_max].map(|raw| raw * signal.factor + signal.offset);
        let held = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        let (min, max) = self.range(signal, held, path);
        if !typed && let Some(problem) = types::range_of_float(signal, held, path) {
            self.add(problem.at("", line));
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
            multiplexed: false,
            multiplexer: signal.multiplexer,
            start: None,
            line,
            packing,
            condition: None,
        }
    }

    /// The values that a signal may have, by its range and by what its bits can hold.
    fn range(&mut self, signal: &SignalText, held: (f64, f64), path: &str) -> (f64, f64) {
        let (line, written) = (signal.line, signal.range);
        if written.0 > written.1 || !written.0.is_finite() || !written.1.is_finite() {
            self.note(
                line,
                format!("signal {path} has range [{}|{}]", written.0, written.1),
                "a least value that does not exceed the greatest, or [0|0] for none",
            );
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
        (min, max)
    }

    /// The count that the attribute `GenSigStartValue` gives this signal; what the attribute has as
    /// its default for all signals nobody has chosen for this one.
    fn start(
        &mut self,
        dbc: &Statements,
        message: &MessageText,
        signal: &Signal,
        path: &str,
    ) -> Option<f64> {
        let value = dbc.starts.get(message.id, &signal.name)?.number();
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
