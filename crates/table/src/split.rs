//! Fields of a row, and what separates them.

use std::ops::Range;

/// What separates the fields of a header: of equal counts the first. Spaces only without any of them.
pub(crate) fn delimiter(header: &str) -> char {
    let mut counts = [(',', 0), (';', 0), ('\t', 0), ('|', 0)];
    let (mut quoted, mut most) = (false, (' ', 0));
    for letter in header.chars() {
        quoted ^= letter == '"';
        if let Some((_, count)) = counts.iter_mut().find(|(d, _)| *d == letter && !quoted) {
            *count += 1;
        }
    }
    for (delimiter, count) in counts {
        if count > most.1 {
            most = (delimiter, count);
        }
    }
    match most {
        (_, 0) if !header.trim().contains(' ') => ',',
        (delimiter, _) => delimiter,
    }
}

/// The places of the fields in `text`, trimmed and without their quotes; false where a quotation
/// mark is not closed. Several spaces separate as one.
pub(crate) fn fields(text: &str, delimiter: char, fields: &mut Vec<Range<usize>>) -> bool {
    let spaces = delimiter == ' ';
    let is_blank = |letter: char| letter.is_whitespace() && letter != delimiter;
    let mut at = 0;
    loop {
        let rest = &text[at..];
        let blank = |letter: char| is_blank(letter) || (spaces && letter == ' ');
        at += rest.len() - rest.trim_start_matches(blank).len();
        if spaces && at == text.len() && !fields.is_empty() {
            return true;
        }
        let end = if text[at..].starts_with('"') {
            let Some(close) = closing(text, at + 1) else {
                return false;
            };
            fields.push(at + 1..close);
            let after = &text[close + 1..];
            close + 1 + after.find(delimiter).unwrap_or(after.len())
        } else {
            let rest = &text[at..];
            let length = rest.find(delimiter).unwrap_or(rest.len());
            fields.push(at..at + rest[..length].trim_end().len());
            at + length
        };
        if end >= text.len() {
            return true;
        }
        at = end + delimiter.len_utf8();
    }
}

/// The place of the quotation mark that closes a field; a double one stands for one in it.
fn closing(text: &str, from: usize) -> Option<usize> {
    let mut at = from;
    loop {
        at += text[at..].find('"')?;
        if !text[at + 1..].starts_with('"') {
            return Some(at);
        }
        at += 2;
    }
}
