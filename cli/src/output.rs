//! End of a command: its result or its problems are printed, and the exit code follows.

use crate::BAD_INPUT;
use problem::{Problem, Problems};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Prints a command's result.
pub(crate) fn finish(text: &str) -> ExitCode {
    match terminal::print(text) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::FAILURE
        }
    }
}

/// Prints a command's result, or every problem of its input.
pub(crate) fn finish_or_refuse(result: Result<String, impl Into<Problems>>) -> ExitCode {
    match result {
        Ok(text) => finish(&text),
        Err(problems) => {
            eprintln!("{}", problems.into());
            ExitCode::from(BAD_INPUT)
        }
    }
}

/// Refuses an output that is one of the inputs: it would be replaced by what is made from it.
///
/// # Errors
/// The file is the same, by whatever name.
pub(crate) fn apart(output: &Path, inputs: &[PathBuf]) -> Result<(), Problem> {
    let Ok(place) = output.canonicalize() else {
        return Ok(());
    };
    if (inputs.iter()).any(|input| input.canonicalize().is_ok_and(|input| input == place)) {
        let problem = Problem::new("is what is read, and would be replaced", "another name");
        Err(problem.at(output.display().to_string(), 0))
    } else {
        Ok(())
    }
}

/// The text of a file that an argument names.
///
/// # Errors
/// The file cannot be read, or is no text ([`problem::text`]).
pub(crate) fn read_input(path: &Path) -> Result<String, Problem> {
    let name = path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| {
        Problem::new(format!("cannot be read: {error}"), "a readable text file").at(&name, 0)
    })?;
    problem::text(bytes, &name)
}
