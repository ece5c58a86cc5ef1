//! A record for the eye.

use crate::units::cell;
use crate::words;
use std::fmt::Write;
use terminal::TextTable;
use torqued_client::Record;
use torqued_client::robot_state::{
    CycleRecord, Description, LoopRecord, TorqueEstimate, frame_flags, reported_flags, torque_flags,
};
use torqued_client::{why_not_followed, why_refused};

pub(super) fn screen(description: &Description, record: &Record) -> String {
    let cycle = &record.cycle;
    let mut out = format!(
        "{}: cycle {} at {:.0} Hz, {}, mode {}, contact set {}{}\n{}\n\n",
        description.robot,
        cycle.sequence,
        description.rate_hz,
        words::state(cycle.state),
        words::mode(cycle.mode),
        words::contact_set(description, cycle),
        if cycle.estimated.contact_set_automatic == 1 {
            " (automatic)"
        } else {
            ""
        },
        words::fault(description, cycle),
    );
    let possible = words::possible_modes(cycle).join(", ");
    let _ = writeln!(out, "possible modes at present: {possible}\n");
    let _ = writeln!(out, "{}\n", commander(cycle));
    if let Some((event, subject)) = words::warning(description, cycle) {
        let _ = writeln!(
            out,
            "warning {} {} ({subject}): {}",
            event.number(),
            event.name(),
            event.cause()
        );
    }
    let _ = writeln!(out, "{}", joints(description, cycle));
    if let Some(drives) = drives(description, cycle) {
        let _ = writeln!(out, "{drives}");
    }
    if cycle.ft_count > 0 {
        let _ = writeln!(out, "{}", ft_sensors(description, cycle));
    }
    if let Some(frames) = frames(description, cycle) {
        let _ = writeln!(out, "{frames}");
    }
    let _ = write!(
        out,
        "{}\n{}",
        events(&cycle.events),
        timing(&record.timing, cycle.measured.filter_delay_s)
    );
    out
}

/// Who commands, why its references are not followed, and why another client was refused last.
pub(super) fn commander(cycle: &CycleRecord) -> String {
    let lease = &cycle.commander;
    let mut out = match lease.session {
        0 => "commander: none".to_owned(),
        _ => format!(
            "commander: process {}, priority {}, for {:.1} s; {}",
            lease.pid,
            lease.priority,
            cycle.stamp_ns.saturating_sub(lease.since_ns) as f64 * 1e-9,
            match why_not_followed(lease, cycle.state) {
                None => "followed".to_owned(),
                Some(reason) => format!("not followed: {reason}"),
            }
        ),
    };
    if let Some(reason) = why_refused(lease.refused_reason) {
        let _ = write!(
            out,
            "\n{} references refused, the last one because {reason}",
            lease.refused
        );
    }
    out
}

fn joints(description: &Description, cycle: &CycleRecord) -> TextTable {
    let heading = [
        "joint",
        "q deg",
        "encoder N·m",
        "whole-body N·m",
        "tau_hat N·m",
        "desired N·m",
        "commanded N·m",
        "age ms",
        "delay ms",
        "remarks",
    ];
    let mut rows = vec![heading.map(str::to_owned).to_vec()];
    let names = description.joint_names.iter();
    for (j, name) in names.enumerate().take(cycle.joint_count as usize) {
        let measured = &cycle.measured.joints[j];
        let estimated = &cycle.estimated.joints[j];
        let commanded = &cycle.commanded.joints[j];
        let kind = description.joint_kind(j);
        let torque = |text: String| cell(kind, text, "N·m");
        rows.push(vec![
            name.to_string(),
            cell(kind, format!("{:.2}", kind.shown(measured.q)), "deg"),
            torque(estimate(&estimated.tau_encoder)),
            torque(estimate(&estimated.tau_whole_body)),
            torque(estimate(&estimated.tau_hat)),
            torque(format!("{:.2}", commanded.tau_d)),
            torque(format!("{:.2}", commanded.tau_star)),
            format!("{:.1}", measured.age_s * 1e3),
            if commanded.command_delay_sigma_s > 0.0 {
                format!(
                    "{:.1} ±{:.1}",
                    commanded.command_delay_s * 1e3,
                    commanded.command_delay_sigma_s * 1e3
                )
            } else {
                "-".to_owned()
            },
            words::remarks(description, cycle, j),
        ]);
    }
    TextTable(rows)
}

