//! `VFrameFormat`: the attribute by which a message travels as a classic or as a CAN FD frame.

use can_dbc::{AttributeDefinition, AttributeValue, AttributeValueType};
use problem::{Problem, listed};

const ATTRIBUTE: &str = "VFrameFormat";

/// Whether a message is a CAN FD frame by its `VFrameFormat`: by name, or by number in the file's own
/// enumeration. Without an enumeration, and for 14 and 15 beyond a shorter one, numbers count as in
/// CANdb++'s, where these two are `StandardCAN_FD` and `ExtendedCAN_FD`.
///
/// # Errors
/// A value that the enumeration does not have.
pub(super) fn is_fd(dbc: &can_dbc::Dbc, message: &can_dbc::Message) -> Result<bool, Problem> {
    let names = names(dbc);
    let number = match dbc.resolved_message_attribute(message.id, ATTRIBUTE) {
        None => return Ok(false),
        Some(AttributeValue::String(name)) => match name.trim().parse::<u64>() {
            Ok(number) => Some(number),
            Err(_) => {
                let own = dbc.message_attribute(message.id, ATTRIBUTE).is_some();
                let listed = names.is_none_or(|names| names.contains(name));
                // A default that no message has is no message's format.
                return if own && !listed {
                    Err(unknown(dbc, message, names))
                } else {
                    Ok(names_fd(name))
                };
            }
        },
        Some(AttributeValue::Uint(number)) => Some(*number),
        Some(AttributeValue::Int(number)) => u64::try_from(*number).ok(),
        Some(AttributeValue::Double(number)) if number.fract() == 0.0 && *number >= 0.0 => {
            Some(*number as u64)
        }
        Some(AttributeValue::Double(_)) => None,
    };
    let own = number.and_then(|number| names?.get(usize::try_from(number).ok()?));
    match (own, number, names) {
        (Some(name), ..) => Ok(names_fd(name)),
        (None, Some(14 | 15), _) => Ok(true),
        (None, Some(_), None) => Ok(false),
        (None, ..) => Err(unknown(dbc, message, names)),
    }
}

/// Refuses a message whose own `VFrameFormat` is for identifiers of the other length.
///
/// # Errors
/// An 11-bit identifier of `ExtendedCAN`, or a 29-bit one of `StandardCAN`. A default counts for no message: files
/// have one for both kinds.
pub(super) fn check_id(
    dbc: &can_dbc::Dbc,
    message: &can_dbc::Message,
    extended: bool,
) -> Result<(), Problem> {
    let names = names(dbc);
    let name = match dbc.message_attribute(message.id, ATTRIBUTE) {
        Some(AttributeValue::String(name)) => match name.trim().parse::<usize>() {
            Ok(number) => names.and_then(|names| names.get(number)),
            Err(_) => Some(name),
        },
        Some(AttributeValue::Uint(number)) => usize::try_from(*number)
            .ok()
            .and_then(|number| names?.get(number)),
        Some(AttributeValue::Int(number)) => usize::try_from(*number)
            .ok()
            .and_then(|number| names?.get(number)),
        _ => None,
    };
    let Some(name) = name else { return Ok(()) };
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
    Ok(())
}

/// The file's own enumeration.
fn names(dbc: &can_dbc::Dbc) -> Option<&Vec<String>> {
    dbc.attribute_definitions
        .iter()
        .find_map(|definition| match definition {
            AttributeDefinition::Message(name, AttributeValueType::Enum(names))
                if name == ATTRIBUTE =>
            {
                Some(names)
            }
            _ => None,
        })
}

/// A value that the enumeration does not have.
fn unknown(dbc: &can_dbc::Dbc, message: &can_dbc::Message, names: Option<&Vec<String>>) -> Problem {
    let written = match dbc.resolved_message_attribute(message.id, ATTRIBUTE) {
        Some(AttributeValue::Uint(number)) => number.to_string(),
        Some(AttributeValue::Int(number)) => number.to_string(),
        Some(AttributeValue::Double(number)) => number.to_string(),
        Some(AttributeValue::String(text)) => text.clone(),
        None => String::new(),
    };
    let reason = format!("message {} has {ATTRIBUTE} {written}", message.name);
    let numbered: Vec<String> = (names.into_iter().flatten().enumerate())
        .map(|(number, name)| format!("{number} ({name})"))
        .collect();
    let numbered = listed(numbered.iter().map(String::as_str));
    let allowed = format!("a number or name of the file's enumeration: {numbered}");
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
