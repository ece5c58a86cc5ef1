//! A DBC file's text, taken apart from its beginning to its end.

use problem::Problem;

/// Characters of a faulty line, and of what stands wrongly in it, that a message shows.
const MAX_SHOWN: usize = 60;

/// Keywords at which a statement may begin.
pub(super) const KEYWORDS: &[&str] = &[
    "VERSION",
    "NS_",
    "NS_DESC_",
    "BS_",
    "BU_",
    "BO_",
    "SG_",
    "CM_",
    "VAL_",
    "VAL_TABLE_",
    "BA_DEF_",
    "BA_DEF_DEF_",
    "BA_",
    "BA_DEF_REL_",
    "BA_DEF_DEF_REL_",
    "BA_REL_",
    "SIG_VALTYPE_",
    "SG_MUL_VAL_",
    "BO_TX_BU_",
    "SIG_GROUP_",
    "EV_",
    "EV_DATA_",
    "ENVVAR_DATA_",
    "SGTYPE_",
    "SGTYPE_VAL_",
    "SIG_TYPE_REF_",
    "BA_DEF_SGTYPE_",
    "BA_SGTYPE_",
    "CAT_DEF_",
    "CAT_",
    "FILTER",
];

/// A place in the text, at the beginning of what is not taken yet.
#[derive(Clone)]
pub(super) struct Scan<'a> {
    text: &'a str,
    at: usize,
    /// Line of `at`, from 1.
    line: usize,
    /// Line on which the part taken last ends.
    last_line: usize,
    /// Line on which a quoted text of several lines begins, if that was taken last.
    long_text: Option<usize>,
}

impl<'a> Scan<'a> {
    pub(super) fn new(text: &'a str) -> Self {
        let mut scan = Self {
            text,
            at: 0,
            line: 1,
            last_line: 1,
            long_text: None,
        };
        scan.pass_blanks();
        scan
    }

    fn rest(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or_default()
    }

    /// Line of what comes next.
    pub(super) fn line(&self) -> usize {
        self.line
    }

    /// The next part stands on another line than the one taken last, or the file ends.
    pub(super) fn at_new_line(&self) -> bool {
        self.line > self.last_line || self.rest().is_empty()
    }

    pub(super) fn at_end(&self) -> bool {
        self.rest().is_empty()
    }

    pub(super) fn peek(&self) -> Option<char> {
        self.rest().chars().next()
    }

    /// A keyword begins the line that comes next.
    pub(super) fn at_keyword(&self) -> bool {
        self.at_new_line() && KEYWORDS.contains(&self.peek_word())
    }

