//! Standard output.

use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;

/// Prints a command's result. Whoever has read enough of it, e.g. `head`, may leave.
pub(crate) fn finish(text: &str) -> ExitCode {
    let mut out = io::stdout().lock();
    let written = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    match written {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            eprintln!("cannot print: {e}");
            ExitCode::FAILURE
        }
        _ => ExitCode::SUCCESS,
    }
}
