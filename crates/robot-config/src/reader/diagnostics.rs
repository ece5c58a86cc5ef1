//! The problems found so far.

use crate::settings::{Setting, Source};
use core::cell::RefCell;
use problem::{Problem, line_at};

/// The file and what is wrong with it so far.
pub(crate) struct Diagnostics<'t> {
    pub(super) file: &'t str,
    text: &'t str,
    problems: RefCell<Vec<Problem>>,
    settings: RefCell<Vec<Setting>>,
}

impl<'t> Diagnostics<'t> {
    pub(crate) fn new(file: &'t str, text: &'t str) -> Self {
        Self {
            file,
            text,
            problems: RefCell::new(Vec::new()),
            settings: RefCell::new(Vec::new()),
        }
    }

    /// Notes a problem at a place of the file.
    pub(crate) fn at(&self, place: usize, reason: impl Into<String>, allowed: impl Into<String>) {
        self.note_at(place, Problem::new(reason, allowed));
    }

    /// Notes a problem at a place of the file.
    pub(crate) fn note_at(&self, place: usize, problem: Problem) {
        self.note(problem.at(self.file, self.line(place)));
    }

    pub(super) fn line(&self, place: usize) -> usize {
        line_at(self.text, place)
    }

    /// Notes the value of a key, once; `place`: where the file has it, none for a default.
    pub(super) fn set(&self, key: String, value: String, place: Option<usize>) {
        let mut settings = self.settings.borrow_mut();
        if settings.iter().any(|setting| setting.key == key) {
            return;
        }
        let source = place.map_or(Source::Default, |place| Source::Line(self.line(place)));
        settings.push(Setting { key, value, source });
    }

    /// The keys that were asked for, by their path.
    pub(crate) fn take_settings(&self) -> Vec<Setting> {
        let mut settings = self.settings.take();
        settings.sort_by(|a, b| a.key.cmp(&b.key));
        settings
    }

    /// Notes a problem of another file.
    pub(crate) fn note(&self, problem: Problem) {
        self.problems.borrow_mut().push(problem);
    }

    pub(crate) fn any(&self) -> bool {
        !self.problems.borrow().is_empty()
    }

    /// All problems, by file and line, each once.
    pub(crate) fn into_problems(self) -> Vec<Problem> {
        let mut problems = self.problems.into_inner();
        problems.sort_by(|a, b| (&a.file, a.line, &a.reason).cmp(&(&b.file, b.line, &b.reason)));
        problems.dedup();
        problems
    }
}
