//! Recorded runs: opened, read to their end, and their times as a user reads them.

use jiff::Timestamp;
use problem::Problem;
use recording::{CycleMessage, Ending, Header, ReadError, Run};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// A recorded run in a file.
pub(crate) type RunFile = Run<BufReader<File>>;

/// Opens a recorded run.
pub(crate) fn open(path: &Path) -> Result<RunFile, Problem> {
    let file = File::open(path).map_err(ReadError::Io);
    let run = file.and_then(|file| Run::open(BufReader::new(file)));
    run.map_err(|error| refusal(path, &error))
}

/// The refusal of a file that cannot be read as a run.
pub(crate) fn refusal(path: &Path, error: &ReadError) -> Problem {
    Problem::new(error.to_string(), "").at(path.display().to_string(), 0)
}

/// Reads all cycles; gives how the file ended.
pub(crate) fn read_all(
    path: &Path,
    run: &mut RunFile,
    mut take: impl FnMut(&Header, &CycleMessage) -> Result<(), Problem>,
) -> Result<Ending, Problem> {
    let mut message = CycleMessage::default();
    let header = run.header().clone();
    while run
        .next_cycle(&mut message)
        .map_err(|e| refusal(path, &e))?
    {
        take(&header, &message)?;
    }
    Ok(run.ending().cloned().unwrap_or(Ending::Complete))
}

/// What is said about a file that does not end as it should; empty if it does.
pub(crate) fn describe_ending(ending: &Ending) -> String {
    match ending {
        Ending::Complete => String::new(),
        Ending::Truncated => {
            "the file ends too early (a crash, a full disk): every whole cycle in it was read\n"
                .to_owned()
        }
        Ending::Damaged(why) => {
            format!("the file is damaged ({why}): the cycles before the damage were read\n")
        }
    }
}

/// An instant of a cycle as a date.
pub(crate) fn date(header: &Header, stamp_ns: u64) -> String {
    let unix_ns = stamp_ns.saturating_add_signed(header.start.unix_offset_ns);
    Timestamp::from_nanosecond(i128::from(unix_ns))
        .map_or_else(|_| "unknown date".to_owned(), |date| format!("{date:.3}"))
}

/// Time from one stamp to another, ms.
pub(crate) fn ms_between(from_ns: u64, to_ns: u64) -> f64 {
    (to_ns as f64 - from_ns as f64) * 1e-6
}
