//! What is sent is always meant: constants, and signals of sent messages that nobody sets.

use super::find;
use crate::general::Bus;
use crate::reader::Diagnostics;
use can_codec::{Dbc, Message, Signal};
use problem::Problem;

/// Gives signals of a bus the start values of `[[bus]] constants`.
pub(super) fn set_constants(diagnostics: &Diagnostics<'_>, bus: &Bus, dbcs: &mut [Dbc]) {
    for (i, constant) in bus.constants.iter().enumerate() {
        let reject = |problem: Problem| {
            let key = format!("bus.constants ({})", bus.parameters.name);
            diagnostics.note_at(constant.place, problem.of(key));
        };
        if constant.signal.is_empty() || constant.value.is_nan() {
            continue;
        }
        if bus.constants[..i]
            .iter()
            .any(|other| other.signal == constant.signal)
        {
            let what = format!("{} is given twice", constant.signal);
            reject(Problem::new(what, "one value of each signal"));
            continue;
        }
        let Some((message, name)) = constant.signal.split_once('.') else {
            let what = format!("{:?} is not allowed", constant.signal);
            reject(Problem::new(what, "MESSAGE.signal"));
            continue;
        };
        let start = find(dbcs, message, name).and_then(|signal| start(signal, constant.value));
        match start {
            Err(problem) => reject(problem),
            Ok(start) => {
                let messages = dbcs.iter_mut().flat_map(|dbc| &mut dbc.messages);
                let mut of_message = messages.filter(|other| other.name == message);
                let signals = of_message.next().map(|message| message.signals.iter_mut());
                let signal = signals.and_then(|mut all| all.find(|signal| signal.name == name));
                if let Some(signal) = signal {
                    signal.start = Some(start);
                }
            }
        }
    }
}

/// The count that stands for a value.
fn start(signal: &Signal, value: f64) -> Result<f64, Problem> {
    if value < signal.min || value > signal.max {
        let what = format!("signal {} cannot be {value}", signal.name);
        let allowed = format!("{} to {} {}", signal.min, signal.max, signal.unit);
        return Err(Problem::new(what, allowed.trim_end().to_owned()));
    }
    let raw = (value - signal.offset) / signal.scale;
    Ok(if signal.coding.is_integer() {
        raw.round_ties_even()
    } else {
        raw
    })
}

/// Notes signals of a sent message that nobody sets and whose count zero means something else than
/// zero, or nothing.
pub(super) fn check(
    diagnostics: &Diagnostics<'_>,
    message: &Message,
    place: usize,
    key: &str,
    is_mapped: impl Fn(&Signal) -> bool,
) {
    for signal in &message.signals {
        if !message.is_selected(signal)
            || is_mapped(signal)
            || signal.start.is_some()
            || signal.zero_is_zero()
        {
            continue;
        }
        let path = format!("{}.{}", message.name, signal.name);
        let what = if signal.offset == 0.0 {
            format!(
                "{key}: its message has a signal {path} from {} to {}, and nothing says what is sent",
                signal.min, signal.max
            )
        } else {
            let (unit, value) = (&signal.unit, signal.offset);
            format!(
                "{key}: its message has a signal {path} whose count 0 means {value} {unit}, and \
                 nothing says what is sent"
            )
        };
        let allowed = format!(
            "in [[bus]]: constants = [{{ signal = \"{path}\", value = .. }}], or GenSigStartValue in \
             the DBC file"
        );
        diagnostics.at(place, what, allowed);
    }
}
