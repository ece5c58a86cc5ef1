//! `SIG_VALTYPE_`: the statement by which a signal is a float and no integer.

use super::show_id;
use can_dbc::Dbc;
use problem::Problem;
use std::borrow::Cow;
use std::fmt::Write as _;

/// The keyword of the statement.
const KEYWORD: &str = "SIG_VALTYPE_";

/// How the statement is written, for messages.
pub(super) const FORM: &str = "SIG_VALTYPE_ id name : 1; (2 for 64 bits)";

/// Parts by which a range exceeds what an integer's bits can hold from which on it is a float's: real
/// files have ranges that are some powers of ten too wide, a float's ends at 3.4e38.
const FLOAT_RANGE: f64 = 1e6;

/// Ends of a range, in counts, below which a fraction is a choice: beyond them it may be the rounding of a unit.
const FRACTIONS: f64 = 1e4;

/// True if a line is such a statement.
pub(super) fn is_one(line: &str) -> bool {
    line.trim_start().starts_with(KEYWORD)
}

/// The text with the colon that the format's description leaves out of the statement, and that every program writes.
pub(super) fn with_colons(text: &str) -> Cow<'_, str> {
    let lacks =
        |line: &str| is_one(line) && !line.contains(':') && line.split_whitespace().count() == 4;
    if !text.lines().any(lacks) {
        return Cow::Borrowed(text);
    }
    let mut whole = String::with_capacity(text.len() + 64);
    for line in text.split_inclusive('\n') {
        match line.trim_end().rsplit_once([' ', '\t']) {
            Some((before, kind)) if lacks(line) => {
                let _ = writeln!(whole, "{before} : {kind}");
            }
            _ => whole.push_str(line),
        }
    }
    Cow::Owned(whole)
}

/// Statements that name no signal of the file, each with its line: the signal that is meant would be taken for an
/// integer. One of a message that was taken out of the file, with its signals, does no harm.
pub(super) fn unmatched(dbc: &Dbc, text: &str) -> Vec<(usize, Problem)> {
    let mut found = Vec::new();
    for typed in &dbc.signal_extended_value_type_list {
        let name = &typed.signal_name;
        let has = |message: &&can_dbc::Message| message.signals.iter().any(|s| s.name == *name);
        let own = dbc
            .messages
            .iter()
            .find(|message| message.id == typed.message_id);
        let elsewhere = dbc.messages.iter().find(has);
        let reason = match own {
            Some(message) if has(&message) => continue,
            None if elsewhere.is_none() => continue,
            Some(message) => format!(
                "{KEYWORD} gives a type to signal {name} of message {}, which has no such signal",
                message.name
            ),
            None => format!(
                "{KEYWORD} gives a type to signal {name} of a message with id {}, which the file does not have",
                show_id(typed.message_id.raw())
            ),
        };
        let allowed = match (elsewhere, own) {
            (Some(message), _) => format!(
                "{} for {name}, which is a signal of message {}",
                message.id.raw(),
                message.name
            ),
            (None, Some(message)) => {
                problem::listed(message.signals.iter().map(|s| s.name.as_str()))
            }
            (None, None) => String::new(),
        };
        found.push((line_of(text, name), Problem::new(reason, allowed)));
    }
    found
}

/// The line of the statement for a signal of that name; 0 if it is not at the start of a line.
fn line_of(text: &str, name: &str) -> usize {
    let names = |line: &str| is_one(line) && line.split_whitespace().any(|word| word == name);
    let found = text.lines().position(names);
    found.map_or(0, |line| line + 1)
}

/// Refuses a range that only a float can have, of bits that are an integer's for want of a type; `path` is
/// `MESSAGE.signal`, `held` what the integer can be.
pub(super) fn range_of_float(
    signal: &can_dbc::Signal,
    written: (f64, f64),
    held: (f64, f64),
    path: &str,
) -> Option<Problem> {
    let reach = |(low, high): (f64, f64)| low.abs().max(high.abs());
    if !matches!(signal.size, 32 | 64) || reach(held) == 0.0 {
        return None;
    }
    let broken = |value: f64| value.fract() != 0.0;
    // Whole counts of one unit each have no fractions.
    let fractions = signal.factor == 1.0
        && !broken(signal.offset)
        && (broken(written.0) || broken(written.1))
        && reach(written) < FRACTIONS;
    let too_wide = reach(written) > FLOAT_RANGE * reach(held);
    let why = if too_wide {
        format!("holds at most [{:e}|{:e}]", held.0, held.1)
    } else if fractions {
        "holds whole numbers alone".to_owned()
    } else {
        return None;
    };
    let ends = if too_wide {
        format!("[{:e}|{:e}]", written.0, written.1)
    } else {
        format!("[{}|{}]", written.0, written.1)
    };
    let size = signal.size;
    let reason = format!(
        "signal {path} has range {ends}, but as an integer of {size} bits it {why}: its type is missing"
    );
    let number = if size == 32 { 1 } else { 2 };
    let (message, name) = path.split_once('.').unwrap_or((path, ""));
    let allowed = format!(
        "for a float, `{KEYWORD} ID {name} : {number};` with the id of {message}; for an integer, a range that it holds, or [0|0]"
    );
    Some(Problem::new(reason, allowed))
}
