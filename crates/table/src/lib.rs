//! Tables of numbers in text files, whichever program wrote them: one rule for all commands.
//!
//! In: text with a header, read line by line in constant memory. Out: fields and numbers by column, each
//! refusal with its line. Read are the encodings of [`problem::text`]; the delimiters comma, semicolon,
//! tab, bar and spaces; decimal points and commas; names, stamps and numbers in quotes; a first line
//! `sep=;` as spreadsheets write it; comments with `#` or `%`, of which one may be the header; lines above
//! the header as instruments write them; a row of units below it.
#![deny(unsafe_code)]

mod lines;
mod split;
mod units;

pub use units::Unit;

use lines::Lines;
use problem::{Allowed, Problem};
use std::collections::VecDeque;
use std::io::BufRead;
use std::ops::Range;

/// A number as programs write it, also with the exponent of Fortran (`1D-3`) and the minus of typesetters.
fn number(text: &str) -> Option<f64> {
    text.parse().ok().or_else(|| {
        let plain = text.replace('\u{2212}', "-").replace(['D', 'd'], "e");
        let bare = plain.trim_start_matches('-');
        let digits = bare.starts_with(|letter: char| letter.is_ascii_digit() || letter == '.');
        plain.parse().ok().filter(|_| digits)
    })
}

/// Whether a field is a number, with a decimal point or comma.
fn is_number(field: &str) -> bool {
    number(&field.trim().replace(',', ".")).is_some()
}

/// Allowed fields in place of one that is no finite number.
fn instead_of(field: &str) -> String {
    let groups = field.matches([',', '.']).count() > 1;
    let digits = field
        .chars()
        .all(|letter| letter.is_ascii_digit() || "-+.,".contains(letter));
    if groups && digits {
        "a number with one decimal mark, none for thousands".to_owned()
    } else if field.contains(':') && field.contains(|letter: char| letter.is_ascii_digit()) {
        "a finite number: stamps are numbers of s, ms, us or ns, no dates or times of day"
            .to_owned()
    } else {
        Allowed::Finite.to_string()
    }
}

/// A line as a row of fields, for the search of the header.
struct Line {
    delimiter: char,
    /// Fields up to the last that is not empty.
    count: usize,
    /// One of them is a number.
    numbers: bool,
}

impl Line {
    /// A line that may be the header: without a delimiter it shows its own.
    fn new(text: &str, delimiter: Option<char>) -> Self {
        Self::with(text, delimiter.unwrap_or_else(|| split::delimiter(text)))
    }

    fn with(text: &str, delimiter: char) -> Self {
        let mut fields = Vec::new();
        split::fields(text, delimiter, &mut fields);
        let last = fields.iter().rposition(|field| !field.is_empty());
        Self {
            delimiter,
            count: last.map_or(0, |last| last + 1),
            numbers: fields.iter().any(|field| is_number(&text[field.clone()])),
        }
    }
}

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
    /// Lines that were read to find the header, with their numbers.
    ahead: VecDeque<(String, usize)>,
    /// The row of units below the header.
    units: Vec<String>,
    /// The file ends within a row, which is left out.
    cut: bool,
}

/// Lines above a header at most.
const MAX_ABOVE: usize = 40;
/// Rows below it that have to fit it.
const ROWS_BELOW: usize = 8;

/// `#` or `%`, as numpy, gnuplot and Octave write them.
fn is_comment(line: &str) -> bool {
    line.starts_with(['#', '%'])
}

