//! What is found: a sentence, why it matters, the command that mends it.

use super::machine::Root;
use serde_json::{Value, json};
use std::fmt::Write;
use std::fs;

/// How much a finding matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Level {
    /// The robot does not start, or stops.
    Error,
    /// Cycles will be late, or something will be missed.
    Warning,
}

impl Level {
    fn word(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
        }
    }
}

/// A change that harms nothing and that a reboot undoes.
#[derive(Clone, Debug)]
pub(super) enum Fix {
    /// Texts that the kernel takes, by file.
    Write(Vec<(String, String)>),
    /// Files of which no process knows.
    Remove(Vec<String>),
}

/// A defect of the machine.
#[derive(Clone, Debug)]
pub(super) struct Finding {
    /// Its name for programs.
    pub(super) id: &'static str,
    pub(super) level: Level,
    pub(super) what: String,
    pub(super) why: &'static str,
    /// A command, or what is to be done.
    pub(super) mend: String,
    pub(super) fix: Option<Fix>,
}

/// All that is found, and what could not be looked at.
#[derive(Default)]
pub(super) struct Findings {
    pub(super) found: Vec<Finding>,
    pub(super) not_seen: Vec<String>,
}

impl Findings {
    pub(super) fn error(
        &mut self,
        id: &'static str,
        what: impl Into<String>,
        why: &'static str,
        mend: impl Into<String>,
    ) {
        self.push(id, Level::Error, what.into(), why, mend.into());
    }

    pub(super) fn warning(
        &mut self,
        id: &'static str,
        what: impl Into<String>,
        why: &'static str,
        mend: impl Into<String>,
    ) {
        self.push(id, Level::Warning, what.into(), why, mend.into());
    }

    /// An error where the robot does not start without, else a warning.
    pub(super) fn by(
        &mut self,
        required: bool,
        id: &'static str,
        what: impl Into<String>,
        why: &'static str,
        mend: impl Into<String>,
    ) {
        let level = if required {
            Level::Error
        } else {
            Level::Warning
        };
        self.push(id, level, what.into(), why, mend.into());
    }

    fn push(
        &mut self,
        id: &'static str,
        level: Level,
        what: String,
        why: &'static str,
        mend: String,
    ) {
        self.found.push(Finding {
            id,
            level,
            what,
            why,
            mend,
            fix: None,
        });
    }

    /// What `--fix` does about the last finding. Texts are its command too.
    pub(super) fn fixed_by(&mut self, fix: Fix) {
        if let Some(last) = self.found.last_mut() {
            last.fix = Some(fix);
        }
    }

    /// A finding that `--fix` mends by texts for the kernel.
    pub(super) fn writable(
        &mut self,
        id: &'static str,
        what: impl Into<String>,
        why: &'static str,
        texts: Vec<(String, String)>,
    ) {
        let commands: Vec<_> = texts
            .iter()
            .map(|(path, text)| format!("echo {text} > {path}"))
            .collect();
        self.warning(id, what, why, commands.join("; "));
        self.fixed_by(Fix::Write(texts));
    }

    pub(super) fn not_seen(&mut self, what: impl Into<String>) {
        self.not_seen.push(what.into());
    }

    /// Makes every change that is harmless; in words, what was done and what failed.
    pub(super) fn fix(&self, root: &Root) -> Vec<String> {
        let fixes = self
            .found
            .iter()
            .filter_map(|finding| Some((finding, finding.fix.as_ref()?)));
        fixes
            .flat_map(|(finding, fix)| fix.apply(finding.id, root))
            .collect()
    }

    pub(super) fn json(&self, done: &[String]) -> Value {
        let found = self.found.iter().map(|finding| {
            json!({
                "id": finding.id,
                "level": finding.level.word(),
                "what": finding.what,
                "why": finding.why,
                "mend": finding.mend,
                "fixable": finding.fix.is_some(),
            })
        });
        json!({ "findings": found.collect::<Vec<_>>(), "not_seen": self.not_seen, "fixed": done })
    }

    pub(super) fn text(&self, done: &[String]) -> String {
        let mut page = String::new();
        for line in done {
            let _ = writeln!(page, "{line}");
        }
        for finding in &self.found {
            let Finding {
                id,
                level,
                what,
                why,
                mend,
                fix,
            } = finding;
            let fixable = if fix.is_some() {
                "  (--fix does it until the next boot)"
            } else {
                ""
            };
            let level = level.word();
            let _ = writeln!(
                page,
                "{level} {id}: {what}\n  why:  {why}\n  mend: {mend}{fixable}"
            );
        }
        for what in &self.not_seen {
            let _ = writeln!(page, "not seen: {what}");
        }
        let errors = self
            .found
            .iter()
            .filter(|finding| finding.level == Level::Error)
            .count();
        let _ = match self.found.len() {
            0 => writeln!(page, "nothing found"),
            all => writeln!(page, "{errors} errors, {} warnings", all - errors),
        };
        page
    }
}

impl Fix {
    fn apply(&self, id: &str, root: &Root) -> Vec<String> {
        let said = |what: String, done: std::io::Result<()>| match done {
            Ok(()) => format!("fixed {id}: {what}"),
            Err(error) => format!("not fixed {id}: {what}: {error}"),
        };
        match self {
            Self::Write(texts) => texts
                .iter()
                .map(|(path, text)| {
                    said(format!("{text} > {path}"), fs::write(root.path(path), text))
                })
                .collect(),
            Self::Remove(paths) => paths
                .iter()
                .map(|path| said(format!("removed {path}"), fs::remove_file(root.path(path))))
                .collect(),
        }
    }
}
