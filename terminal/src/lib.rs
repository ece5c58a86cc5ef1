//! Text on standard output, in columns where it is a table.

mod text_table;

use std::io::{self, ErrorKind, Write};

pub use text_table::TextTable;

/// Prints a text. A reader that closes the pipe early, as `head` does, is no error.
///
/// # Errors
/// The output cannot be written, for example because the disk is full.
pub fn print(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    match written {
        Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
        Err(e) => Err(io::Error::new(e.kind(), format!("cannot print: {e}"))),
        Ok(()) => Ok(()),
    }
}
