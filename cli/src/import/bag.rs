//! Recordings of rosbag2 in SQLite (`.db3`).

use problem::Problem;
use recording::{SignalCollector, Signals};
use rusqlite::{Connection, OpenFlags};
use std::path::Path;

/// What stands in a file that can be read.
const ALLOWED: &str = "a recording of rosbag2: tables `topics` and `messages`";

/// Reads the signals of a recording, message by message.
///
/// # Errors
/// A file that is no such recording, or is damaged.
pub(super) fn read(path: &Path) -> Result<Signals, Problem> {
    let log = path.display().to_string();
    let refuse = |e: rusqlite::Error| {
        let why = match &e {
            rusqlite::Error::SqliteFailure(_, Some(why)) => why.clone(),
            _ => e.to_string(),
        };
        Problem::new(
            format!("is SQLite, but no recording that can be read: {why}"),
            ALLOWED,
        )
        .at(log.as_str(), 0)
    };
    let mut signals = SignalCollector::default();
    let file =
        Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY).map_err(refuse)?;
    let mut topics = file
        .prepare("SELECT id, name, type, serialization_format FROM topics")
        .map_err(refuse)?;
    let mut rows = topics.query(()).map_err(refuse)?;
    while let Some(row) = rows.next().map_err(refuse)? {
        let text = |k: usize| row.get::<_, String>(k).map_err(refuse);
        let id: i64 = row.get(0).map_err(refuse)?;
        signals.topic(id, &text(1)?, &text(2)?, &text(3)?);
    }
    let mut messages = file
        .prepare("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp")
        .map_err(refuse)?;
    let mut rows = messages.query(()).map_err(refuse)?;
    while let Some(row) = rows.next().map_err(refuse)? {
        let (topic, stamp): (i64, i64) = (row.get(0).map_err(refuse)?, row.get(1).map_err(refuse)?);
        let data = row
            .get_ref(2)
            .and_then(|data| Ok(data.as_blob()?))
            .map_err(refuse)?;
        signals.message(topic, stamp.max(0).unsigned_abs(), data);
    }
    Ok(signals.finish())
}
