//! The statements of a DBC file that say something about frames, in its order and with their lines.

use super::frame_format::ATTRIBUTE;
use super::given::Given;
use super::scan::{KEYWORDS, Scan};
use problem::{Problem, listed};

/// How a message is written, for refusals.
const MESSAGE: &str = "BO_ id name: length node";

/// How a signal is written, for refusals.
const SIGNAL: &str = "SG_ name : start|size@order sign (scale,offset) [min|max] \"unit\" receivers";

/// How a type is written, for refusals.
const TYPE: &str = "SIG_VALTYPE_ id name : 1; (2 for 64 bits)";

/// How the values of a multiplexer are written, for refusals.
const SELECTION: &str = "SG_MUL_VAL_ id signal multiplexer from-to, from-to;";

/// Everything that is read of a file.
#[derive(Default)]
pub(super) struct Statements {
    pub(super) messages: Vec<MessageText>,
    /// Names of `VFrameFormat`'s enumeration.
    pub(super) format_names: Given<Vec<String>>,
    /// `VFrameFormat` of messages that have none of their own.
    pub(super) default_format: Given<Value>,
    /// `VFrameFormat` of messages.
    pub(super) formats: Given<Value>,
    /// `GenSigStartValue` of signals.
    pub(super) starts: Given<Value>,
    /// `SIG_VALTYPE_` of signals.
    pub(super) types: Given<u64>,
    /// `SG_MUL_VAL_` of signals.
    pub(super) selections: Given<Selection>,
}

/// `BO_`.
pub(super) struct MessageText {
    /// Identifier as written, bit 31 included.
    pub(super) id: u64,
    pub(super) name: String,
    pub(super) size: u64,
    pub(super) line: usize,
    pub(super) signals: Vec<SignalText>,
}

/// `SG_`.
pub(super) struct SignalText {
    pub(super) name: String,
    /// `M`.
    pub(super) multiplexer: bool,
    /// The number behind `m`.
    pub(super) selector: Option<u64>,
    pub(super) start_bit: u64,
    pub(super) size: u64,
    pub(super) big_endian: bool,
    pub(super) signed: bool,
    pub(super) factor: f64,
    pub(super) offset: f64,
    pub(super) range: (f64, f64),
    pub(super) unit: String,
    pub(super) line: usize,
}

/// Value of an attribute.
#[derive(Clone, PartialEq)]
pub(super) enum Value {
    Number(f64),
    Text(String),
}

/// Values of a multiplexer in whose frames a signal is, ends included.
#[derive(Clone, PartialEq)]
pub(super) struct Selection {
    pub(super) multiplexer: String,
    pub(super) ranges: Vec<(u64, u64)>,
}

/// The statements of a file whose lines end with `\n`.
///
/// # Errors
/// The first place at which no statement can be read.
pub(super) fn read(text: &str) -> Result<Statements, Problem> {
    let mut found = Statements::default();
    let mut scan = Scan::new(text);
    while !scan.at_end() {
        if scan.sign_if(';') {
            continue;
        }
        let line = scan.line();
        let keyword = scan.peek_word();
        if !KEYWORDS.contains(&keyword) {
            let keywords = listed(KEYWORDS.iter().copied());
            return Err(scan.misplaced(&format!("a statement: {keywords}")));
        }
        scan.word("a keyword")?;
        match keyword {
            "BO_" => message(&mut scan, line, &mut found).map_err(in_form(MESSAGE))?,
            "SG_" => signal(&mut scan, line, &mut found).map_err(in_form(SIGNAL))?,
            "SIG_VALTYPE_" => value_type(&mut scan, line, &mut found).map_err(in_form(TYPE))?,
            "SG_MUL_VAL_" => selection(&mut scan, line, &mut found).map_err(in_form(SELECTION))?,
            "BA_DEF_" => definition(&mut scan, line, &mut found)?,
            "BA_DEF_DEF_" => default(&mut scan, line, &mut found)?,
            "BA_" => attribute(&mut scan, line, &mut found)?,
            "VERSION" => {
                scan.quoted("the version")?;
            }
            "NS_" => symbols(&mut scan)?,
            "BS_" => scan.pass_line(),
            "BU_" => nodes(&mut scan)?,
            "CM_" => comment(&mut scan)?,
            // Programs leave the semicolon out, and nothing follows from the statement.
            "VAL_" => scan.pass_statement(true)?,
            _ => scan.pass_statement(false)?,
        }
    }
    Ok(found)
}

