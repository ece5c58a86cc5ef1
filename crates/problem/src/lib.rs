//! Refusals of inputs: what is wrong, in which file and line, and what is allowed instead.
//!
//! Every refusal of a file, a request or a parameter is a [`Problem`], or [`Problems`] where all
//! of them are reported at once. A layer that knows the file or the line adds it to the problem
//! that it passes on ([`Problem::or_at`]); no layer parses another's printed text.
#![deny(unsafe_code)]

mod encoding;
mod range;

use core::fmt;

pub use encoding::{ENCODINGS, text};
pub use range::Allowed;

/// One thing that is wrong, and what is allowed instead.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Problem {
    /// The file's name as it was given; empty where there is none.
    pub file: String,
    /// Line in the file, from 1; 0 if the problem has no place.
    pub line: usize,
    /// The fault of the input.
    pub reason: String,
    /// The allowed alternatives; empty where `reason` implies them.
    pub allowed: String,
}

impl Problem {
    /// A problem without a place.
    #[must_use]
    pub fn new(reason: impl Into<String>, allowed: impl Into<String>) -> Self {
        Self {
            file: String::new(),
            line: 0,
            reason: reason.into(),
            allowed: allowed.into(),
        }
    }

    /// A file that cannot be read.
    #[must_use]
    pub fn unreadable(file: impl fmt::Display, error: &impl fmt::Display) -> Self {
        Self::new(format!("cannot be read: {error}"), "a readable file").at(file.to_string(), 0)
    }

    /// A file that cannot be written.
    #[must_use]
    pub fn unwritable(file: impl fmt::Display, error: &impl fmt::Display) -> Self {
        let allowed = "a writable path with room";
        Self::new(format!("cannot be written: {error}"), allowed).at(file.to_string(), 0)
    }

    /// The same problem at a place; line 0 means the whole file.
    #[must_use]
    pub fn at(mut self, file: impl Into<String>, line: usize) -> Self {
        self.file = file.into();
        self.line = line;
        self
    }

    /// The same problem, at this place unless it has one already.
    #[must_use]
    pub fn or_at(self, file: &str, line: usize) -> Self {
        if self.file.is_empty() {
            self.at(file, line)
        } else {
            self
        }
    }

    /// The same problem of a named part: `part: reason`.
    #[must_use]
    pub fn of(mut self, part: impl fmt::Display) -> Self {
        self.reason = format!("{part}: {}", self.reason);
        self
    }
}

/// `file:line: reason; allowed: allowed`, without the parts that are empty.
impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.file.is_empty() {
            f.write_str(&self.file)?;
            if self.line > 0 {
                write!(f, ":{}", self.line)?;
            }
            f.write_str(": ")?;
        }
        f.write_str(&self.reason)?;
        if !self.allowed.is_empty() {
            write!(f, "; allowed: {}", self.allowed)?;
        }
        Ok(())
    }
}

impl core::error::Error for Problem {}

/// Everything that is wrong with an input, at least one problem.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Problems(pub Vec<Problem>);

/// One problem a line.
impl fmt::Display for Problems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.0.iter().enumerate() {
            let separator = if i == 0 { "" } else { "\n" };
            write!(f, "{separator}{problem}")?;
        }
        Ok(())
    }
}

impl core::error::Error for Problems {}

impl From<Problem> for Problems {
    fn from(problem: Problem) -> Self {
        Self(vec![problem])
    }
}

/// Names to choose from, for [`Problem::allowed`]; of many names the first ones and the number of
/// the others.
#[must_use]
pub fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 60;
    let names: Vec<&str> = names.into_iter().collect();
    let shown = names[..names.len().min(SHOWN)].join(", ");
    match names.len() {
        0 => "none: there are no names to choose from".to_owned(),
        n if n > SHOWN => format!("{shown} and {} more", n - SHOWN),
        _ => shown,
    }
}

/// The line of a text, from 1, in which the byte at `place` stands.
#[must_use]
pub fn line_at(text: &str, place: usize) -> usize {
    line_in(text.as_bytes(), place)
}

fn line_in(bytes: &[u8], place: usize) -> usize {
    let before = bytes.iter().take(place);
    1 + before.filter(|&&byte| byte == b'\n').count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prints_the_parts_that_there_are() {
        let bare = Problem::new("rate is -1", "a finite number > 0");
        assert_eq!(bare.to_string(), "rate is -1; allowed: a finite number > 0");
        let placed = bare.clone().of("[loop]").or_at("a.toml", 3);
        let text = "a.toml:3: [loop]: rate is -1; allowed: a finite number > 0";
        assert_eq!(placed.to_string(), text);
        let again = placed.clone().or_at("b.toml", 9);
        assert_eq!(again, placed, "a place once known stays");
        let whole_file = Problem::new("cannot be read", "").at("a.toml", 0);
        assert_eq!(whole_file.to_string(), "a.toml: cannot be read");
        let both = Problems(vec![bare, whole_file]);
        assert_eq!(both.to_string().lines().count(), 2);
    }

    #[test]
    fn long_lists_of_names_are_shortened() {
        assert_eq!(listed(["a", "b"]), "a, b");
        let shortened = listed(core::iter::repeat_n("x", 70));
        assert!(shortened.ends_with("x, x and 10 more"), "{shortened}");
        assert!(listed([]).starts_with("none"));
    }

    #[test]
    fn lines_count_from_one() {
        let text = "a\nbc\n";
        let lines: Vec<usize> = (0..7).map(|place| line_at(text, place)).collect();
        assert_eq!(lines, [1, 1, 2, 2, 2, 3, 3]);
    }
}
