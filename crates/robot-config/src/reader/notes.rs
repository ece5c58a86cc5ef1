//! Problems of a file, and which numbers a key may have.

use can_codec::Problem;
use core::cell::RefCell;
use core::fmt;

/// The file and what is wrong with it so far.
pub(crate) struct Notes<'t> {
    pub(super) file: &'t str,
    text: &'t str,
    problems: RefCell<Vec<Problem>>,
}

impl<'t> Notes<'t> {
    pub(crate) fn new(file: &'t str, text: &'t str) -> Self {
        Self {
            file,
            text,
            problems: RefCell::new(Vec::new()),
        }
    }

    /// Notes a problem at a place of the file.
    pub(crate) fn at(&self, place: usize, reason: impl Into<String>, allowed: impl Into<String>) {
        self.note(Problem {
            file: self.file.to_owned(),
            line: self.line(place),
            reason: reason.into(),
            allowed: allowed.into(),
        });
    }

    pub(super) fn line(&self, place: usize) -> usize {
        let before = self.text.as_bytes().iter().take(place);
        1 + before.filter(|&&byte| byte == b'\n').count()
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

/// Numbers that a key may have.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Allowed {
    Finite,
    Positive,
    NonNegative,
    /// Both ends allowed.
    Within(f64, f64),
    /// The second end not allowed.
    Below(f64, f64),
}

impl Allowed {
    pub(super) fn admits(self, x: f64) -> bool {
        x.is_finite()
            && match self {
                Self::Finite => true,
                Self::Positive => x > 0.0,
                Self::NonNegative => x >= 0.0,
                Self::Within(min, max) => (min..=max).contains(&x),
                Self::Below(min, end) => (min..end).contains(&x),
            }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Finite => f.write_str("a finite number"),
            Self::Positive => f.write_str("a finite number > 0"),
            Self::NonNegative => f.write_str("a finite number >= 0"),
            Self::Within(min, max) => write!(f, "a number from {min} to {max}"),
            Self::Below(min, end) => write!(f, "a number from {min} to below {end}"),
        }
    }
}
