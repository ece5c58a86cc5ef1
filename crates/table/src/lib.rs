//! Tables of numbers in text files, whichever program wrote them: one rule for all commands.
//!
//! In: text with a header, read line by line in constant memory. Out: fields and numbers by column, each
//! refusal with its line. Read are the encodings of [`problem::text`]; the delimiters comma, semicolon,
//! tab, bar and spaces; decimal points and commas; names, stamps and numbers in quotes; a first line
//! `sep=;` as spreadsheets write it; comments with `#` or `%`, of which one may be the header.
#![deny(unsafe_code)]

mod lines;
mod split;

use lines::Lines;
use problem::{Allowed, Problem};
use std::io::BufRead;
use std::ops::Range;

/// A table, read row by row.
pub struct Table<R> {
    lines: Lines<R>,
    file: String,
    delimiter: char,
    names: Vec<String>,
    /// Text of the row that was read last, and its fields in it.
    text: String,
    fields: Vec<Range<usize>>,
    /// Line on which that row begins.
    line: usize,
    /// `.` or `,`, from the first number that has one on.
    decimal: Option<char>,
    /// Line of the header.
    header: usize,
    /// The first row and its line, where the header was found by it.
    row: Option<(String, usize)>,
}

/// `#` or `%`, as numpy, gnuplot and Octave write them.
fn is_comment(line: &str) -> bool {
    line.starts_with(['#', '%'])
}

impl<R: BufRead> Table<R> {
    /// Reads the header. `file` is what messages call the table; without a `delimiter` the header shows
    /// it.
    ///
    /// # Errors
    /// No header, text of no known encoding, a file that cannot be read.
    pub fn new(input: R, file: &str, delimiter: Option<char>) -> Result<Self, Problem> {
        let mut table = Self {
            lines: Lines::new(input).map_err(|problem| problem.at(file, 0))?,
            file: file.to_owned(),
            delimiter: delimiter.unwrap_or(','),
            names: Vec::new(),
            text: String::new(),
            fields: Vec::new(),
            line: 1,
            decimal: None,
            header: 1,
            row: None,
        };
        table.find_header(delimiter)?;
        table.names = (table.fields.iter())
            .map(|field| table.text[field.clone()].trim().replace("\"\"", "\""))
            .collect();
        if let Some(first) = table.names.first_mut() {
            let bare = first.trim_start_matches(['#', '%']).trim_start();
            if bare.is_empty() && !first.is_empty() {
                table.names.remove(0);
            } else {
                *first = bare.to_owned();
            }
        }
        // A delimiter at the header's end makes no column.
        while table.names.last().is_some_and(String::is_empty) {
            table.names.pop();
        }
        Ok(table)
    }

    /// Reads on to the header: the first line that is no comment, or the last comment, where as many fields with
    /// numbers among them follow.
    fn find_header(&mut self, mut delimiter: Option<char>) -> Result<(), Problem> {
        let mut comment = None;
        loop {
            if !self.next_line()? {
                let Some(header) = comment.take() else {
                    return Err(
                        self.problem("the log is empty", "a header with the columns' names")
                    );
                };
                (self.text, self.line) = header;
                break;
            }
            let text = self.text.trim();
            if let Some(named) = text
                .strip_prefix("sep=")
                .and_then(|rest| rest.chars().next())
            {
                delimiter = delimiter.or(Some(named));
            } else if is_comment(text) {
                let bare = text.trim_start_matches(['#', '%']).trim_start();
                comment = (!bare.is_empty())
                    .then(|| (bare.to_owned(), self.line))
                    .or(comment);
            } else if !text.is_empty() {
                break;
            }
        }
        if let Some((header, line)) = comment {
            let own = delimiter.unwrap_or_else(|| split::delimiter(&header));
            let mut fields = Vec::new();
            let names = split::fields(&header, own, &mut fields).then_some(fields.len());
            fields.clear();
            let values = split::fields(&self.text, own, &mut fields).then_some(fields.len());
            let is_number = |field: &Range<usize>| {
                let field = self.text[field.clone()].replace(',', ".");
                field.parse::<f64>().is_ok()
            };
            if names.is_some() && names == values && fields.iter().any(is_number) {
                self.row = Some((std::mem::replace(&mut self.text, header), self.line));
                self.line = line;
            }
        }
        self.delimiter = delimiter.unwrap_or_else(|| split::delimiter(&self.text));
        self.header = self.line;
        self.split()
    }

    /// Names of the columns.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// The place of a column; none where there is no such column.
    ///
    /// # Errors
    /// Several columns have that name.
    pub fn column(&self, name: &str) -> Result<Option<usize>, Problem> {
        let places: Vec<usize> = (0..self.names.len())
            .filter(|&i| self.names[i] == name)
            .collect();
        match places[..] {
            [] => Ok(None),
            [place] => Ok(Some(place)),
            [first, second, ..] => {
                let reason = format!(
                    "column `{name}` is named twice, as the columns {} and {}",
                    first + 1,
                    second + 1
                );
                Err(Problem::new(reason, "each column once").at(self.file.as_str(), self.header))
            }
        }
    }