/// Adds the whole statement's form to a refusal.
fn in_form(form: &'static str) -> impl Fn(Problem) -> Problem {
    move |mut problem| {
        problem.allowed = format!("{}, as in `{form}`", problem.allowed);
        problem
    }
}

/// `NS_ :`, and words alone on their lines.
fn symbols(scan: &mut Scan) -> Result<(), Problem> {
    scan.sign(':')?;
    scan.pass_line();
    loop {
        let mut next = scan.clone();
        if !next.pass_word() || !next.at_new_line() {
            return Ok(());
        }
        *scan = next;
    }
}

/// `BU_: A B`, on one or several lines.
fn nodes(scan: &mut Scan) -> Result<(), Problem> {
    scan.sign(':')?;
    while !scan.at_keyword() && (scan.pass_word() || scan.sign_if(',')) {}
    Ok(())
}

/// A comment; some programs leave the semicolon out.
fn comment(scan: &mut Scan) -> Result<(), Problem> {
    while scan.peek() != Some('"') && !scan.at_keyword() && scan.pass_word() {}
    scan.quoted("the comment")?;
    if scan.sign_if(';') || scan.at_end() || scan.at_keyword() {
        Ok(())
    } else {
        Err(scan.unexpected("`;`"))
    }
}

fn message(scan: &mut Scan, line: usize, found: &mut Statements) -> Result<(), Problem> {
    let id = scan.whole("an identifier")?;
    let name = scan.word("the message's name")?.to_owned();
    scan.sign(':')?;
    let size = scan.whole("the length in bytes")?;
    if !scan.at_new_line() {
        scan.pass_word();
    }
    found.messages.push(MessageText {
        id,
        name,
        size,
        line,
        signals: Vec::new(),
    });
    if scan.at_new_line() || scan.peek_word() == "SG_" {
        Ok(())
    } else {
        Err(scan.unexpected("the line's end"))
    }
}

fn signal(scan: &mut Scan, line: usize, found: &mut Statements) -> Result<(), Problem> {
    let Some(message) = found.messages.last_mut() else {
        let reason = "a signal stands before any message";
        return Err(Problem::new(reason, "`BO_` before it").at("", line));
    };
    let name = scan.word("the signal's name")?.to_owned();
    let (selector, multiplexer) = mark(scan)?;
    scan.sign(':')?;
    let start_bit = scan.whole("the start bit")?;
    scan.sign('|')?;
    let size = scan.whole("the number of bits")?;
    scan.sign('@')?;
    let order = either(scan, '0', '1', "`0` (Motorola) or `1` (Intel)")?;
    let sign = either(scan, '-', '+', "the sign, `-` or `+` (unsigned)")?;
    scan.sign('(')?;
    let factor = scan.number("the scale")?;
    scan.sign(',')?;
    let offset = scan.number("the offset")?;
    scan.sign(')')?;
    scan.sign('[')?;
    let min = scan.number("the least value")?;
    scan.sign('|')?;
    let max = scan.number("the greatest value")?;
    scan.sign(']')?;
    let unit = scan.quoted("the unit")?.to_owned();
    receivers(scan)?;
    message.signals.push(SignalText {
        name,
        multiplexer,
        selector,
        start_bit,
        size,
        big_endian: order,
        signed: sign,
        factor,
        offset,
        range: (min, max),
        unit,
        line,
    });
    Ok(())
}

/// `M`, `m3`, `m3M` or nothing.
fn mark(scan: &mut Scan) -> Result<(Option<u64>, bool), Problem> {
    let before = scan.clone();
    if scan.peek() == Some(':') {
        return Ok((None, false));
    }
    let written = scan.word("`:`")?;
    let (number, multiplexer) = match written.strip_suffix('M') {
        Some(number) => (number, true),
        None => (written, false),
    };
    match number.strip_prefix('m').map(str::parse) {
        None if number.is_empty() => Ok((None, multiplexer)),
        Some(Ok(selector)) => Ok((Some(selector), multiplexer)),
        _ => {
            Err(before
                .unexpected("`M`, `m` with a number from 0 on, or both for multiplexing, or `:`"))
        }
    }
}

/// True for the first sign, false for the second.
fn either(scan: &mut Scan, first: char, second: char, meaning: &str) -> Result<bool, Problem> {
    if scan.sign_if(first) {
        return Ok(true);
    }
    if scan.sign_if(second) {
        return Ok(false);
    }
    Err(scan.unexpected(meaning))
}

