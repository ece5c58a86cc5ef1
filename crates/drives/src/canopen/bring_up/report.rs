//! What a set-up has read and written, and why it ended.

use super::{Bound, Check, Object, Write, number};
use core::fmt;

/// An object that was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reading {
    /// The object.
    pub object: Object,
    /// What it is.
    pub meaning: &'static str,
    /// Its value, the first four bytes.
    pub value: u32,
}

/// An object that was written, or would be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// The object.
    pub object: Object,
    /// Purpose of the object.
    pub meaning: &'static str,
    /// Its value before, if it was read.
    pub old: Option<u32>,
    /// The value that is written.
    pub new: u32,
    /// The node lacks it.
    pub missing: bool,
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (object, meaning, new) = (self.object, self.meaning, self.new);
        match self.old {
            _ if self.missing => write!(f, "{object} {meaning}: the drive has no such object"),
            Some(old) if old == new => write!(f, "{object} {meaning}: stays {new:#x}"),
            Some(old) => write!(f, "{object} {meaning}: {old:#x} -> {new:#x}"),
            None => write!(f, "{object} {meaning}: {new:#x}"),
        }
    }
}

/// What a set-up has read and written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Done {
    /// Objects that were read, in order.
    pub readings: Vec<Reading>,
    /// Objects that were written, in order.
    pub changes: Vec<Change>,
    /// Limits of the node's own that are wider than what is asked, and values that it keeps, in words.
    pub remarks: Vec<String>,
}

impl Done {
    /// The value that was read of an object.
    #[must_use]
    pub fn reading(&self, object: Object) -> Option<u32> {
        let found = self
            .readings
            .iter()
            .find(|reading| reading.object == object);
        found.map(|reading| reading.value)
    }

    pub(super) fn note_reading(&mut self, check: &Check, value: u32) {
        self.readings.push(Reading {
            object: check.object,
            meaning: check.meaning,
            value,
        });
    }

    pub(super) fn note_remark(&mut self, bound: &Bound, what: String) {
        self.remarks.push(format!("{} {what}", bound.object));
    }

    pub(super) fn note_fixed(&mut self, write: &Write, value: u32) {
        let (object, meaning) = (write.object, write.meaning);
        let remark = format!("{object} {meaning}: stays {value}, which cannot be written");
        self.remarks.push(remark);
    }

    pub(super) fn note_change(&mut self, write: &Write, old: Option<u32>) {
        self.changes.push(Change {
            object: write.object,
            meaning: write.meaning,
            old,
            new: number(&write.value),
            missing: false,
        });
    }

    pub(super) fn note_missing(&mut self, write: &Write) {
        self.note_change(write, None);
        if let Some(change) = self.changes.last_mut() {
            change.missing = true;
        }
    }
}

/// Why a set-up ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trouble {
    /// Index of the bus.
    pub bus: u8,
    /// Node.
    pub node: u8,
    /// What it moves.
    pub name: String,
    /// The step.
    pub step: &'static str,
    /// The object it was about.
    pub object: Option<Object>,
    /// What happened.
    pub what: String,
    /// What to do.
    pub cure: String,
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (node {}): {}", self.name, self.node, self.step)?;
        if let Some(object) = self.object {
            write!(f, ", object {object}")?;
        }
        write!(f, ": {}; {}", self.what, self.cure)
    }
}