    pub(super) fn peek_word(&self) -> &'a str {
        run(self.rest(), |c| c.is_alphanumeric() || c == '_')
    }

    /// Takes `length` bytes, and the blanks and comments behind them.
    fn take(&mut self, length: usize) -> &'a str {
        let taken = self.rest().get(..length).unwrap_or_default();
        self.at += taken.len();
        let begin = self.line;
        self.line += taken.matches('\n').count();
        self.last_line = self.line;
        self.long_text = (self.line > begin).then_some(begin);
        self.pass_blanks();
        taken
    }

    /// Passes white space, the mark that ends files of DOS, and comments from `//` to the line's end.
    fn pass_blanks(&mut self) {
        let blank = |c: char| c.is_whitespace() || matches!(c, '\u{1A}' | '\u{FEFF}');
        loop {
            let mut length = run(self.rest(), blank).len();
            if length == 0 && self.rest().starts_with("//") {
                length = run(self.rest(), |c| c != '\n').len();
            }
            if length == 0 {
                return;
            }
            self.line += self.rest()[..length].matches('\n').count();
            self.at += length;
        }
    }

    /// Takes a sign if it comes next.
    pub(super) fn sign_if(&mut self, sign: char) -> bool {
        let found = self.peek() == Some(sign);
        if found {
            self.take(sign.len_utf8());
        }
        found
    }

    pub(super) fn sign(&mut self, sign: char) -> Result<(), Problem> {
        if self.sign_if(sign) {
            return Ok(());
        }
        Err(match (sign, self.peek()) {
            (')' | ']' | '|' | ',', Some(',')) => {
                self.unexpected(&format!("`{sign}` (decimals have points, not commas)"))
            }
            _ => self.unexpected(&format!("`{sign}`")),
        })
    }

    /// A word of letters, digits and underscores.
    pub(super) fn word(&mut self, meaning: &str) -> Result<&'a str, Problem> {
        match self.peek_word() {
            "" => Err(self.unexpected(meaning)),
            word => Ok(self.take(word.len())),
        }
    }

    /// A word of any characters but blanks and those that separate words.
    pub(super) fn pass_word(&mut self) -> bool {
        let word = run(self.rest(), |c| !c.is_whitespace() && !",;:\"".contains(c));
        if word.is_empty() {
            return false;
        }
        self.take(word.len());
        true
    }

    pub(super) fn whole(&mut self, meaning: &str) -> Result<u64, Problem> {
        match self.peek_word().parse() {
            Ok(number) => {
                self.take(self.peek_word().len());
                Ok(number)
            }
            Err(_) => Err(self.unexpected(&format!("{meaning}, a whole number from 0 on"))),
        }
    }

    pub(super) fn number(&mut self, meaning: &str) -> Result<f64, Problem> {
        let mut before = ' ';
        let written = run(self.rest(), |c| {
            let of_exponent = matches!(before, 'e' | 'E');
            let signed = matches!(c, '+' | '-') && (before == ' ' || of_exponent);
            before = c;
            signed || c.is_alphanumeric() || c == '.'
        });
        // Rust reads `inf` and `nan` too; a file that needs them has no such number.
        let digits = written.trim_start_matches(['+', '-', '.']);
        match written.parse() {
            Ok(number) if digits.starts_with(|c: char| c.is_ascii_digit()) => {
                self.take(written.len());
                Ok(number)
            }
            _ => Err(self.unexpected(&format!("{meaning}, a number"))),
        }
    }

    /// The text between quotation marks, as written.
    pub(super) fn quoted(&mut self, meaning: &str) -> Result<&'a str, Problem> {
        let rest = self.rest();
        let Some(inside) = rest.strip_prefix('"') else {
            return Err(self.unexpected(&format!("{meaning} in quotation marks")));
        };
        let mut marks = inside.match_indices('"').map(|(at, _)| at);
        let Some(end) = marks.find(|&at| closes(inside, at)) else {
            let reason = "a text begins here, and no quotation mark ends it";
            return Err(Problem::new(reason, "`\"` at the end of the text").at("", self.line));
        };
        self.take(end + 2);
        Ok(&inside[..end])
    }

    /// Passes the line.
    pub(super) fn pass_line(&mut self) {
        while !self.at_new_line() {
            let length = run(self.rest(), |c| !c.is_whitespace()).len();
            self.take(length);
        }
    }

    /// Passes a statement, which `;` ends, or a keyword on a line of its own if `open`.
    pub(super) fn pass_statement(&mut self, open: bool) -> Result<(), Problem> {
        while !self.sign_if(';') {
            if self.at_end() || self.at_keyword() {
                return if open {
                    Ok(())
                } else {
                    Err(self.unexpected("`;`"))
                };
            }
            match self.peek() {
                Some('"') => {
                    self.quoted("a text")?;
                    let goes_on = matches!(self.peek(), Some(';' | ',' | '-' | '0'..='9'));
                    let over = self.at_end() || self.at_keyword();
                    if self.long_text.is_some() && !goes_on && !over {
                        return Err(self.unexpected("`;`"));
                    }
                }
                Some(':' | ',') => {
                    self.take(1);
                }
                _ => {
                    self.pass_word();
                }
            }
        }
        Ok(())
    }

    /// The line's rest, as far as a message shows it.
    fn shown(&self) -> String {
        let rest = run(self.rest(), |c| c != '\n').trim_end();
        rest.chars().take(MAX_SHOWN).collect()
    }

    /// A refusal of what comes next, or of a line that ends too early.
    pub(super) fn unexpected(&self, expected: &str) -> Problem {
        if let Some(line) = self.long_text {
            let reason = format!(
                "the text that begins here ends on line {}, before `{}`",
                self.last_line,
                self.shown()
            );
            let allowed = format!("{expected} behind the text: is a quotation mark missing?");
            return Problem::new(reason, allowed).at("", line);
        }
        let last = self.last_line;
        let written = self.text.split('\n').nth(last - 1).unwrap_or_default();
        if self.at_end() || (self.line > last && !written.trim().is_empty()) {
            let end = if self.at_end() { "file" } else { "line" };
            let shown: String = written.trim().chars().take(MAX_SHOWN).collect();
            let reason = format!("not a DBC file: the {end} ends behind `{shown}`");
            return Problem::new(reason, expected).at("", last);
        }
        self.misplaced(expected)
    }

    /// A refusal of what comes next.
    pub(super) fn misplaced(&self, expected: &str) -> Problem {
        let found = self.shown();
        let begin = self.text[..self.at].rfind('\n').map_or(0, |at| at + 1);
        let column = 1 + self.text[begin..self.at].chars().count();
        let reason = format!("not a DBC file from column {column} on: `{found}`");
        Problem::new(reason, expected).at("", self.line)
    }
}

/// The beginning of a text, as far as its characters are of a kind.
fn run(text: &str, mut of_kind: impl FnMut(char) -> bool) -> &str {
    let end = text.find(|c| !of_kind(c)).unwrap_or(text.len());
    &text[..end]
}

/// The quotation mark at that place of `text` ends it. One behind a backslash is a part of it, except where the
/// statement ends there and another begins: programs write paths so that end with a backslash.
fn closes(text: &str, at: usize) -> bool {
    if !text[..at].ends_with('\\') {
        return true;
    }
    let Some(behind) = text[at + 1..].trim_start().strip_prefix(';') else {
        return false;
    };
    let next = behind.trim_start();
    let word = run(next, |c| c.is_alphanumeric() || c == '_');
    next.is_empty() || (behind.len() > next.len() && KEYWORDS.contains(&word))
}
