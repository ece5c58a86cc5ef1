//! Signals that are only in some of their message's frames, and the multiplexers that choose.

use super::Signal;
use super::statements::{MessageText, SignalText, Statements};
use problem::{Problem, listed};

/// A signal is present if a multiplexer has one of some values.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Condition {
    /// Index of the multiplexer among the message's signals.
    pub(crate) multiplexer: usize,
    /// Values of the multiplexer, ends included.
    pub(crate) ranges: Vec<(u64, u64)>,
}

/// For each signal of a message its condition; none: it is in all frames.
///
/// Where `SG_MUL_VAL_` names no multiplexer it is the message's only one.
///
/// # Errors
/// Each multiplexer that is missing, is none, or chooses itself, with its line.
pub(super) fn conditions(
    dbc: &Statements,
    message: &MessageText,
) -> (Vec<Option<Condition>>, Vec<Problem>) {
    let mut problems = Vec::new();
    let mut conditions: Vec<Option<Condition>> = Vec::new();
    for signal in &message.signals {
        let condition = condition(dbc, message, signal);
        conditions.push(condition.unwrap_or_else(|problem| {
            problems.push(problem);
            None
        }));
    }
    for start in 0..conditions.len() {
        let chain = chain(&conditions, start);
        if chain.last().is_some_and(|last| last.multiplexer == start) {
            let signal = &message.signals[start];
            let reason = format!(
                "signal {}.{} is chosen by itself in the end",
                message.name, signal.name
            );
            let line = dbc
                .selections
                .line(message.id, &signal.name)
                .max(signal.line);
            problems.push(Problem::new(reason, "a multiplexer that is in all frames").at("", line));
        }
    }
    if !problems.is_empty() {
        conditions.fill(None);
    }
    (conditions, problems)
}

fn condition(
    dbc: &Statements,
    message: &MessageText,
    signal: &SignalText,
) -> Result<Option<Condition>, Problem> {
    let path = format!("{}.{}", message.name, signal.name);
    let chooses = |other: &&SignalText| other.multiplexer;
    let named = dbc.selections.get(message.id, &signal.name);
    if let Some(selection) = named {
        let name = &selection.multiplexer;
        let signals = message.signals.iter();
        let place = signals
            .clone()
            .position(|s| s.name == *name && s.multiplexer);
        let Some(multiplexer) = place else {
            let reason = format!("signal {path} is chosen by {name}, which is no multiplexer");
            let names = signals.filter(chooses).map(|s| s.name.as_str());
            let line = dbc.selections.line(message.id, &signal.name);
            let allowed = format!(
                "a signal of message {} with the mark `M`: {}",
                message.name,
                listed(names)
            );
            return Err(Problem::new(reason, allowed).at("", line));
        };
        let ranges = selection.ranges.clone();
        return Ok(Some(Condition {
            multiplexer,
            ranges,
        }));
    }
    let Some(selector) = signal.selector else {
        return Ok(None);
    };
    let signals = message.signals.iter().enumerate();
    let mut multiplexers =
        signals.filter(|(_, other)| other.multiplexer && other.name != signal.name);
    let refused =
        |reason: String, allowed: &str| Err(Problem::new(reason, allowed).at("", signal.line));
    match (multiplexers.next(), multiplexers.next()) {
        (Some((multiplexer, _)), None) => {
            let ranges = vec![(selector, selector)];
            Ok(Some(Condition {
                multiplexer,
                ranges,
            }))
        }
        (None, _) => {
            let reason = format!(
                "signal {path} is multiplexed (`m{selector}`), but its message has no multiplexer"
            );
            refused(reason, "a signal of the message with the mark `M`")
        }
        (Some((_, first)), Some((_, second))) => {
            let (first, second) = (&first.name, &second.name);
            let reason =
                format!("signal {path} is multiplexed (`m{selector}`) by {first} or by {second}");
            refused(
                reason,
                "`SG_MUL_VAL_ id signal multiplexer from-to;`, which says by which of them",
            )
        }
    }
}

/// The conditions on which a signal is in a frame: its own, its multiplexer's, and so on. Of a circle as many as
/// there are signals.
pub(super) fn chain(conditions: &[Option<Condition>], start: usize) -> Vec<&Condition> {
    let mut chain: Vec<&Condition> = Vec::new();
    let mut at = start;
    while let Some(Some(condition)) = conditions.get(at)
        && chain.len() < conditions.len()
    {
        chain.push(condition);
        at = condition.multiplexer;
        if at == start {
            break;
        }
    }
    chain
}

/// Signals share no frame if one multiplexer would have to have two values.
pub(super) fn share_a_frame(conditions: &[Option<Condition>], a: usize, b: usize) -> bool {
    let (of_a, of_b) = (chain(conditions, a), chain(conditions, b));
    let apart = |a: &Condition, b: &Condition| {
        let meet = |(from, to): &(u64, u64)| {
            b.ranges
                .iter()
                .any(|other| from.max(&other.0) <= to.min(&other.1))
        };
        a.multiplexer == b.multiplexer && !a.ranges.iter().any(meet)
    };
    !of_a.iter().any(|a| of_b.iter().any(|b| apart(a, b)))
}

/// Refuses what no frame can have: a multiplexer that does not count, or values that its bits do not hold.
pub(super) fn unreachable(signals: &[Signal], signal: &Signal, message: &str) -> Option<Problem> {
    let condition = signal.condition.as_ref()?;
    let by = signals.get(condition.multiplexer)?;
    let (name, path) = (&by.name, format!("{message}.{}", signal.name));
    if !by.coding.is_integer() {
        let reason = format!("signal {path} is chosen by {name}, which is a float");
        return Some(Problem::new(reason, "a multiplexer that is an integer").at("", by.line));
    }
    let (_, greatest) = by.raw_range();
    let least = condition.ranges.iter().map(|range| range.0).min()?;
    let held = 2f64.powi(i32::from(by.size)) - 1.0;
    (least as f64 > held).then(|| {
        let reason = format!(
            "signal {path} is chosen where {name} is {least}, which its {} bits cannot be",
            by.size
        );
        Problem::new(reason, format!("0 to {greatest}")).at("", signal.line)
    })
}