/// Names between commas; some programs write none, or a semicolon behind them.
fn receivers(scan: &mut Scan) -> Result<(), Problem> {
    if !scan.at_new_line() {
        scan.pass_word();
        while scan.sign_if(',') {
            if !scan.at_keyword() {
                scan.pass_word();
            }
        }
        scan.sign_if(';');
    }
    if scan.at_new_line() || scan.peek_word() == "SG_" {
        Ok(())
    } else {
        Err(scan.unexpected("the line's end, or `,` between receivers"))
    }
}

fn value_type(scan: &mut Scan, line: usize, found: &mut Statements) -> Result<(), Problem> {
    let (id, signal) = (scan.whole("an identifier")?, scan.word("a signal")?);
    // The format's description leaves the colon out, programs write it.
    scan.sign_if(':');
    let before = scan.clone();
    let value = scan.whole("the type")?;
    if value > 2 {
        return Err(before.unexpected("0 (integer), 1 (float of 32 bits) or 2 (of 64 bits)"));
    }
    scan.sign(';')?;
    found.types.insert(id, signal, value, line, "SIG_VALTYPE_")
}

fn selection(scan: &mut Scan, line: usize, found: &mut Statements) -> Result<(), Problem> {
    let (id, signal) = (scan.whole("an identifier")?, scan.word("a signal")?);
    let multiplexer = scan.word("its multiplexer")?.to_owned();
    let mut ranges = Vec::new();
    loop {
        let before = scan.clone();
        let from = scan.whole("a value")?;
        scan.sign('-')?;
        let to = scan.whole("a value")?;
        if from > to {
            return Err(before.unexpected("a range that does not run backwards"));
        }
        ranges.push((from, to));
        if !scan.sign_if(',') {
            break;
        }
    }
    scan.sign(';')?;
    if let Some(before) = found.selections.get_mut(id, signal)
        && before.multiplexer == multiplexer
    {
        before.ranges.extend(ranges);
        return Ok(());
    }
    let value = Selection {
        multiplexer,
        ranges,
    };
    found
        .selections
        .insert(id, signal, value, line, "SG_MUL_VAL_")
}

/// An attribute's definition; enumerations are kept.
fn definition(scan: &mut Scan, line: usize, found: &mut Statements) -> Result<(), Problem> {
    let of = scan.peek_word();
    if !of.is_empty() {
        scan.word("")?;
    }
    let name = scan.quoted("an attribute's name")?;
    if of != "BO_" || name != ATTRIBUTE || scan.peek_word() != "ENUM" {
        return scan.pass_statement(false);
    }
    scan.word("")?;
    let mut names = Vec::new();
    loop {
        names.push(scan.quoted("a name")?.to_owned());
        if !scan.sign_if(',') {
            break;
        }
    }
    scan.sign(';')?;
    let what = "BA_DEF_ \"VFrameFormat\"";
    found.format_names.insert(0, "", names, line, what)
}

fn default(scan: &mut Scan, line: usize, found: &mut Statements) -> Result<(), Problem> {
    let name = scan.quoted("an attribute's name")?;
    if name != ATTRIBUTE {
        return scan.pass_statement(false);
    }
    let value = value(scan)?;
    scan.sign(';')?;
    let what = "BA_DEF_DEF_ \"VFrameFormat\"";
    found.default_format.insert(0, "", value, line, what)
}

fn attribute(scan: &mut Scan, line: usize, found: &mut Statements) -> Result<(), Problem> {
    let name = scan.quoted("an attribute's name")?;
    let list = match (name, scan.peek_word()) {
        (ATTRIBUTE, "BO_") => &mut found.formats,
        ("GenSigStartValue", "SG_") => &mut found.starts,
        _ => return scan.pass_statement(false),
    };
    let of_signal = scan.word("")? == "SG_";
    let id = scan.whole("an identifier")?;
    let signal = if of_signal {
        scan.word("a signal")?
    } else {
        ""
    };
    let value = value(scan)?;
    scan.sign(';')?;
    list.insert(id, signal, value, line, name)
}

fn value(scan: &mut Scan) -> Result<Value, Problem> {
    if scan.peek() == Some('"') {
        return Ok(Value::Text(scan.quoted("a value")?.to_owned()));
    }
    scan.number("the value").map(Value::Number)
}
