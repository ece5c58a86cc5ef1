//! Cause of a fault.

use robot_state::{DriveState, Event, command_flags, measured_flags};

use super::{Happening, JOIN_NS, Span};

/// The happening that led to a fault: the earliest of those that this fault comes from and that
/// lasted until it was latched; the fault's own event if there is none.
#[must_use]
pub fn cause_of<'s>(spans: &'s [Span], fault: &Span) -> Option<&'s Span> {
    let Happening::Fault(number) = fault.what else {
        return None;
    };
    let event = Event::from_number(number)?;
    let lasted = |span: &&Span| {
        span.begin_ns <= fault.begin_ns && fault.begin_ns.saturating_sub(span.end_ns) <= JOIN_NS
    };
    let concerned = if fault.subjects.is_empty() {
        subjects_of(spans, fault, event)
    } else {
        fault.subjects.clone()
    };
    let leads = |span: &&Span| {
        let own = concerned.is_empty() || span.subjects.iter().any(|s| concerned.contains(s));
        leads_to(span.what, event) && (span.subjects.is_empty() || own)
    };
    let earliest = spans
        .iter()
        .filter(lasted)
        .filter(leads)
        .min_by_key(|span| span.begin_ns);
    let own = |span: &&Span| span.what == Happening::Event(number);
    earliest.or_else(|| spans.iter().filter(lasted).find(own))
}

/// The joints that a fault is about.
fn subjects_of(spans: &[Span], fault: &Span, event: Event) -> Vec<usize> {
    let decisive = |what: Happening| match event {
        Event::JointStale => what == Happening::JointFlag(measured_flags::STALE),
        Event::EncoderImplausible => what == Happening::JointFlag(measured_flags::IMPLAUSIBLE),
        Event::CommandNotFinite => what == Happening::Limited(command_flags::NOT_FINITE),
        Event::DriveFault => {
            matches!(what, Happening::DriveState(_, to) if to == DriveState::Fault.number())
        }
        Event::DriveLost => {
            let enabled = DriveState::Enabled.number();
            matches!(what, Happening::DriveState(from, to) if from == enabled && to != enabled)
        }
        _ => false,
    };
    let near = |span: &&Span| {
        span.begin_ns <= fault.begin_ns && fault.begin_ns.saturating_sub(span.end_ns) <= JOIN_NS
    };
    let decisive = spans.iter().filter(near).filter(|span| decisive(span.what));
    decisive
        .flat_map(|span| span.subjects.iter().copied())
        .collect()
}

/// Whether that may lead to the fault.
fn leads_to(what: Happening, event: Event) -> bool {
    use Happening::{DriveState, ErrorFrames, JointFlag, Limited, Skipped, StatusWord};
    match event {
        Event::JointStale => {
            let flags = measured_flags::MISSED | measured_flags::STALE;
            matches!(what, JointFlag(bit) if bit & flags != 0) || what == ErrorFrames
        }
        Event::EncoderImplausible => {
            let flags = measured_flags::JUMP | measured_flags::IMPLAUSIBLE;
            matches!(what, JointFlag(bit) if bit & flags != 0)
        }
        Event::CommandNotFinite => matches!(what, Limited(command_flags::NOT_FINITE)),
        Event::DriveFault | Event::DriveLost => {
            matches!(what, StatusWord(..) | DriveState(..) | ErrorFrames)
        }
        Event::BusDown | Event::SendFailing => {
            let sending = Happening::Event(Event::SendFailed.number());
            what == ErrorFrames || what == sending
        }
        Event::LatenessLasts => {
            let late = Happening::Event(Event::LateCycle.number());
            what == late || matches!(what, Skipped(_))
        }
        _ => false,
    }
}