    /// Reads the next row; false at the end. Empty lines and comments are passed over.
    ///
    /// # Errors
    /// A row with fewer or more fields than the header, a line that is too long, text of no known
    /// encoding, a file that cannot be read.
    pub fn next_row(&mut self) -> Result<bool, Problem> {
        loop {
            if !self.next_line()? {
                return Ok(false);
            }
            let text = self.text.trim();
            if !text.is_empty() && !is_comment(text) {
                break;
            }
        }
        self.split()?;
        let (found, named) = (self.fields.len(), self.names.len());
        if found < named {
            let reason = format!(
                "the field of column `{}` is missing: the row has {found} fields, the header {named}",
                self.names[found]
            );
            return Err(self.problem(reason, "as many fields as the header has; empty ones count"));
        }
        if let Some(field) = (self.fields.iter().skip(named)).find(|field| !field.is_empty()) {
            let commas = self.delimiter == ',' && found.is_multiple_of(named);
            let why = if commas {
                " (decimal commas between commas?)"
            } else {
                ""
            };
            let reason = format!(
                "the row has {found} fields, the header {named}{why}: `{}` has no column",
                &self.text[field.clone()]
            );
            let allowed = "as many fields as the header has; numbers with decimal commas in quotes, or with another delimiter";
            return Err(self.problem(reason, allowed));
        }
        Ok(true)
    }

    /// Line on which the row that was read last begins, from 1.
    #[must_use]
    pub fn line(&self) -> usize {
        self.line
    }

    /// Text of a field of that row, without its quotes.
    #[must_use]
    pub fn field(&self, column: usize) -> &str {
        let field = self.fields.get(column).cloned();
        let text = field.and_then(|field| self.text.get(field));
        text.unwrap_or("").trim()
    }

    /// The number in a field of that row.
    ///
    /// # Errors
    /// A field that is empty or no finite number.
    pub fn number(&mut self, column: usize) -> Result<f64, Problem> {
        let field = self.field(column).to_owned();
        if field.is_empty() {
            let reason = format!("`{}` is empty", self.name(column));
            let allowed = "a finite number in each row; `torquectl import` joins topics that have rows of their own";
            return Err(self.problem(reason, allowed));
        }
        match self.parse(&field, column)? {
            Some(number) if number.is_finite() => Ok(number),
            _ => {
                let reason = format!("`{}` is `{field}`", self.name(column));
                Err(self.problem(reason, Allowed::Finite.to_string()))
            }
        }
    }

    /// The number in a field of that row; none where it is empty or says that there is none (`nan`,
    /// `null`, `NA`).
    ///
    /// # Errors
    /// Another field that is no finite number.
    pub fn optional(&mut self, column: usize) -> Result<Option<f64>, Problem> {
        const ABSENT: [&str; 7] = ["nan", "-nan", "+nan", "null", "none", "na", "n/a"];
        let field = self.field(column);
        if field.is_empty()
            || ABSENT
                .iter()
                .any(|absent| field.eq_ignore_ascii_case(absent))
        {
            return Ok(None);
        }
        self.number(column).map(Some)
    }

    /// A problem of the row that was read last.
    #[must_use]
    pub fn problem(&self, reason: impl Into<String>, allowed: impl Into<String>) -> Problem {
        Problem::new(reason, allowed).at(self.file.as_str(), self.line)
    }

    fn name(&self, column: usize) -> &str {
        self.names.get(column).map_or("", String::as_str)
    }

    /// None: no number. A comma is a decimal comma, in the whole file.
    fn parse(&mut self, field: &str, column: usize) -> Result<Option<f64>, Problem> {
        let (commas, points) = (field.matches(',').count(), field.matches('.').count());
        let mark = match (commas, points) {
            (0, 0) => return Ok(field.parse().ok()),
            (0, 1) => '.',
            (1, 0) => ',',
            _ => return Ok(None),
        };
        let text = if mark == ',' {
            field.replace(',', ".")
        } else {
            field.to_owned()
        };
        let Ok(number) = text.parse() else {
            return Ok(None);
        };
        if *self.decimal.get_or_insert(mark) != mark {
            let reason = format!(
                "`{}` is `{field}`, but numbers before it have decimal {}",
                self.name(column),
                if mark == ',' { "points" } else { "commas" }
            );
            return Err(self.problem(
                reason,
                "one decimal mark in the whole file, none for thousands",
            ));
        }
        Ok(Some(number))
    }

    /// Fields of `text`; a field in quotes may go on over lines.
    fn split(&mut self) -> Result<(), Problem> {
        let begins = self.line;
        loop {
            self.fields.clear();
            if split::fields(&self.text, self.delimiter, &mut self.fields) {
                self.line = begins;
                return Ok(());
            }
            let mut more = String::new();
            let allowed = "quotation marks in pairs";
            self.text.push('\n');
            let ended = !(self.lines.next(&mut more).map_err(|p| self.placed(p))?);
            if ended || self.text.len() + more.len() > lines::LONGEST {
                self.line = begins;
                return Err(self.problem("a quotation mark is not closed", allowed));
            }
            self.text.push_str(&more);
        }
    }

    fn next_line(&mut self) -> Result<bool, Problem> {
        if let Some(row) = self.row.take() {
            (self.text, self.line) = row;
            return Ok(true);
        }
        self.text.clear();
        let mut text = std::mem::take(&mut self.text);
        let read = self.lines.next(&mut text).map_err(|p| self.placed(p));
        self.text = text;
        self.line = self.lines.count();
        read
    }

    /// A problem of the lines, at its line.
    fn placed(&self, problem: Problem) -> Problem {
        problem.at(self.file.as_str(), self.lines.count())
    }
}
