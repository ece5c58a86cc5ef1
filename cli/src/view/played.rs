//! A recorded run, read whole: rows for the page, and what happened.

use super::hub::Hub;
use super::row;
use super::scene::{self, Scene};
use crate::recorded::{self, date, ms_between};
use problem::Problem;
use recording::{CycleMessage, Happening, Span, Timeline};
use serde_json::{Value, json};
use std::path::Path;
use torqued_client::robot_state::Event;

/// Greatest number of rows that the page gets: of a longer run every second, third ... cycle.
const MOST_ROWS: usize = 60_000;

/// Reads the run; at least one cycle must be in it.
pub(super) fn read(path: &Path) -> Result<Hub, Problem> {
    let mut run = recorded::open(path)?;
    let header = run.header().clone();
    let counts = (header.joints.len(), header.sensors.len());
    let mut timeline = Timeline::default();
    let mut rows = Rows::default();
    let mut begin_ns = None;
    let mut last_fault = None;
    let ending = recorded::read_all(path, &mut run, |_, message| {
        let stamp = message.record.cycle.stamp_ns;
        begin_ns.get_or_insert(stamp);
        timeline.observe(message);
        if message.record.cycle.fault != 0 {
            last_fault = Event::from_number(message.record.cycle.fault);
        }
        rows.take(message, counts);
        Ok(())
    })?;
    let Some(begin_ns) = begin_ns else {
        let problem = Problem::new("has no whole cycle", "a recorded run with one");
        return Err(problem.at(path.display().to_string(), 0));
    };
    let name = path.file_name().unwrap_or(path.as_os_str());
    let base = json!({
        "robot": header.robot,
        "rate_hz": 1.0 / header.period_s / rows.every as f64,
        "live": false,
        "control": false,
        "file": name.to_string_lossy(),
        "date": date(&header, begin_ns),
        "every": rows.every,
        "ending": recorded::describe_ending(&ending),
    });
    let drawn = scene::drawn_from_run(&header);
    let seconds = |stamp: u64| ms_between(begin_ns, stamp) * 1e-3;
    let spans = timeline.finish();
    let spans = spans.iter().filter(|span| is_shown(span));
    let events: Vec<Value> = spans
        .map(|span| happening(seconds(span.begin_ns), span, &header))
        .collect();
    let hub = Hub::new(
        Scene::of_run(&header, drawn.as_ref(), base),
        rows.times.len(),
    );
    let times: Vec<f64> = rows.times.iter().map(|stamp| seconds(*stamp)).collect();
    hub.append(&times, &rows.rows);
    let end = times.last().copied().unwrap_or_default();
    let fault = last_fault.map(|event| {
        json!({
            "number": event.number(), "name": event.name(), "cause": event.cause(),
            "config_key": event.config_key(),
        })
    });
    let status = json!({
        "connected": true,
        "t": end,
        "fault": fault,
        "cycles": rows.cycles,
        "records_lost": rows.missing,
    });
    hub.tell(&status, events);
    Ok(hub)
}

/// Limits act all the time; the page shows them with the joint.
fn is_shown(span: &Span) -> bool {
    !matches!(span.what, Happening::Limited(_))
}

fn happening(t: f64, span: &Span, header: &recording::Header) -> Value {
    let names = span.subjects.iter().filter_map(|&j| header.joints.get(j));
    let names: Vec<&str> = names.map(String::as_str).collect();
    let lasted = ms_between(span.begin_ns, span.end_ns) * 1e-3;
    let mut value = match span.what {
        Happening::Event(number) => match Event::from_number(number) {
            Some(event) => scene::event(t, event, &names.join(", "), span.times),
            None => json!({ "t": t, "number": number, "name": "unknown", "times": span.times }),
        },
        _ => json!({ "t": t, "name": span.words(header), "times": span.times }),
    };
    value["lasted_s"] = lasted.into();
    value
}

/// Rows that are thinned out whenever there are too many.
struct Rows {
    every: u64,
    cycles: u64,
    missing: u64,
    last: Option<u64>,
    times: Vec<u64>,
    rows: Vec<f32>,
}

impl Default for Rows {
    fn default() -> Self {
        Self {
            every: 1,
            cycles: 0,
            missing: 0,
            last: None,
            times: Vec::new(),
            rows: Vec::new(),
        }
    }
}

impl Rows {
    fn take(&mut self, message: &CycleMessage, counts: (usize, usize)) {
        let cycle = &message.record.cycle;
        if let Some(last) = self.last {
            self.missing += cycle.sequence.saturating_sub(last + 1);
        }
        self.last = Some(cycle.sequence);
        if self.cycles.is_multiple_of(self.every) {
            if self.times.len() == MOST_ROWS {
                self.thin(row::width(counts.0, counts.1));
            }
            if self.cycles.is_multiple_of(self.every) {
                self.times.push(cycle.stamp_ns);
                row::append(&mut self.rows, &message.record, counts);
            }
        }
        self.cycles += 1;
    }

    /// Keeps every second row.
    fn thin(&mut self, width: usize) {
        self.every *= 2;
        let kept = self.times.len().div_ceil(2);
        for k in 0..kept {
            self.times[k] = self.times[2 * k];
            (self.rows).copy_within(2 * k * width..(2 * k + 1) * width, k * width);
        }
        self.times.truncate(kept);
        self.rows.truncate(kept * width);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_run_is_thinned_out_evenly() {
        let mut rows = Rows::default();
        let mut message = CycleMessage::default();
        for k in 0..150_000 {
            message.record.cycle.sequence = k;
            message.record.cycle.stamp_ns = 7 * k;
            message.record.cycle.mode = (k % 8) as u32;
            rows.take(&message, (0, 0));
        }
        assert_eq!((rows.every, rows.cycles, rows.missing), (4, 150_000, 0));
        assert_eq!(rows.times.len(), 37_500);
        let even = rows.times.iter().enumerate();
        assert!(even.clone().all(|(k, t)| *t == 28 * k as u64));
        let width = row::width(0, 0);
        assert_eq!(rows.rows.len(), 37_500 * width);
        assert!(
            even.clone()
                .all(|(k, _)| rows.rows[k * width + 5] == (4 * k % 8) as f32)
        );
    }
}
