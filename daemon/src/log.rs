//! Messages: to the journal with their fields where systemd reads them, else to standard error with time and level.
//!
//! The loop's thread writes none: what it finds out is numbered events in its records.

use std::collections::HashMap;
use std::fmt;
use std::os::fd::AsFd;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use jiff::Timestamp;
use nix::sys::stat::fstat;
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;
use tracing_subscriber::util::SubscriberInitExt;

/// Messages of one place in the program within [`WINDOW`]; further ones are counted and left out.
const MOST: u32 = 10;
const WINDOW: Duration = Duration::from_secs(1);

/// From now on messages go where they belong. To be called once, by the program.
pub fn start() {
    let journal = is_journal(std::env::var("JOURNAL_STREAM").ok().as_deref());
    let journal = journal.then(tracing_journald::layer).and_then(Result::ok);
    let terminal = journal.is_none().then(|| {
        let lines = tracing_subscriber::fmt::layer().event_format(Line);
        lines.with_writer(std::io::stderr)
    });
    let layers = tracing_subscriber::registry()
        .with(Limiter::default())
        .with(journal)
        .with(terminal);
    // Only a second call can fail: then the first one's places hold.
    let _ = layers.try_init();
}

/// Standard error is the journal's own stream: systemd.exec(5) says so by device and inode.
fn is_journal(stream: Option<&str>) -> bool {
    let numbers = stream.and_then(|text| {
        let (device, inode) = text.split_once(':')?;
        Some((device.parse::<u64>().ok()?, inode.parse::<u64>().ok()?))
    });
    let own = fstat(std::io::stderr().as_fd());
    own.is_ok_and(|own| numbers == Some((own.st_dev, own.st_ino)))
}

/// `TIME LEVEL MESSAGE`; fields are for the journal, and the message has them in words.
struct Line;

impl<S, N> FormatEvent<S, N> for Line
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        _: &FmtContext<'_, S, N>,
        mut out: Writer<'_>,
        event: &Event<'_>,
    ) -> fmt::Result {
        let mut message = Message(String::new());
        event.record(&mut message);
        let level = *event.metadata().level();
        line(&mut out, Timestamp::now(), level, &message.0)
    }
}

fn line(out: &mut impl fmt::Write, now: Timestamp, level: Level, message: &str) -> fmt::Result {
    writeln!(out, "{now:.3} {level:5} {message}")
}

/// The message among an event's fields.
struct Message(String);

impl tracing::field::Visit for Message {
    fn record_debug(&mut self, field: &tracing::field::Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}");
        }
    }
}

/// Keeps a message that comes over and over from filling the disk.
#[derive(Default)]
struct Limiter(Mutex<HashMap<(&'static str, u32), Window>>);

/// Messages of one place.
struct Window {
    began: Instant,
    count: u32,
}

impl Limiter {
    /// Whether a message of that place is let through now.
    fn admits(&self, place: (&'static str, u32), now: Instant) -> bool {
        let mut windows = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let window = windows.entry(place).or_insert(Window {
            began: now,
            count: 0,
        });
        if now.duration_since(window.began) >= WINDOW {
            *window = Window {
                began: now,
                count: 0,
            };
        }
        window.count += 1;
        window.count <= MOST
    }
}

impl<S: Subscriber> Layer<S> for Limiter {
    fn event_enabled(&self, event: &Event<'_>, _: Context<'_, S>) -> bool {
        let metadata: &Metadata<'static> = event.metadata();
        // A fault is always said.
        let place = (
            metadata.file().unwrap_or_default(),
            metadata.line().unwrap_or_default(),
        );
        *metadata.level() == Level::ERROR || self.admits(place, Instant::now())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_time_and_level() {
        let mut text = String::new();
        let time = Timestamp::from_millisecond(1_764_140_400_123).expect("a time");
        line(&mut text, time, Level::WARN, "state: holding").expect("written");
        assert_eq!(text, "2025-11-26T07:00:00.123Z WARN  state: holding\n");
    }

    #[test]
    fn a_message_that_comes_over_and_over_is_left_out_until_the_next_second() {
        let limiter = Limiter::default();
        let now = Instant::now();
        let admitted = |at: Instant| (0..100).filter(|_| limiter.admits(("a.rs", 7), at)).count();
        assert_eq!(admitted(now), MOST as usize);
        assert!(
            limiter.admits(("a.rs", 8), now),
            "other places have their own"
        );
        assert_eq!(admitted(now + WINDOW), MOST as usize);
    }

    #[test]
    fn only_the_journals_own_stream_is_the_journal() {
        assert!(!is_journal(None));
        assert!(!is_journal(Some("1:2")));
        assert!(!is_journal(Some("a")));
        let own = fstat(std::io::stderr().as_fd()).expect("standard error");
        assert!(is_journal(Some(&format!("{}:{}", own.st_dev, own.st_ino))));
    }
}
