//! `VFrameFormat`: the attribute by which a message travels as a classic or as a CAN FD frame.

use super::statements::{MessageText, Statements, Value};
use problem::{Problem, listed};

/// Name of the attribute.
pub(super) const ATTRIBUTE: &str = "VFrameFormat";

/// Numbers of `StandardCAN_FD` and `ExtendedCAN_FD` in CANdb++'s enumeration.
const FD_NUMBERS: [f64; 2] = [14.0, 15.0];

/// Bytes that a classic frame carries.
const CLASSIC: u64 = 8;

/// Whether a message is a CAN FD frame by its `VFrameFormat`: by name, or by number in the file's own
/// enumeration. Without an enumeration, and for 14 and 15 beyond a shorter one, numbers count as in
/// CANdb++'s.
///
/// # Errors
/// A value that the enumeration does not have.
pub(super) fn is_fd(dbc: &Statements, message: &MessageText) -> Result<bool, Problem> {
    let own = dbc.formats.get(message.id, "");
    let Some(value) = own.or_else(|| dbc.default_format.get(0, "")) else {
        return Ok(false);
    };
    if let Some(name) = name(dbc, value) {
        // A default that no message has is no message's format.
        let listed = names(dbc).is_none_or(|names| names.iter().any(|own| own == name));
        return if own.is_some() && !listed {
            Err(unknown(dbc, message, value))
        } else {
            Ok(names_fd(name))
        };
    }
    let number = value.number().unwrap_or(f64::NAN);
    if FD_NUMBERS.contains(&number) {
        Ok(true)
    } else if names(dbc).is_none() && number >= 0.0 && number.fract() == 0.0 {
        Ok(false)
    } else {
        Err(unknown(dbc, message, value))
    }
}

/// Refuses a message that its own `VFrameFormat` is not for.
///
/// # Errors
/// An 11-bit identifier of `ExtendedCAN`, a 29-bit one of `StandardCAN`, more than 8 bytes of a classic format. A
/// default counts for no message: files have one for all kinds.
pub(super) fn check(
    dbc: &Statements,
    message: &MessageText,
    extended: bool,
) -> Result<(), Problem> {
    let own = dbc.formats.get(message.id, "");
    let Some(name) = own.and_then(|value| name(dbc, value)) else {
        return Ok(());
    };
    let (bits, other) = if extended {
        (29, "standard")
    } else {
        (11, "extended")
    };
    if name.to_ascii_lowercase().contains(other) {
        let reason = format!(
            "message {} has an identifier of {bits} bits and {ATTRIBUTE} {name}",
            message.name
        );
        let allowed = "an extended identifier (29 bits) is its number plus 2147483648 in BO_; else \
                       StandardCAN or StandardCAN_FD";
        return Err(Problem::new(reason, allowed));
    }
    if message.size > CLASSIC && !names_fd(name) {
        let (message, size) = (&message.name, message.size);
        let reason = format!("message {message} is {size} bytes long and has {ATTRIBUTE} {name}");
        return Err(Problem::new(
            reason,
            "a format of CAN FD, or at most 8 bytes",
        ));
    }
    Ok(())
}

/// The file's own enumeration.
fn names(dbc: &Statements) -> Option<&Vec<String>> {
    dbc.format_names.get(0, "")
}

/// The name of a format: as written, or of that number in the file's enumeration.
fn name<'a>(dbc: &'a Statements, value: &'a Value) -> Option<&'a str> {
    match (value, value.number()) {
        (Value::Text(name), None) => Some(name),
        (_, Some(number)) if number >= 0.0 && number.fract() == 0.0 => {
            let name = names(dbc)?.get(number as usize)?;
            Some(name)
        }
        _ => None,
    }
}

/// A value that the enumeration does not have.
fn unknown(dbc: &Statements, message: &MessageText, value: &Value) -> Problem {
    let written = match value {
        Value::Number(number) => number.to_string(),
        Value::Text(text) => text.clone(),
    };
    let reason = format!("message {} has {ATTRIBUTE} {written}", message.name);
    let numbered: Vec<String> = (names(dbc).into_iter().flatten().enumerate())
        .map(|(number, name)| format!("{number} ({name})"))
        .collect();
    let allowed = if numbered.is_empty() {
        "a whole number from 0 on".to_owned()
    } else {
        let numbered = listed(numbered.iter().map(String::as_str));
        format!("a number or name of the file's enumeration: {numbered}")
    };
    Problem::new(reason, allowed)
}

/// `StandardCAN_FD`, `ExtendedCANFD`, `CAN FD`.
fn names_fd(name: &str) -> bool {
    let letters: String = (name.chars())
        .filter(char::is_ascii_alphanumeric)
        .map(|letter| letter.to_ascii_uppercase())
        .collect();
    letters.contains("FD")
}
