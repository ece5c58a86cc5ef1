//! Values of keys: numbers, flags, texts and choices.

use super::{Allowed, At, Section};
use core::ops::Range;
use toml::Spanned;
use toml::de::DeValue;

impl<'n, 't> Section<'n, 't> {
    /// A number; NaN stands for one with a problem.
    pub(crate) fn number(&self, key: &'static str, allowed: Allowed) -> f64 {
        match self.find(key) {
            Some(value) => self.as_number(key, value, allowed),
            None => {
                self.missing(key, allowed);
                f64::NAN
            }
        }
    }

    pub(crate) fn number_or(&self, key: &'static str, default: f64, allowed: Allowed) -> f64 {
        self.default(key, default);
        self.find(key)
            .map_or(default, |value| self.as_number(key, value, allowed))
    }

    pub(crate) fn optional_number(&self, key: &'static str, allowed: Allowed) -> Option<f64> {
        self.find(key)
            .map(|value| self.as_number(key, value, allowed))
    }

    pub(super) fn as_number(
        &self,
        key: &str,
        value: &Spanned<DeValue<'t>>,
        allowed: Allowed,
    ) -> f64 {
        let number = match value.get_ref() {
            DeValue::Float(text) => text.as_str().parse().ok(),
            DeValue::Integer(text) => i64::from_str_radix(text.as_str(), text.radix())
                .ok()
                .map(|integer| integer as f64),
            _ => None,
        };
        match number {
            Some(number) if allowed.admits(number) => number,
            _ => {
                self.wrong(key, value, &allowed);
                f64::NAN
            }
        }
    }

    /// An integer; `min` stands for one with a problem.
    pub(crate) fn integer(&self, key: &'static str, allowed: Range<u64>) -> u64 {
        match self.find(key) {
            Some(value) => self.as_integer(key, value, &allowed),
            None => {
                self.missing(key, show_range(&allowed));
                allowed.start
            }
        }
    }

    pub(crate) fn optional_integer(&self, key: &'static str, allowed: Range<u64>) -> Option<u64> {
        self.find(key)
            .map(|value| self.as_integer(key, value, &allowed))
    }

    fn as_integer(&self, key: &str, value: &Spanned<DeValue<'t>>, allowed: &Range<u64>) -> u64 {
        let integer = match value.get_ref() {
            DeValue::Integer(text) => u64::from_str_radix(text.as_str(), text.radix()).ok(),
            _ => None,
        };
        match integer {
            Some(integer) if allowed.contains(&integer) => integer,
            _ => {
                self.wrong(key, value, &show_range(allowed));
                allowed.start
            }
        }
    }

    pub(crate) fn flag_or(&self, key: &'static str, default: bool) -> bool {
        self.default(key, default);
        match self.find(key).map(|value| (value, value.get_ref())) {
            None => default,
            Some((_, DeValue::Boolean(flag))) => *flag,
            Some((value, _)) => {
                self.wrong(key, value, &"true or false");
                default
            }
        }
    }

    /// +1 or -1.
    pub(crate) fn sign_or(&self, key: &'static str, default: f64) -> f64 {
        self.default(key, default);
        match self.find(key) {
            None => default,
            Some(value) => match value.get_ref() {
                DeValue::Integer(text) if text.as_str() == "-1" => -1.0,
                DeValue::Integer(text) if matches!(text.as_str(), "1" | "+1") => 1.0,
                _ => {
                    self.wrong(key, value, &"1 or -1");
                    default
                }
            },
        }
    }

    /// A text that is not empty; nothing stands for one with a problem.
    pub(crate) fn text(&self, key: &'static str, allowed: &str) -> Option<At<&'n str>> {
        let text = self.optional_text(key, allowed);
        if text.is_none() && !self.has(key) {
            self.missing(key, allowed);
        }
        text
    }

    pub(crate) fn optional_text(&self, key: &'static str, allowed: &str) -> Option<At<&'n str>> {
        let value = self.find(key)?;
        self.as_text(key, value, allowed)
    }

    pub(super) fn as_text(
        &self,
        key: &str,
        value: &'n Spanned<DeValue<'t>>,
        allowed: &str,
    ) -> Option<At<&'n str>> {
        match value.get_ref() {
            DeValue::String(text) if !text.is_empty() => Some(At {
                value: text,
                place: value.span().start,
            }),
            _ => {
                self.wrong(key, value, &allowed);
                None
            }
        }
    }

    /// One of several words; the first stands for one with a problem.
    pub(crate) fn choice<T: Copy>(&self, key: &'static str, choices: &[(&str, T)]) -> T {
        let words: Vec<String> = choices
            .iter()
            .map(|(word, _)| format!("{word:?}"))
            .collect();
        let allowed = words.join(" or ");
        let chosen = self.text(key, &allowed).and_then(|text| {
            let choice = choices.iter().find(|(word, _)| *word == text.value);
            if choice.is_none() {
                self.problem(key, format!("{:?} is not allowed", text.value), &allowed);
            }
            choice
        });
        chosen.unwrap_or(&choices[0]).1
    }

    pub(crate) fn choice_or<T: Copy + PartialEq>(
        &self,
        key: &'static str,
        default: T,
        choices: &[(&str, T)],
    ) -> T {
        if let Some((word, _)) = choices.iter().find(|(_, choice)| *choice == default) {
            self.default(key, word);
        }
        if self.has(key) {
            self.choice(key, choices)
        } else {
            default
        }
    }
}

fn show_range(allowed: &Range<u64>) -> String {
    format!("an integer from {} to {}", allowed.start, allowed.end - 1)
}
