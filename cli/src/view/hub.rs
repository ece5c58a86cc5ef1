//! The last seconds of rows, and what else the page shows, for any number of pages.

use super::scene::Scene;
use serde_json::Value;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Rows of a running robot that are kept: a page that is opened shows so many at once, and one that is
/// slower than this loses none.
const LIVE_ROWS: usize = 10_000;
/// Events that are kept, the newest: a robot may run for weeks.
const EVENTS: usize = 10_000;

/// Meeting place of the thread that reads records and those that serve pages.
pub(super) struct Hub {
    pub(super) joints: usize,
    pub(super) sensors: usize,
    width: usize,
    capacity: usize,
    kept: Mutex<Kept>,
    changed: Condvar,
}

#[derive(Default)]
struct Kept {
    scene: Arc<str>,
    status: Arc<str>,
    status_version: u64,
    events: VecDeque<Value>,
    /// Events ever told.
    told: usize,
    /// Rows ever appended; the newest are kept, each at its count modulo the capacity.
    appended: u64,
    times: Vec<f64>,
    rows: Vec<f32>,
    closed: bool,
}

/// What one page has got so far.
#[derive(Default)]
pub(super) struct Cursor {
    greeted: bool,
    row: u64,
    events: usize,
    status_version: u64,
}

/// What a page has not got yet.
#[derive(Default)]
pub(super) struct News {
    pub(super) scene: Option<Arc<str>>,
    pub(super) status: Option<Arc<str>>,
    pub(super) events: Vec<Value>,
    pub(super) times: Vec<f64>,
    pub(super) rows: Vec<f32>,
    /// Rows that this page was too slow for.
    pub(super) lost: u64,
    pub(super) closed: bool,
}

impl Hub {
    /// Of a running robot.
    pub(super) fn live(scene: Scene) -> Self {
        Self::new(scene, LIVE_ROWS)
    }

    /// That keeps so many rows.
    pub(super) fn new(scene: Scene, capacity: usize) -> Self {
        let width = super::row::width(scene.joints, scene.sensors);
        let kept = Kept {
            scene: scene.json.to_string().into(),
            ..Kept::default()
        };
        Self {
            joints: scene.joints,
            sensors: scene.sensors,
            width,
            capacity: capacity.max(1),
            kept: Mutex::new(kept),
            changed: Condvar::new(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        // A thread that panicked while it held the lock has left whole rows behind.
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Appends rows.
    pub(super) fn append(&self, times: &[f64], rows: &[f32]) {
        let mut kept = self.lock();
        for (t, row) in times.iter().zip(rows.chunks_exact(self.width)) {
            let place = (kept.appended % self.capacity as u64) as usize;
            if place == kept.times.len() {
                kept.times.push(*t);
                kept.rows.extend_from_slice(row);
            } else {
                kept.times[place] = *t;
                let begin = place * self.width;
                kept.rows[begin..begin + self.width].copy_from_slice(row);
            }
            kept.appended += 1;
        }
        drop(kept);
        self.changed.notify_all();
    }

    /// Replaces the status and adds events.
    pub(super) fn tell(&self, status: &Value, events: Vec<Value>) {
        let mut kept = self.lock();
        kept.status = status.to_string().into();
        kept.status_version += 1;
        kept.told += events.len();
        kept.events.extend(events);
        let too_many = kept.events.len().saturating_sub(EVENTS);
        kept.events.drain(..too_many);
        drop(kept);
        self.changed.notify_all();
    }

    /// Lets every page's thread end.
    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// What is new for a page; at most `most` rows at a time. Waits for something new at most `patience`.
    pub(super) fn news(&self, cursor: &mut Cursor, most: usize, patience: Duration) -> News {
        let nothing_new = |kept: &mut Kept| {
            cursor.greeted
                && !kept.closed
                && kept.appended == cursor.row
                && kept.status_version == cursor.status_version
        };
        let waited = (self.changed).wait_timeout_while(self.lock(), patience, nothing_new);
        let (kept, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let mut news = News {
            closed: kept.closed,
            ..News::default()
        };
        if !cursor.greeted {
            cursor.greeted = true;
            news.scene = Some(Arc::clone(&kept.scene));
            cursor.row = kept.appended.saturating_sub(kept.times.len() as u64);
        }
        if cursor.status_version != kept.status_version {
            cursor.status_version = kept.status_version;
            news.status = Some(Arc::clone(&kept.status));
        }
        let new = (kept.told - cursor.events).min(kept.events.len());
        let known = kept.events.len() - new;
        news.events.extend(kept.events.range(known..).cloned());
        cursor.events = kept.told;
        let oldest = kept.appended.saturating_sub(kept.times.len() as u64);
        news.lost = oldest.saturating_sub(cursor.row);
        cursor.row = cursor.row.max(oldest);
        let end = kept.appended.min(cursor.row + most as u64);
        for row in cursor.row..end {
            let place = (row % self.capacity as u64) as usize;
            news.times.push(kept.times[place]);
            let begin = place * self.width;
            news.rows
                .extend_from_slice(&kept.rows[begin..begin + self.width]);
        }
        cursor.row = end;
        news
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use torqued_client::robot_state::Description;

    fn hub(capacity: usize) -> Hub {
        let robot = Description::default();
        Hub::new(Scene::of_robot(&robot, None, false), capacity)
    }

    fn append(hub: &Hub, from: u32, to: u32) {
        for k in from..to {
            hub.append(&[f64::from(k)], &vec![k as f32; hub.width]);
        }
    }

    #[test]
    fn a_page_gets_every_row_once_and_counts_those_it_was_too_slow_for() {
        let hub = hub(100);
        let mut cursor = Cursor::default();
        append(&hub, 0, 10);
        let first = hub.news(&mut cursor, 4, Duration::ZERO);
        assert!(first.scene.is_some());
        assert_eq!(first.times, [0.0, 1.0, 2.0, 3.0]);
        let rest = hub.news(&mut cursor, 100, Duration::ZERO);
        assert!(rest.scene.is_none());
        assert_eq!((rest.times.len(), rest.rows[hub.width * 5]), (6, 9.0));
        append(&hub, 10, 140);
        let late = hub.news(&mut cursor, 1000, Duration::ZERO);
        assert_eq!((late.lost, late.times.len()), (30, 100));
        assert_eq!((late.times[0], late.times[99]), (40.0, 139.0));
        // A page that comes later begins with the oldest row that is kept, and has lost none.
        let newcomer = hub.news(&mut Cursor::default(), 1000, Duration::ZERO);
        assert_eq!((newcomer.lost, newcomer.times[0]), (0, 40.0));
    }

    #[test]
    fn status_and_events_come_once() {
        let hub = hub(10);
        let mut cursor = Cursor::default();
        hub.news(&mut cursor, 1, Duration::ZERO);
        hub.tell(&Value::from("a"), vec![Value::from(1)]);
        let news = hub.news(&mut cursor, 1, Duration::ZERO);
        assert_eq!(
            (news.status.as_deref(), news.events.len()),
            (Some("\"a\""), 1)
        );
        let news = hub.news(&mut cursor, 1, Duration::ZERO);
        assert!(news.status.is_none() && news.events.is_empty());
        hub.close();
        assert!(hub.news(&mut cursor, 1, Duration::from_secs(9)).closed);
    }
}
