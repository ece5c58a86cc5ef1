//! A black box as text, JSON and CSV.

use super::analysis::{BlackBox, Fault};
use crate::recorded::{date, describe_ending, ms_between};
use crate::units::{cell, keys};
use crate::words;
use recording::Span;
use serde_json::{Value, json};
use std::fmt::Write;
use terminal::TextTable;
use torqued_client::robot_state::DriveState;

pub(crate) fn text(black_box: &BlackBox) -> String {
    let mut out = headline(black_box);
    let (zero, end) = match black_box.fault {
        Fault::Latched(_) => ("the fault", "the fault"),
        Fault::LoopEnded => ("the end", "the end"),
        Fault::Before(_) | Fault::None => ("the begin", "the end"),
    };
    if let Fault::Latched(_) | Fault::LoopEnded = black_box.fault {
        let _ = writeln!(out, "first: {}", first(black_box));
    }
    let _ = writeln!(out, "\ntime line, ms from {zero}");
    out += &timeline(black_box).to_string();
    let _ = writeln!(out, "\njoints at {end}");
    out += &joints(black_box).to_string();
    out += &describe_ending(&black_box.ending);
    out
}

/// Which fault the recording shows, when, and why; or that it shows none.
fn headline(black_box: &BlackBox) -> String {
    let header = &black_box.header;
    let at = format!(
        "{}, cycle {}",
        date(header, black_box.zero_ns),
        black_box.cycle
    );
    let Some(event) = black_box.fault.event() else {
        let [begin_ns, end_ns] = black_box.range_ns;
        return format!(
            "{}: no fault in this recording, from {at}, on for {:.3} s\n",
            header.robot,
            ms_between(begin_ns, end_ns) * 1e-3
        );
    };
    let when = match black_box.fault {
        Fault::Before(_) => format!("latched before this recording began: {at}"),
        _ => at,
    };
    format!(
        "{}: FAULT {} {}, {when}\n{}\nconfig key: {}\n",
        header.robot,
        event.number(),
        event.name(),
        event.cause(),
        event.config_key(),
    )
}

/// The first cause, in a sentence.
fn first(black_box: &BlackBox) -> String {
    let Some(cause) = &black_box.cause else {
        return "nothing that came in before it; see the time line".to_owned();
    };
    let mut text = format!(
        "{}, {:.1} ms before the fault",
        cause.words(&black_box.header),
        ms_between(cause.begin_ns, black_box.zero_ns)
    );
    let good = cause
        .subjects
        .iter()
        .filter_map(|&joint| *black_box.good_ns.get(joint)?);
    if let Some(good_ns) = good.min().filter(|_| of_joint(cause)) {
        let before = ms_between(good_ns, black_box.zero_ns);
        let _ = write!(text, " (last good sample {before:.1} ms before it)");
    }
    text
}

/// Its subjects are joints.
fn of_joint(span: &Span) -> bool {
    use recording::Happening::{ErrorFrames, SensorFlag};
    !matches!(span.what, ErrorFrames | SensorFlag(_))
}

fn timeline(black_box: &BlackBox) -> TextTable {
    let heading = ["ms", "lasted", "times", "what"]
        .map(str::to_owned)
        .to_vec();
    let rows = black_box.spans.iter().map(|span| {
        vec![
            format!("{:.1}", ms_between(black_box.zero_ns, span.begin_ns)),
            lasted(span).map_or_else(|| "-".to_owned(), |ms| format!("{ms:.0}")),
            span.times.to_string(),
            span.words(&black_box.header),
        ]
    });
    TextTable(std::iter::once(heading).chain(rows).collect())
}

/// Duration, ms; none if it was there in one cycle alone.
fn lasted(span: &Span) -> Option<f64> {
    (span.end_ns > span.begin_ns).then(|| ms_between(span.begin_ns, span.end_ns))
}

