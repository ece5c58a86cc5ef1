//! Values that statements of their own give to messages and signals, by identifier and name.

use super::show_id;
use super::statements::{MessageText, Value};
use crate::frame::EXTENDED_ID;
use problem::{Problem, listed};
use std::collections::BTreeMap;

/// One value for each message, or for each signal of a message, with the line that gives it.
pub(super) struct Given<T>(BTreeMap<(u64, String), (T, usize)>);

impl<T> Default for Given<T> {
    fn default() -> Self {
        Self(BTreeMap::new())
    }
}

impl<T: PartialEq> Given<T> {
    /// Adds a value; the message's own has no signal.
    ///
    /// # Errors
    /// Another value than an earlier line has given.
    pub(super) fn insert(
        &mut self,
        id: u64,
        signal: &str,
        value: T,
        line: usize,
        what: &str,
    ) -> Result<(), Problem> {
        if let Some((before, first)) = self.0.get(&(id, signal.to_owned())) {
            if *before == value {
                return Ok(());
            }
            let of = if signal.is_empty() {
                ""
            } else {
                " for signal "
            };
            let reason = format!("{what}{of}{signal} contradicts line {first}");
            return Err(Problem::new(reason, "one of the two lines").at("", line));
        }
        self.0.insert((id, signal.to_owned()), (value, line));
        Ok(())
    }

    pub(super) fn get(&self, id: u64, signal: &str) -> Option<&T> {
        let found = self.0.get(&(id, signal.to_owned()))?;
        Some(&found.0)
    }

    pub(super) fn get_mut(&mut self, id: u64, signal: &str) -> Option<&mut T> {
        let found = self.0.get_mut(&(id, signal.to_owned()))?;
        Some(&mut found.0)
    }

    pub(super) fn line(&self, id: u64, signal: &str) -> usize {
        let found = self.0.get(&(id, signal.to_owned()));
        found.map_or(0, |found| found.1)
    }

    /// Refusals of statements that name no signal of the file: the one that is meant would go without. A statement
    /// about a message that was taken out of the file, with its signals, does no harm.
    pub(super) fn unmatched(&self, messages: &[MessageText], what: &str) -> Vec<Problem> {
        let of_key = |((id, signal), (_, line)): (&(u64, String), &(T, usize))| {
            let problem = unmatched(messages, *id, signal, what)?;
            Some(problem.at("", *line))
        };
        self.0.iter().filter_map(of_key).collect()
    }
}

fn unmatched(messages: &[MessageText], id: u64, signal: &str, what: &str) -> Option<Problem> {
    let has = |message: &&MessageText| message.signals.iter().any(|own| own.name == signal);
    let given = if signal.is_empty() {
        format!("{what} is given to a message")
    } else {
        format!("{what} is given to signal {signal} of a message")
    };
    match messages.iter().find(|message| message.id == id) {
        Some(_) if signal.is_empty() => None,
        Some(message) if has(&message) => None,
        Some(message) => {
            let reason = format!(
                "{what} is given to signal {signal} of message {}, which has no such signal",
                message.name
            );
            let elsewhere = messages.iter().find(has);
            let allowed = elsewhere.map_or_else(
                || listed(message.signals.iter().map(|own| own.name.as_str())),
                |other| whose(other, signal),
            );
            Some(Problem::new(reason, allowed))
        }
        None => {
            let extended = u64::from(EXTENDED_ID);
            let twin = |message: &&MessageText| message.id == id ^ extended;
            let meant = if signal.is_empty() {
                messages.iter().find(twin)?
            } else {
                messages.iter().find(has)?
            };
            let shown = u32::try_from(id).map_or_else(|_| id.to_string(), show_id);
            let reason = format!("{given} with id {shown}, which the file does not have");
            Some(Problem::new(reason, whose(meant, signal)))
        }
    }
}

/// The identifier to write instead.
fn whose(message: &MessageText, signal: &str) -> String {
    let (id, name) = (message.id, &message.name);
    if signal.is_empty() {
        format!("{id}, which is message {name}")
    } else {
        format!("{id} for {signal}, which is a signal of message {name}")
    }
}

impl Value {
    /// The number, also one that is written as a text.
    pub(super) fn number(&self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            Self::Text(text) => text.trim().parse().ok(),
        }
    }
}
