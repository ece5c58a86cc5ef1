//! A file's text: its values, and the lines on which their keys stand.

use problem::{Allowed, Problem, line_at};
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A text and the name that messages give it.
#[derive(Clone, Copy)]
pub(crate) struct Source<'a> {
    pub(crate) text: &'a str,
    pub(crate) file: &'a str,
}

impl Source<'_> {
    /// The table that the text holds; every number in it is finite.
    pub(crate) fn table<T: DeserializeOwned>(self) -> Result<T, Problem> {
        let problem = |e: toml::de::Error| {
            let line = e.span().map_or(0, |span| line_at(self.text, span.start));
            Problem::new(e.message(), "").at(self.file, line)
        };
        let table = toml::from_str(self.text).map_err(problem)?;
        self.finite(DeTable::parse(self.text).map_err(problem)?.get_ref(), "")?;
        Ok(table)
    }

    fn finite(self, table: &DeTable<'_>, path: &str) -> Result<(), Problem> {
        let dot = if path.is_empty() { "" } else { "." };
        let mut entries = table.iter();
        entries.try_for_each(|(key, value)| {
            self.finite_value(value, &format!("{path}{dot}{}", key.get_ref()))
        })
    }

    fn finite_value(self, value: &Spanned<DeValue<'_>>, path: &str) -> Result<(), Problem> {
        match value.get_ref() {
            DeValue::Float(text) => match text.as_str().parse::<f64>() {
                Ok(x) if !x.is_finite() => Err(Problem::new(
                    format!("{path} = {x}"),
                    Allowed::Finite.to_string(),
                )
                .at(self.file, line_at(self.text, value.span().start))),
                _ => Ok(()),
            },
            DeValue::Array(items) => (items.iter().enumerate())
                .try_for_each(|(i, item)| self.finite_value(item, &format!("{path}[{i}]"))),
            DeValue::Table(table) => self.finite(table, path),
            _ => Ok(()),
        }
    }

    /// Refuses a number that is not allowed.
    pub(crate) fn require(self, key: &str, value: f64, allowed: Allowed) -> Result<(), Problem> {
        if allowed.admits(value) {
            Ok(())
        } else {
            Err(self.refusal(key, format!("{key} = {value}"), allowed.to_string()))
        }
    }

    /// A problem with the value of a key, as `joint.gear_ratio`.
    pub(crate) fn refusal(
        self,
        key: &str,
        reason: impl Into<String>,
        allowed: impl Into<String>,
    ) -> Problem {
        Problem::new(reason, allowed).at(self.file, self.line(key))
    }

    /// The line of a key, or of the table in which it is missing.
    fn line(self, key: &str) -> usize {
        let Ok(document) = DeTable::parse(self.text) else {
            return 0;
        };
        let (mut table, mut line) = (document.get_ref(), 0);
        for part in key.split('.') {
            let Some(value) = table.get(part) else { break };
            line = line_at(self.text, value.span().start);
            let DeValue::Table(inner) = value.get_ref() else {
                break;
            };
            table = inner;
        }
        line
    }
}
