//! Reads every record of a running robot, also of the daemon that takes over from one that has ended.

use super::hub::Hub;
use super::row;
use super::scene;
use super::status;
use serde_json::Value;
use std::time::{Duration, Instant};
use torqued_client::robot_state::{Event, SharedRecord};
use torqued_client::{Client, Record};

/// Longest time without a record until the page says so.
const PATIENCE: Duration = Duration::from_millis(500);
/// Interval of the statuses, and the least between two entries for one event: limits may act in every cycle.
const STATUS_INTERVAL: Duration = Duration::from_millis(100);

/// Counts of each event, as they were shown last.
struct Shown {
    counts: Vec<u64>,
    at: Vec<Option<Instant>>,
}

/// Until the process ends.
pub(super) fn read(mut client: Client, hub: &Hub) {
    let (mut lost, mut read) = (0, 0_u64);
    let mut shown: Option<Shown> = None;
    let mut next_status = Instant::now();
    let mut row = Vec::new();
    // Stamps begin anew with another daemon; the page's time does not.
    let (mut shift, mut newest) = (0.0, 0.0);
    loop {
        let record = match client.next_record(PATIENCE) {
            Ok(record) => record,
            Err(error) => {
                hub.tell(&status::without_daemon(&error.to_string()), Vec::new());
                std::thread::sleep(PATIENCE);
                continue;
            }
        };
        (lost, read) = (lost + record.lost, read + 1);
        let stamp = record.cycle.stamp_ns as f64 * 1e-9;
        let began_anew = newest > 0.0 && !(0.0..60.0).contains(&(stamp + shift - newest));
        if began_anew {
            shift = newest + PATIENCE.as_secs_f64() - stamp;
            shown = None;
        } else if read == 1 {
            shift = -stamp;
        }
        newest = stamp + shift;
        row.clear();
        row::append(&mut row, &record, (hub.joints, hub.sensors));
        hub.append(&[newest], &row);
        let now = Instant::now();
        if now >= next_status {
            next_status = now + STATUS_INTERVAL;
            let shown = shown.get_or_insert_with(|| Shown::from(&record));
            let events = shown.new_events(&client, &record, newest, now);
            let status = status::of_record(client.description(), &record, (read, lost), newest);
            hub.tell(&status, events);
        }
    }
}

impl Shown {
    /// What occurred before the page was opened is no news.
    fn from(record: &SharedRecord) -> Self {
        Self {
            counts: record.cycle.events.to_vec(),
            at: vec![None; record.cycle.events.len()],
        }
    }

    fn new_events(&mut self, client: &Client, record: &Record, t: f64, now: Instant) -> Vec<Value> {
        let counts = record.cycle.events.iter().copied().enumerate();
        let mut events = Vec::new();
        for (i, count) in counts {
            let (Some(event), Some(before)) = (Event::ALL.get(i), self.counts.get_mut(i)) else {
                continue;
            };
            let often = !event.reaction().latches();
            let just_shown = self.at[i].is_some_and(|at| now - at < Duration::from_secs(1));
            if count == *before || (often && just_shown) {
                continue;
            }
            let subject = status::subject(client.description(), &record.cycle, *event);
            events.push(scene::event(
                t,
                *event,
                &subject,
                count.saturating_sub(*before),
            ));
            (*before, self.at[i]) = (count, Some(now));
        }
        events
    }
}
