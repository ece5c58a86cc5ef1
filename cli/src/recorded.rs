//! Recorded runs: opened, read to their end, and their times as a user reads them.

use jiff::Timestamp;
use problem::Problem;
use recording::{CycleMessage, Ending, Header, ReadError, Replayed, Run};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::thread;

/// A recorded run in a file.
pub(crate) type RunFile = Run<BufReader<File>>;

/// Opens a recorded run; of a recording of frames the rest is computed while it is read.
pub(crate) fn open(path: &Path) -> Result<RunFile, Problem> {
    let mut run = open_as_it_is(path)?;
    run.restore().map_err(|problems| {
        let all = problems.to_string();
        let reason = format!("its cycles cannot be computed: {all}");
        Problem::new(reason, "").at(path.display().to_string(), 0)
    })?;
    Ok(run)
}

/// Opens a recorded run that holds what every cycle was given.
pub(crate) fn open_with_inputs(path: &Path) -> Result<RunFile, Problem> {
    let run = open(path)?;
    let demand = run.header().demand_inputs();
    demand.map_err(|problem| problem.at(path.display().to_string(), 0))?;
    Ok(run)
}

/// Opens a recorded run whose cycles are read as they stand there.
pub(crate) fn open_as_it_is(path: &Path) -> Result<RunFile, Problem> {
    let file = File::open(path).map_err(ReadError::Io);
    let run = file.and_then(|file| Run::open(BufReader::new(file)));
    run.map_err(|error| refusal(path, &error))
}

/// The refusal of a file that cannot be read as a run.
pub(crate) fn refusal(path: &Path, error: &ReadError) -> Problem {
    Problem::new(error.to_string(), "").at(path.display().to_string(), 0)
}

/// Cycles that are read ahead at a time.
const BATCH: usize = 64;

/// Reads all cycles, ahead on another thread; gives how the file ended.
pub(crate) fn read_all(
    path: &Path,
    run: &mut RunFile,
    mut take: impl FnMut(&Header, &CycleMessage) -> Result<(), Problem>,
) -> Result<Ending, Problem> {
    let header = run.header().clone();
    thread::scope(|threads| {
        let (filled, batches) = sync_channel(1);
        let (emptied, used) = channel();
        let reading = &mut *run;
        threads.spawn(move || read_ahead(reading, &filled, &used));
        // A refusal drops the channel, and that ends the reader.
        for batch in batches {
            let (messages, count): (Vec<CycleMessage>, usize) =
                batch.map_err(|error| refusal(path, &error))?;
            for message in messages.iter().take(count) {
                take(&header, message)?;
            }
            let _ = emptied.send(messages);
        }
        Ok::<_, Problem>(())
    })?;
    if let Some(remark) = run.restored().and_then(remark) {
        eprintln!("{}: {remark}", path.display());
    }
    Ok(run.ending().cloned().unwrap_or(Ending::Complete))
}

/// What is to be said of cycles that were computed from frames.
fn remark(restored: &Replayed) -> Option<String> {
    let Replayed {
        first_cycle,
        different,
        cycles,
        ..
    } = restored;
    match (first_cycle, different) {
        (_, 0) => None,
        (2.., _) => Some(format!(
            "begins with cycle {first_cycle}: what follows from its frames is computed without what filters \
             and fits knew by then"
        )),
        _ => Some(format!(
            "{different} of {cycles} cycles were not computed as in the loop; torquectl replay shows the first"
        )),
    }
}

/// Reads cycles into batches until the run ends, or nobody takes them; the memory of a batch that was
/// taken comes back.
fn read_ahead(
    run: &mut RunFile,
    filled: &SyncSender<Result<(Vec<CycleMessage>, usize), ReadError>>,
    used: &Receiver<Vec<CycleMessage>>,
) {
    loop {
        let mut messages = used
            .try_recv()
            .unwrap_or_else(|_| vec![CycleMessage::default(); BATCH]);
        let mut count = 0;
        let mut failure = None;
        for message in &mut messages {
            match run.next_cycle(message) {
                Ok(true) => count += 1,
                Ok(false) => break,
                Err(error) => {
                    failure = Some(error);
                    break;
                }
            }
        }
        let goes_on = count == messages.len();
        let taken = filled.send(Ok((messages, count))).is_ok();
        if let Some(error) = failure {
            let _ = filled.send(Err(error));
        }
        if !(goes_on && taken) {
            return;
        }
    }
}

/// Remark on a file that does not end as it should; empty if it does.
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
