//! A TOML file read key by key: every problem is noted with its line, none ends the reading.

mod matrix;
mod notes;

pub(crate) use notes::Notes;
pub(crate) use problem::Allowed;

use core::cell::RefCell;
use core::fmt;
use core::ops::Range;
use std::collections::BTreeSet;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A value and where it stands.
pub(crate) struct At<T> {
    pub(crate) value: T,
    pub(crate) place: usize,
}

/// One table of the file.
pub(crate) struct Section<'n, 't> {
    notes: &'n Notes<'t>,
    table: &'n DeTable<'t>,
    place: usize,
    /// The table's path in the schema: `joint.gains`.
    path: String,
    /// Which of several such tables: ` (hip_yaw)`.
    pub(crate) which: String,
    known: RefCell<BTreeSet<&'static str>>,
}

impl<'n, 't> Section<'n, 't> {
    pub(crate) fn root(notes: &'n Notes<'t>, table: &'n DeTable<'t>) -> Self {
        Self::new(notes, table, 0, String::new())
    }

    fn new(notes: &'n Notes<'t>, table: &'n DeTable<'t>, place: usize, path: String) -> Self {
        Self {
            notes,
            table,
            place,
            path,
            which: String::new(),
            known: RefCell::new(BTreeSet::new()),
        }
    }

    pub(crate) fn place(&self) -> usize {
        self.place
    }

    /// The same table once more.
    pub(crate) fn again(&self) -> Self {
        let which = self.which.clone();
        let same = Self::new(self.notes, self.table, self.place, self.path.clone());
        Self { which, ..same }
    }

    /// The key has that text.
    pub(crate) fn is(&self, key: &str, text: &str) -> bool {
        let value = self.table.get(key).map(Spanned::get_ref);
        value.and_then(DeValue::as_str) == Some(text)
    }

    /// The key's path in the schema, with the name of the section it belongs to.
    pub(crate) fn path(&self, key: &str) -> String {
        let dot = if self.path.is_empty() || key.is_empty() {
            ""
        } else {
            "."
        };
        format!("{}{dot}{key}{}", self.path, self.which)
    }

    /// Notes a problem with a key: at its value, or at the section if it is missing.
    pub(crate) fn problem(&self, key: &str, what: impl fmt::Display, allowed: impl fmt::Display) {
        let place = self
            .table
            .get(key)
            .map_or(self.place, |value| value.span().start);
        let colon = if key.is_empty() { "" } else { ":" };
        let reason = format!("{}{colon} {what}", self.path(key));
        self.notes.at(place, reason, allowed.to_string());
    }

    /// `file:line: key`, for a problem that shows only later.
    pub(crate) fn place_of(&self, key: &str) -> String {
        let value = self.table.get(key);
        let place = value.map_or(self.place, |value| value.span().start);
        let line = self.notes.line(place);
        format!("{}:{line}: {}", self.notes.file, self.path(key))
    }

    fn find(&self, key: &'static str) -> Option<&'n Spanned<DeValue<'t>>> {
        self.known.borrow_mut().insert(key);
        self.table.get(key)
    }

    pub(crate) fn has(&self, key: &'static str) -> bool {
        self.find(key).is_some()
    }

    fn missing(&self, key: &'static str, allowed: impl fmt::Display) {
        self.problem(key, "the key is missing", allowed);
    }

