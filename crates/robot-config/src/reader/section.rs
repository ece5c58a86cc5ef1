//! One table of a TOML file: its keys, its tables, and problems with either.

use super::{Diagnostics, show, whole};
use core::cell::RefCell;
use core::fmt;
use problem::Problem;
use robot_state::JointKind;
use std::borrow::Cow;
use std::collections::BTreeSet;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// One table of the file.
pub(crate) struct Section<'n, 't> {
    diagnostics: &'n Diagnostics<'t>,
    table: &'n DeTable<'t>,
    place: usize,
    /// The table's path in the schema: `joint.gains`.
    path: String,
    /// Name among several such tables, as in ` (hip_yaw)`.
    pub(crate) which: String,
    /// Kind of the joint or of the drive's joints: keys are asked for with the units of a revolute joint,
    /// and are in the file with those of this kind.
    pub(crate) kind: JointKind,
    known: RefCell<BTreeSet<Cow<'static, str>>>,
}

/// Keys of a drive's tables that are of the motor side, where every joint's units are the same.
const MOTOR_SIDE: [&str; 3] = [
    "torque_constant_Nm_per_A",
    "K_wg0_Nm_per_rad",
    "C_wg_per_Nm",
];

impl<'n, 't> Section<'n, 't> {
    pub(crate) fn root(diagnostics: &'n Diagnostics<'t>, table: &'n DeTable<'t>) -> Self {
        Self::new(diagnostics, table, 0, String::new())
    }

    fn new(
        diagnostics: &'n Diagnostics<'t>,
        table: &'n DeTable<'t>,
        place: usize,
        path: String,
    ) -> Self {
        Self {
            diagnostics,
            table,
            place,
            path,
            which: String::new(),
            kind: JointKind::Revolute,
            known: RefCell::new(BTreeSet::new()),
        }
    }

    pub(crate) fn place(&self) -> usize {
        self.place
    }

    /// The same table once more.
    pub(crate) fn again(&self) -> Self {
        let same = Self::new(self.diagnostics, self.table, self.place, self.path.clone());
        Self {
            which: self.which.clone(),
            kind: self.kind,
            ..same
        }
    }

    /// The table with the units of that kind of joint.
    pub(crate) fn of_kind(self, kind: JointKind) -> Self {
        Self { kind, ..self }
    }

    /// The key as the file has it.
    fn key<'k>(&self, key: &'k str) -> Cow<'k, str> {
        if MOTOR_SIDE.contains(&key) {
            Cow::Borrowed(key)
        } else {
            self.kind.units(key)
        }
    }

    /// The key has that text.
    pub(crate) fn is(&self, key: &str, text: &str) -> bool {
        let value = self.table.get(&*self.key(key)).map(Spanned::get_ref);
        value.and_then(DeValue::as_str) == Some(text)
    }

    /// The key's path in the schema, with the name of the section it belongs to.
    pub(crate) fn path(&self, key: &str) -> String {
        if key.is_empty() {
            format!("{}{}", self.path, self.which)
        } else {
            self.in_table(&self.key(key))
        }
    }

    /// The path of a key that the file has.
    fn in_table(&self, key: &str) -> String {
        let dot = if self.path.is_empty() { "" } else { "." };
        format!("{}{dot}{key}{}", self.path, self.which)
    }

    /// Notes a problem with a key: at its value, or at the section if it is missing.
    pub(crate) fn problem(&self, key: &str, what: impl fmt::Display, allowed: impl fmt::Display) {
        let place = self
            .table
            .get(&*self.key(key))
            .map_or(self.place, |value| value.span().start);
        let colon = if key.is_empty() { "" } else { ":" };
        let reason = format!("{}{colon} {what}", self.path(key));
        self.diagnostics.at(place, reason, allowed.to_string());
    }

    /// Notes a problem of another file.
    pub(crate) fn note(&self, problem: Problem) {
        self.diagnostics.note(problem);
    }

    /// `file:line: key`, for a problem that shows only later.
    pub(crate) fn place_of(&self, key: &str) -> String {
        let value = self.table.get(&*self.key(key));
        let place = value.map_or(self.place, |value| value.span().start);
        let line = self.diagnostics.line(place);
        format!("{}:{line}: {}", self.diagnostics.file, self.path(key))
    }

    pub(super) fn find(&self, key: &'static str) -> Option<&'n Spanned<DeValue<'t>>> {
        let key = self.key(key);
        let value = self.table.get(&*key);
        if let Some(value) = value
            && !matches!(value.get_ref(), DeValue::Table(_))
        {
            let (text, place) = (whole(value.get_ref()), value.span().start);
            self.diagnostics.set(self.in_table(&key), text, Some(place));
        }
        self.known.borrow_mut().insert(key);
        value
    }

    /// The default of a key that the file may lack.
    pub(super) fn default(&self, key: &'static str, value: impl fmt::Debug) {
        if self.find(key).is_none() {
            let text = format!("{value:?}");
            self.diagnostics.set(self.path(key), text, None);
        }
    }

    pub(crate) fn has(&self, key: &'static str) -> bool {
        self.find(key).is_some()
    }

    pub(super) fn missing(&self, key: &'static str, allowed: impl fmt::Display) {
        self.problem(key, "the key is missing", allowed);
    }

    pub(super) fn wrong(
        &self,
        key: &str,
        value: &Spanned<DeValue<'t>>,
        allowed: &dyn fmt::Display,
    ) {
        let what = format!("{} is not allowed", show(value.get_ref()));
        let reason = format!("{}: {what}", self.path(key));
        self.diagnostics
            .at(value.span().start, reason, allowed.to_string());
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
                kind: self.kind,
                ..Section::new(
                    self.diagnostics,
                    table,
                    value.span().start,
                    self.schema_path(key),
                )
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

    /// A table `[key]` as a list of one, or the tables of a list `[[key]]`; none if the key is missing.
    pub(crate) fn one_or_list(&self, key: &'static str) -> Vec<Section<'n, 't>> {
        match self.find(key).map(Spanned::get_ref) {
            Some(DeValue::Array(_)) => self.list(key),
            _ => self.optional_section(key).into_iter().collect(),
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

    /// Notes every key that was never read.
    pub(crate) fn finish(self) {
        let known = self.known.borrow();
        let allowed = known
            .iter()
            .map(|key| &**key)
            .collect::<Vec<_>>()
            .join(", ");
        for found in self.table.keys() {
            let (key, place) = (&**found.get_ref(), found.span().start);
            if known.contains(key) {
                continue;
            }
            let path = format!("{}: ", self.in_table(key));
            let meant = self.key(key);
            // Only a prismatic joint's table translates keys.
            if meant != key && known.contains(&*meant) {
                let reason = format!("{path}the joint is prismatic, the key has other units");
                self.diagnostics.at(place, reason, meant);
            } else if self.kind == JointKind::Revolute
                && let Some(own) = known
                    .iter()
                    .find(|own| JointKind::Prismatic.units(own) == key)
            {
                let reason = format!("{path}the joint is revolute, the key has other units");
                self.diagnostics.at(place, reason, own.clone());
            } else {
                (self.diagnostics).at(place, format!("{path}unknown key"), allowed.clone());
            }
        }
    }
}