fn joints(black_box: &BlackBox) -> TextTable {
    let heading = [
        "joint",
        "q deg",
        "dq rad/s",
        "tau_hat N·m",
        "sigma",
        "last good ms",
        "drive",
        "status",
        "flags",
        "command",
    ];
    let record = &black_box.record;
    let measured = record.measured.joints.iter().zip(&record.estimated.joints);
    let rows = black_box
        .header
        .joints
        .iter()
        .zip(measured.zip(&record.commanded.joints));
    let rows = rows
        .enumerate()
        .map(|(j, (name, ((measured, estimated), commanded)))| {
            let good_ns = black_box.good_ns.get(j).copied().flatten();
            let kind = black_box.header.kind(j);
            vec![
                name.clone(),
                cell(kind, format!("{:.2}", kind.shown(measured.q)), "deg"),
                cell(kind, format!("{:.3}", measured.dq), "rad/s"),
                cell(kind, format!("{:.2}", estimated.tau_hat.tau), "N·m"),
                cell(kind, format!("{:.2}", estimated.tau_hat.sigma), "N·m"),
                good_ns.map_or_else(
                    || "none".to_owned(),
                    |good_ns| format!("{:.1}", ms_between(black_box.zero_ns, good_ns)),
                ),
                drive(commanded.drive_state).to_owned(),
                format!("{:#06x}", measured.status),
                words::measured(measured.flags).join(" "),
                words::command(commanded.flags).join(" "),
            ]
        });
    let heading = heading.map(str::to_owned).to_vec();
    TextTable(std::iter::once(heading).chain(rows).collect())
}

fn drive(number: u32) -> &'static str {
    DriveState::from_number(number).map_or("unknown", DriveState::name)
}

pub(crate) fn json(black_box: &BlackBox) -> Value {
    let header = &black_box.header;
    let span = |span: &Span| {
        json!({
            "ms": ms_between(black_box.zero_ns, span.begin_ns),
            "lasted_ms": lasted(span).unwrap_or(0.0),
            "times": span.times,
            "cycle": span.cycle,
            "input": span.what.is_input(),
            "what": span.words(header),
        })
    };
    let record = &black_box.record;
    let joints = header.joints.iter().enumerate().map(|(j, name)| {
        let measured = &record.measured.joints[j];
        let estimated = &record.estimated.joints[j];
        let good_ns = black_box.good_ns.get(j).copied().flatten();
        let object = json!({
            "name": name,
            "q_rad": measured.q,
            "dq_rad_per_s": measured.dq,
            "tau_hat_Nm": estimated.tau_hat.tau,
            "tau_hat_sigma_Nm": estimated.tau_hat.sigma,
            "last_good_sample_ms": good_ns.map(|ns| ms_between(black_box.zero_ns, ns)),
            "drive": drive(record.commanded.joints[j].drive_state),
            "status": measured.status,
            "flags": words::measured(measured.flags),
            "command": words::command(record.commanded.joints[j].flags),
        });
        keys(header.kind(j), object)
    });
    json!({
        "robot": header.robot,
        "fault": black_box.fault.event().map(|event| json!({
            "number": event.number(),
            "name": event.name(),
            "cause": event.cause(),
            "config_key": event.config_key(),
            "cycle": black_box.cycle,
            "date": date(header, black_box.zero_ns),
            "latched_before_the_recording": matches!(black_box.fault, Fault::Before(_)),
        })),
        "first": black_box.cause.as_ref().map(span),
        "timeline": black_box.spans.iter().map(span).collect::<Vec<_>>(),
        "joints": joints.collect::<Vec<_>>(),
        "from_ms": ms_between(black_box.zero_ns, black_box.range_ns[0]),
        "to_ms": ms_between(black_box.zero_ns, black_box.range_ns[1]),
        "ending": describe_ending(&black_box.ending).trim_end(),
    })
}

/// The time line as CSV.
pub(crate) fn csv(black_box: &BlackBox) -> String {
    let mut out = "time_ms,lasted_ms,times,cycle,what\n".to_owned();
    for span in &black_box.spans {
        let _ = writeln!(
            out,
            "{:.3},{:.3},{},{},\"{}\"",
            ms_between(black_box.zero_ns, span.begin_ns),
            lasted(span).unwrap_or(0.0),
            span.times,
            span.cycle,
            span.words(&black_box.header).replace('"', "\"\"")
        );
    }
    out
}