/// What drives report of themselves, and what their heat leaves of the torque; none where none reports anything.
fn drives(description: &Description, cycle: &CycleRecord) -> Option<TextTable> {
    let heading = [
        "drive of",
        "temperature C",
        "supply V",
        "own torque N·m",
        "error",
        "load %",
        "may make N·m",
    ];
    let mut rows = vec![heading.map(str::to_owned).to_vec()];
    let names = description.joint_names.iter().enumerate();
    for (j, name) in names.take(cycle.joint_count as usize) {
        let (measured, estimated) = (&cycle.measured.joints[j], &cycle.estimated.joints[j]);
        if measured.reported == 0 && estimated.thermal_load == 0.0 {
            continue;
        }
        let reported = |bit, text: String| match measured.reported & bit {
            0 => "-".to_owned(),
            _ => text,
        };
        let kind = description.joint_kind(j);
        let torque = |text: String| cell(kind, text, "N·m");
        let limit = cycle.commanded.joints[j].torque_limit;
        rows.push(vec![
            name.to_string(),
            reported(
                reported_flags::TEMPERATURE,
                format!("{:.0}", measured.temperature),
            ),
            reported(reported_flags::VOLTAGE, format!("{:.1}", measured.voltage)),
            torque(reported(
                reported_flags::TORQUE,
                format!("{:.2}", measured.tau_drive),
            )),
            reported(
                reported_flags::ERROR,
                format!("{:#x}", measured.drive_error),
            ),
            format!("{:.0}", 100.0 * estimated.thermal_load),
            torque(format!("{limit:.1}")),
        ]);
    }
    (rows.len() > 1).then_some(TextTable(rows))
}

/// Value and standard deviation, or `-` for one that may not be used.
fn estimate(estimate: &TorqueEstimate) -> String {
    if estimate.flags & torque_flags::VALID == 0 {
        return "-".to_owned();
    }
    format!("{:.2} ±{:5.2}", estimate.tau, estimate.sigma)
}

pub(super) fn ft_sensors(description: &Description, cycle: &CycleRecord) -> TextTable {
    let heading = [
        "F/T sensor",
        "contact force N",
        "torque N·m",
        "age ms",
        "remarks",
    ];
    let mut rows = vec![heading.map(str::to_owned).to_vec()];
    let named = description
        .ft_names
        .iter()
        .zip(&cycle.estimated.ft)
        .zip(&cycle.measured.ft);
    for ((name, estimated), measured) in named.take(cycle.ft_count as usize) {
        let axes = |[x, y, z]: [f64; 3]| format!("{x:.1} {y:.1} {z:.1}");
        rows.push(vec![
            name.to_string(),
            axes(estimated.contact_wrench.force),
            axes(estimated.contact_wrench.torque),
            format!("{:.1}", measured.age_s * 1e3),
            words::measured(measured.flags).join(", "),
        ]);
    }
    TextTable(rows)
}

/// The frames that a client uses.
fn frames(description: &Description, cycle: &CycleRecord) -> Option<TextTable> {
    let heading = [
        "frame",
        "position mm",
        "wrench N, N·m",
        "felt N, N·m",
        "remarks",
    ];
    let mut rows = vec![heading.map(str::to_owned).to_vec()];
    let named = description.frame_names.iter().zip(&cycle.commanded.frames);
    for (name, frame) in named.filter(|(_, frame)| frame.flags & frame_flags::VALID != 0) {
        let numbers = |x: &[f64]| {
            let numbers: Vec<String> = x.iter().map(|x| format!("{x:.1}")).collect();
            numbers.join(" ")
        };
        rows.push(vec![
            name.to_string(),
            numbers(&frame.position.map(|x| 1e3 * x)),
            numbers(&frame.wrench),
            match frame.flags & frame_flags::FORCE_KNOWN {
                0 => "-".to_owned(),
                _ => numbers(&frame.force_estimated),
            },
            words::frame(frame.flags).join(", "),
        ]);
    }
    (rows.len() > 1).then_some(TextTable(rows))
}

fn events(counts: &[u64]) -> String {
    let events: Vec<String> = words::occurred(counts)
        .map(|(event, count)| format!("{} {count}", event.name()))
        .collect();
    if events.is_empty() {
        "events: none".to_owned()
    } else {
        format!("events: {}", events.join(", "))
    }
}

fn timing(timing: &LoopRecord, filter_delay_s: f64) -> String {
    let us = |ns: u64| ns as f64 * 1e-3;
    format!(
        "cycles: {}, late {}, skipped {}; this one woke {:.0} us late, gathered {:.0} us, computed \
         {:.0} us, sent {:.0} us\nframes: {} received, {} sent; filters' delay {:.1} ms",
        timing.cycles,
        timing.late_cycles,
        timing.skipped_cycles,
        us(timing.wake_late_ns),
        us(timing.gather_ns),
        us(timing.compute_ns),
        us(timing.send_ns),
        timing.frames_received,
        timing.frames_sent,
        filter_delay_s * 1e3,
    )
}