impl<R: BufRead> Table<R> {
    /// Reads the header. `file` is what messages call the table; the header shows a `delimiter` not given.
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
            ahead: VecDeque::new(),
            units: Vec::new(),
            cut: false,
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
        table.find_units()?;
        Ok(table)
    }

    /// Reads on to the header: the first line that is no comment, or the last comment if such fields follow.
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
            let sep = text.trim_matches('"').strip_prefix("sep=");
            if let Some(named) = sep.and_then(|rest| rest.chars().next()) {
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
            let numbers = (fields.iter()).any(|field| is_number(&self.text[field.clone()]));
            if names.is_some() && names == values && numbers {
                let row = (std::mem::replace(&mut self.text, header), self.line);
                self.ahead.push_front(row);
                self.line = line;
            }
        }
        self.pass_over_lines_above(delimiter)?;
        self.delimiter = delimiter.unwrap_or_else(|| split::delimiter(&self.text));
        self.header = self.line;
        self.split()
    }

    /// Moves on to the first line that can be a header: instruments write names and values above their tables.
    fn pass_over_lines_above(&mut self, delimiter: Option<char>) -> Result<(), Problem> {
        let mut lines = vec![(self.text.clone(), self.line)];
        while lines.len() < MAX_ABOVE + ROWS_BELOW && self.next_line()? {
            lines.push((std::mem::take(&mut self.text), self.line));
        }
        let is_header = |k: usize| {
            let header = Line::new(&lines[k].0, delimiter);
            let below = lines.iter().skip(k + 1).map(|(text, _)| text.trim());
            let below = below.filter(|text| !text.is_empty() && !is_comment(text));
            let rows = below.map(|text| Line::with(text, header.delimiter));
            let rows: Vec<Line> = rows.take(ROWS_BELOW).collect();
            let numbers = rows.iter().position(|row| row.numbers);
            header.count > 1
                && !header.numbers
                && numbers.is_some_and(|row| row < 2)
                && rows.iter().all(|row| row.count <= header.count)
                && rows.iter().any(|row| row.count == header.count)
        };
        let mut headers = 0..lines.len().min(MAX_ABOVE);
        let header = headers.find(|&k| is_header(k)).unwrap_or(0);
        self.ahead.extend(lines.drain(header + 1..));
        if let Some((text, line)) = lines.pop() {
            (self.text, self.line) = (text, line);
        }
        Ok(())
    }

    /// Takes the first row for one of units where no field of it is a number.
    fn find_units(&mut self) -> Result<(), Problem> {
        if !self.next_line()? {
            return Ok(());
        }
        let mut fields = Vec::new();
        let complete = split::fields(&self.text, self.delimiter, &mut fields);
        let texts: Vec<&str> = (fields.iter())
            .map(|field| self.text[field.clone()].trim())
            .collect();
        let is_units = complete
            && !is_comment(self.text.trim())
            && texts.len() >= self.names.len()
            && texts.iter().any(|text| Unit::parse(text).is_some())
            && texts.iter().all(|text| units::is_unit(text));
        if is_units {
            self.units = texts.into_iter().map(str::to_owned).collect();
        } else {
            self.ahead
                .push_front((std::mem::take(&mut self.text), self.line));
        }
        self.line = self.header;
        Ok(())
    }

    /// The unit that the row below the header gives a column; none where there is no such row, or it is not known.
    #[must_use]
    pub fn unit(&self, column: usize) -> Option<Unit> {
        self.units.get(column).and_then(|text| Unit::parse(text))
    }

    /// Refuses a column that the row of units has in no SI unit.
    ///
    /// # Errors
    /// Such a unit.
    pub fn require_si(&self, column: usize) -> Result<(), Problem> {
        let Some(unit) = self.unit(column).filter(|unit| unit.factor != 1.0) else {
            return Ok(());
        };
        let reason = format!(
            "the row of units below the header gives `{}` in `{}`",
            self.name(column),
            self.units[column]
        );
        let allowed = format!("{}; `torquectl import` converts units", unit.si);
        Err(Problem::new(reason, allowed).at(self.file.as_str(), self.header + 1))
    }

    /// True if the file ends within its last row, which is left out.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.cut
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
        let named = |name: &str| -> Vec<usize> {
            let all = 0..self.names.len();
            all.filter(|&i| self.names[i] == name).collect()
        };
        let mut places = named(name);
        // The first name has lost the mark of a comment (`%time` of rostopic).
        let bare = name.trim_start_matches(['#', '%']).trim_start();
        if places.is_empty() && named(bare) == [0] {
            places = vec![0];
        }
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
    /// A row of other length than the header, too long a line, no known encoding, an unreadable file.
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
        if found < named && self.ahead.is_empty() && self.lines.at_end() {
            self.cut = true;
            return Ok(false);
        }
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
                Err(self.problem(reason, instead_of(&field)))
            }
        }
    }

    /// The number in a field of that row; none where it is empty or a word for that (`nan`, `null`, `NA`).
    ///
    /// # Errors
    /// Another field that is no finite number.
    pub fn optional(&mut self, column: usize) -> Result<Option<f64>, Problem> {
        const ABSENT: [&str; 16] = [
            "nan",
            "-nan",
            "+nan",
            "null",
            "none",
            "na",
            "n/a",
            "#n/a",
            "<na>",
            "missing",
            "nan(ind)",
            "-nan(ind)",
            "1.#qnan",
            "-1.#qnan",
            "-1.#ind",
            "1.#ind",
        ];
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
            (0, 0) => return Ok(number(field)),
            (0, 1) => '.',
            (1, 0) => ',',
            _ => return Ok(None),
        };
        let Some(number) = number(&field.replace(',', ".")) else {
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
            let so_far = std::mem::take(&mut self.text) + "\n";
            let ended = !self.next_line()?;
            if ended || so_far.len() + self.text.len() > lines::LONGEST {
                self.line = begins;
                let allowed = "quotation marks in pairs";
                return Err(self.problem("a quotation mark is not closed", allowed));
            }
            self.text.insert_str(0, &so_far);
        }
    }

    fn next_line(&mut self) -> Result<bool, Problem> {
        if let Some(line) = self.ahead.pop_front() {
            (self.text, self.line) = line;
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
