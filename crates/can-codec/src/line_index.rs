//! Lines of a DBC file's messages and signals, which the parser does not keep.

/// A message's line and the lines of its signals, in the file's order.
pub(crate) struct MessageLines {
    /// The identifier as written, bit 31 included.
    pub(crate) id: u64,
    /// Line of `BO_`, from 1.
    pub(crate) line: usize,
    /// Line of each `SG_`, with the signal's name.
    pub(crate) signals: Vec<(String, usize)>,
}

impl MessageLines {
    /// The line of the signal with that index, or of its message.
    pub(crate) fn signal_line(&self, index: usize, name: &str) -> usize {
        match self.signals.get(index) {
            Some((signal, line)) if signal == name => *line,
            _ => self.line,
        }
    }
}

/// Finds `BO_` and `SG_` at the start of lines, outside of quoted text.
pub(crate) fn message_lines(text: &str) -> Vec<MessageLines> {
    let mut messages: Vec<MessageLines> = Vec::new();
    let mut quoted = false;
    for (i, line) in text.lines().enumerate() {
        if !quoted {
            let mut words = line.split([' ', '\t', ':']).filter(|word| !word.is_empty());
            match (words.next(), words.next()) {
                (Some("BO_"), Some(id)) => messages.push(MessageLines {
                    id: id.parse().unwrap_or(u64::MAX),
                    line: i + 1,
                    signals: Vec::new(),
                }),
                (Some("SG_"), Some(name)) => {
                    if let Some(message) = messages.last_mut() {
                        message.signals.push((name.to_owned(), i + 1));
                    }
                }
                _ => {}
            }
        }
        quoted ^= ends_inside_quotes(line, quoted);
    }
    messages
}

/// True if the line has an odd number of quotation marks that are not escaped.
fn ends_inside_quotes(line: &str, quoted: bool) -> bool {
    let mut inside = quoted;
    let mut escaped = false;
    for byte in line.bytes() {
        match byte {
            b'"' if !escaped => inside = !inside,
            _ => {}
        }
        escaped = inside && byte == b'\\' && !escaped;
    }
    inside != quoted
}

#[cfg(test)]
mod tests {
    use super::message_lines;

    #[test]
    fn finds_messages_outside_of_quoted_text() {
        let text = "CM_ \"first\nBO_ 1 NOT: 8 A\nlast \\\" quote\";\n\nBO_ 2 YES: 8 A\n SG_ x : 0|8@1+\n SG_ y: 8|8@1+";
        let found = message_lines(text);
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].id, found[0].line), (2, 5));
        assert_eq!(found[0].signal_line(0, "x"), 6);
        assert_eq!(found[0].signal_line(1, "y"), 7);
        assert_eq!(found[0].signal_line(2, "z"), 5);
    }
}
