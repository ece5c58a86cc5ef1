//! The robot's state in words, ten times a second.

use crate::{state, words};
use serde_json::{Value, json};
use torqued_client::robot_state::{CycleRecord, Description, Event, SharedRecord};
use torqued_client::why_not_followed;

/// Of a daemon that gives no records.
pub(super) fn without_daemon(why: &str) -> Value {
    json!({ "connected": false, "why": why })
}

/// Of a record; `t`: its time on the page.
pub(super) fn of_record(
    description: &Description,
    record: &SharedRecord,
    (read, lost): (u64, u64),
    t: f64,
) -> Value {
    let cycle = &record.cycle;
    let mut status = state::object(description, cycle);
    let lease = &cycle.commander;
    let commander = (lease.session != 0).then(|| {
        json!({
            "pid": lease.pid,
            "priority": lease.priority,
            "not_followed": why_not_followed(lease, cycle.state),
            "motion_left_s": lease.motion_left_s,
        })
    });
    let warning = words::warning(description, cycle).map(|(event, subject)| {
        json!({ "number": event.number(), "name": event.name(), "cause": event.cause(), "subject": subject })
    });
    let joints = 0..description.joint_count as usize;
    let remarks = joints.map(|joint| words::remarks(description, cycle, joint));
    status["connected"] = true.into();
    status["t"] = t.into();
    status["commander"] = commander.into();
    status["warning"] = warning.into();
    status["remarks"] = remarks.collect::<Vec<_>>().into();
    status["contact_set"] = words::contact_set(description, cycle).into();
    status["late_cycles"] = record.timing.late_cycles.into();
    status["skipped_cycles"] = record.timing.skipped_cycles.into();
    status["records_read"] = read.into();
    status["records_lost"] = lost.into();
    status
}

/// What an event is about, where the record still shows it.
pub(super) fn subject(description: &Description, cycle: &CycleRecord, event: Event) -> String {
    if cycle.fault == event.number() {
        return words::fault_subject(description, cycle)
            .unwrap_or_default()
            .to_owned();
    }
    match words::warning(description, cycle) {
        Some((warning, subject)) if warning == event => subject.to_owned(),
        _ => String::new(),
    }
}
