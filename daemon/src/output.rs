//! Standard output.

use std::io::{self, ErrorKind, Write};

use crate::failure::Failure;

/// Prints a text. Whoever has read enough of it, e.g. `head`, may leave.
///
/// # Errors
/// The output cannot be written, a full disk say.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    match written {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::environment(format!("cannot print: {e}")))
        }
        _ => Ok(()),
    }
}