    /// A number; NaN stands for one that was noted as wrong.
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
        self.find(key)
            .map_or(default, |value| self.as_number(key, value, allowed))
    }

    pub(crate) fn optional_number(&self, key: &'static str, allowed: Allowed) -> Option<f64> {
        self.find(key)
            .map(|value| self.as_number(key, value, allowed))
    }

    fn as_number(&self, key: &str, value: &Spanned<DeValue<'t>>, allowed: Allowed) -> f64 {
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

    fn wrong(&self, key: &str, value: &Spanned<DeValue<'t>>, allowed: &dyn fmt::Display) {
        let what = format!("{} is not allowed", show(value.get_ref()));
        let reason = format!("{}: {what}", self.path(key));
        self.notes
            .at(value.span().start, reason, allowed.to_string());
    }

    /// An integer; `min` stands for one that was noted as wrong.
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

    /// A text that is not empty; nothing stands for one that was noted as wrong.
    pub(crate) fn text(&self, key: &'static str, allowed: &str) -> Option<At<&'n str>> {
        let text = self.optional_text(key, allowed);
        if text.is_none() && !self.table.contains_key(key) {
            self.missing(key, allowed);
        }
        text
    }

    pub(crate) fn optional_text(&self, key: &'static str, allowed: &str) -> Option<At<&'n str>> {
        let value = self.find(key)?;
        self.as_text(key, value, allowed)
    }

    fn as_text(
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

    /// One of several words; the first stands for one that was noted as wrong.
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

    pub(crate) fn choice_or<T: Copy>(
        &self,
        key: &'static str,
        default: T,
        choices: &[(&str, T)],
    ) -> T {
        if self.has(key) {
            self.choice(key, choices)
        } else {
            default
        }
    }

    /// A text, or a list of texts; none if the key is missing.
    pub(crate) fn optional_texts(&self, key: &'static str, allowed: &str) -> Vec<At<&'n str>> {
        match self.find(key).map(Spanned::get_ref) {
            None => Vec::new(),
            Some(DeValue::Array(items)) if items.is_empty() => Vec::new(),
            Some(_) => self.texts(key, allowed),
        }
    }

    /// A text, or a list of texts.
    pub(crate) fn texts(&self, key: &'static str, allowed: &str) -> Vec<At<&'n str>> {
        match self.find(key) {
            None => {
                self.missing(key, allowed);
                Vec::new()
            }
            Some(value) => match value.get_ref() {
                DeValue::Array(items) if !items.is_empty() => items
                    .iter()
                    .filter_map(|item| self.as_text(key, item, allowed))
                    .collect(),
                _ => self.as_text(key, value, allowed).into_iter().collect(),
            },
        }
    }

    /// `N` texts, or nothing if they were noted as wrong.
    pub(crate) fn text_array<const N: usize>(
        &self,
        key: &'static str,
        allowed: &str,
    ) -> Option<[At<&'n str>; N]> {
        let texts = self.items(key, N, allowed)?;
        let texts: Vec<_> = texts
            .iter()
            .filter_map(|item| self.as_text(key, item, allowed))
            .collect();
        texts.try_into().ok()
    }

    /// `N` numbers; NaN stands for those that were noted as wrong.
    pub(crate) fn number_array_or<const N: usize>(
        &self,
        key: &'static str,
        default: [f64; N],
        allowed: Allowed,
    ) -> [f64; N] {
        if !self.has(key) {
            return default;
        }
        let mut numbers = [f64::NAN; N];
        if let Some(items) = self.items(key, N, &format!("{N} numbers, each {allowed}")) {
            for (number, item) in numbers.iter_mut().zip(items) {
                *number = self.as_number(key, item, allowed);
            }
        }
        numbers
    }

    /// Pairs of finite numbers; none if the key is missing.
    pub(crate) fn pairs(&self, key: &'static str) -> Vec<(f64, f64)> {
        const ALLOWED: &str = "a list of pairs of finite numbers, as [[0.1, -0.2], [0.0, 0.3]]";
        let Some(value) = self.find(key) else {
            return Vec::new();
        };
        let Some(items) = value.get_ref().as_array() else {
            self.wrong(key, value, &ALLOWED);
            return Vec::new();
        };
        let pair = |item: &'n Spanned<DeValue<'t>>| match item.get_ref().as_array() {
            Some(pair) if pair.len() == 2 => {
                let [a, b] = [0, 1].map(|i| self.as_number(key, &pair[i], Allowed::Finite));
                (a, b)
            }
            _ => {
                self.wrong(key, item, &ALLOWED);
                (f64::NAN, f64::NAN)
            }
        };
        items.iter().map(pair).collect()
    }

    fn items(
        &self,
        key: &'static str,
        count: usize,
        allowed: &str,
    ) -> Option<&'n [Spanned<DeValue<'t>>]> {
        let Some(value) = self.find(key) else {
            self.missing(key, allowed);
            return None;
        };
        match value.get_ref() {
            DeValue::Array(items) if items.len() == count => Some(items),
            DeValue::Array(items) => {
                let what = format!("{} values are not allowed", items.len());
                self.problem(key, what, allowed);
                None
            }
            _ => {
                self.wrong(key, value, &allowed);
                None
            }
        }
    }

    /// A table inside this one.
    pub(crate) fn section(&self, key: &'static str) -> Option<Section<'n, 't>> {
        let section = self.optional_section(key);
        if section.is_none() && !self.table.contains_key(key) {
            self.missing(key, format!("a table [{}]", self.schema_path(key)));
        }
        section
    }

    pub(crate) fn optional_section(&self, key: &'static str) -> Option<Section<'n, 't>> {
        let value = self.find(key)?;
        self.as_section(key, value)
    }

    fn as_section(&self, key: &str, value: &'n Spanned<DeValue<'t>>) -> Option<Section<'n, 't>> {
        match value.get_ref() {
            DeValue::Table(table) => Some(Section {
                which: self.which.clone(),
                ..Section::new(self.notes, table, value.span().start, self.schema_path(key))
            }),
            _ => {
                self.wrong(key, value, &"a table");
                None
            }
        }
    }

    fn schema_path(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    /// The tables of a list `[[key]]`; none if the key is missing.
    pub(crate) fn list(&self, key: &'static str) -> Vec<Section<'n, 't>> {
        let Some(value) = self.find(key) else {
            return Vec::new();
        };
        match value.get_ref() {
            DeValue::Array(items) => items
                .iter()
                .filter_map(|item| self.as_section(key, item))
                .collect(),
            _ => {
                self.wrong(
                    key,
                    value,
                    &format!("a list of tables [[{}]]", self.schema_path(key)),
                );
                Vec::new()
            }
        }
    }

    /// The tables inside this one, whatever they are called.
    pub(crate) fn named_sections(&self) -> Vec<(&'n str, Section<'n, 't>)> {
        self.table
            .iter()
            .filter_map(|(name, value)| {
                let mut section = self.as_section(name.get_ref(), value)?;
                section.path.clone_from(&self.path);
                section.which = format!(" ({})", name.get_ref());
                Some((&**name.get_ref(), section))
            })
            .collect()
    }

    /// Notes every key that nobody asked for.
    pub(crate) fn finish(self) {
        let known = self.known.borrow();
        let allowed = known.iter().copied().collect::<Vec<_>>().join(", ");
        for key in self.table.keys() {
            if !known.contains(&**key.get_ref()) {
                let reason = format!("{}: unknown key", self.path(key.get_ref()));
                self.notes.at(key.span().start, reason, allowed.clone());
            }
        }
    }
}

fn show_range(allowed: &Range<u64>) -> String {
    format!("an integer from {} to {}", allowed.start, allowed.end - 1)
}

fn show(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Float(text) => match text.as_str().trim_start_matches(['+', '-']) {
            "nan" => "NaN".to_owned(),
            _ => text.as_str().to_owned(),
        },
        DeValue::Integer(text) => text.as_str().to_owned(),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::String(text) => format!("{text:?}"),
        DeValue::Datetime(date) => date.to_string(),
        DeValue::Array(_) => "a list".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}
