//! Text on standard output, in columns where it is a table; text of files.

mod new_file;
mod pages;
mod text_table;

use std::io::{self, ErrorKind, Write};
use std::path::Path;

pub use new_file::{NewFile, sync_folder, write_file, write_files};
pub use pages::pages;
pub use text_table::TextTable;

/// The text of a file.
///
/// # Errors
/// The file cannot be read, or is no text ([`problem::text`]): with the line.
pub fn read_text(path: impl AsRef<Path>) -> io::Result<String> {
    problem::text(std::fs::read(path)?, "").map_err(|problem| {
        let message = format!("line {}: {}", problem.line, problem.reason);
        io::Error::new(ErrorKind::InvalidData, message)
    })
}

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
