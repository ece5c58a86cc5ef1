//! Numbers of a record in words.

use std::borrow::Cow;
use torqued_client::robot_state::{
    CycleRecord, Description, Event, MAX_FURTHER_IMUS, Mode, RobotState, command_flags,
    frame_flags, measured_flags, torque_flags, torque_source,
};

const MEASURED: &[(u32, &str)] = &[
    (measured_flags::MISSED, "missed"),
    (measured_flags::STALE, "stale"),
    (measured_flags::JUMP, "jump"),
    (measured_flags::NEVER, "never"),
    (measured_flags::SETTLING, "settling"),
    (measured_flags::IMPLAUSIBLE, "implausible"),
    (measured_flags::FLAT, "flat"),
    (measured_flags::SATURATED, "saturated"),
    (measured_flags::STANDS_IN, "stands_in"),
];
const TORQUE: &[(u32, &str)] = &[
    (torque_flags::VALID, "valid"),
    (torque_flags::SATURATED, "saturated"),
    (torque_flags::DEGRADED, "degraded"),
];
const COMMAND: &[(u32, &str)] = &[
    (command_flags::POSITION_LIMITED, "position_limited"),
    (command_flags::TORQUE_LIMITED, "torque_limited"),
    (command_flags::LEAD_LIMITED, "lead_limited"),
    (command_flags::VELOCITY_LIMITED, "velocity_limited"),
    (command_flags::TORQUE_RATE_LIMITED, "torque_rate_limited"),
    (command_flags::POWER_LIMITED, "power_limited"),
    (command_flags::NOT_FINITE, "not_finite"),
    (command_flags::ENGAGED, "engaged"),
    (command_flags::RATE_TRIMMED, "rate_trimmed"),
];

const FRAME: &[(u32, &str)] = &[
    (frame_flags::ACTIVE, "active"),
    (frame_flags::WRENCH_LIMITED, "wrench_limited"),
    (frame_flags::GAINS_LIMITED, "gains_limited"),
    (frame_flags::FORCE_KNOWN, "force_known"),
    (frame_flags::LED, "led"),
];

/// The cross-check's warning that stands, and the joint or sensor that it is about.
pub(crate) fn warning<'a>(
    description: &'a Description,
    cycle: &CycleRecord,
) -> Option<(Event, &'a str)> {
    let event = Event::from_number(cycle.estimated.warning)?;
    let of_sensor = matches!(event, Event::FtDrift | Event::MissingContact);
    let names: &[_] = if of_sensor {
        &description.ft_names
    } else {
        &description.joint_names
    };
    let name = names.get(cycle.estimated.warning_subject as usize);
    Some((event, name.map_or("?", |name| name.as_str())))
}

/// The name of the contact set in use.
pub(crate) fn contact_set<'a>(description: &'a Description, cycle: &CycleRecord) -> &'a str {
    let names = description.contact_set_names.iter();
    let mut names = names.take(description.contact_set_count as usize);
    let name = names.nth(cycle.estimated.contact_set as usize);
    name.map_or("?", |name| name.as_str())
}

pub(crate) fn measured(flags: u32) -> Vec<String> {
    words(flags, MEASURED)
}

pub(crate) fn torque(flags: u32) -> Vec<String> {
    words(flags, TORQUE)
}

pub(crate) fn command(flags: u32) -> Vec<String> {
    words(flags, COMMAND)
}

/// Of a frame that is shown.
pub(crate) fn frame(flags: u32) -> Vec<String> {
    words(flags & !frame_flags::VALID, FRAME)
}

/// The names of the bits that are set; one that has no name shows as its number.
fn words(flags: u32, names: &[(u32, &str)]) -> Vec<String> {
    let bits = (0..u32::BITS)
        .map(|i| 1 << i)
        .filter(|bit| flags & bit != 0);
    bits.map(|bit| {
        let name = names.iter().find(|(named, _)| *named == bit);
        name.map_or_else(|| format!("bit_{bit:#x}"), |(_, name)| (*name).to_owned())
    })
    .collect()
}

/// Everything about a joint that an operator should notice.
pub(crate) fn remarks(description: &Description, cycle: &CycleRecord, joint: usize) -> String {
    let estimated = &cycle.estimated.joints[joint];
    let mut remarks = measured(cycle.measured.joints[joint].flags);
    for (estimate, of) in [
        (&estimated.tau_encoder, "encoder"),
        (&estimated.tau_whole_body, "whole-body"),
    ] {
        let flags = estimate.flags & !torque_flags::VALID;
        remarks.extend(torque(flags).iter().map(|word| format!("{of} {word}")));
    }
    remarks.extend(command(cycle.commanded.joints[joint].flags));
    if estimated.contact_flag == 1 {
        let unit = description.joint_kind(joint).units("N·m");
        remarks.push(format!(
            "contact: external torque {:.1} {unit}, changed by {:.1} {unit}",
            estimated.tau_ext, estimated.tau_ext_change
        ));
    }
    remarks.join(", ")
}

pub(crate) fn mode(number: u32) -> String {
    Mode::from_number(number)
        .map_or_else(|| format!("mode_{number}"), |mode| mode.name().to_owned())
}

pub(crate) fn source(number: u32) -> String {
    match number {
        torque_source::NONE => "none".to_owned(),
        torque_source::ENCODER => "encoder".to_owned(),
        torque_source::WHOLE_BODY => "whole_body".to_owned(),
        torque_source::CURRENT => "current".to_owned(),
        torque_source::FUSED => "fused".to_owned(),
        other => format!("source_{other}"),
    }
}

/// The events that have occurred, with how often.
pub(crate) fn occurred(counts: &[u64]) -> impl Iterator<Item = (&'static Event, u64)> {
    let counted = Event::ALL.iter().zip(counts.iter().copied());
    counted.filter(|(_, count)| *count > 0)
}

pub(crate) fn state(number: u32) -> String {
    RobotState::from_number(number).map_or_else(
        || format!("state_{number}"),
        |state| state.name().to_owned(),
    )
}

/// The latched fault, its subject, cause and config key, in a sentence.
pub(crate) fn fault(description: &Description, cycle: &CycleRecord) -> String {
    let number = cycle.fault;
    match Event::from_number(number) {
        None if number == 0 => "no fault".to_owned(),
        None => format!("FAULT {number}: not known to this version of torquectl"),
        Some(event) => format!(
            "FAULT {number} {}{}: {} Set by {}.",
            event.name(),
            fault_subject(description, cycle)
                .map_or_else(String::new, |subject| format!(" ({subject})")),
            event.cause(),
            config_key(description, cycle, event),
        ),
    }
}

/// The key of the configuration that sets the latched fault's threshold, with the units of its joint.
pub(crate) fn config_key(
    description: &Description,
    cycle: &CycleRecord,
    event: Event,
) -> Cow<'static, str> {
    let (kind, index) = (cycle.fault_subject >> 16, cycle.fault_subject & 0xffff);
    match kind {
        1 => description
            .joint_kind(index as usize)
            .units(event.config_key()),
        _ => Cow::Borrowed(event.config_key()),
    }
}

/// IMUs, in config order.
const IMUS: [&str; 1 + MAX_FURTHER_IMUS] = ["imu", "second imu", "third imu", "fourth imu"];

/// The joint or sensor that the latched fault is about, by its name.
pub(crate) fn fault_subject<'a>(
    description: &'a Description,
    cycle: &CycleRecord,
) -> Option<&'a str> {
    let (kind, index) = (cycle.fault_subject >> 16, cycle.fault_subject & 0xffff);
    let names: &[_] = match kind {
        1 => &description.joint_names,
        2 => &description.ft_names,
        3 => return IMUS.get(index as usize).copied(),
        _ => return None,
    };
    names.get(index as usize).map(|name| name.as_str())
}

/// The modes that the sources allow at present.
pub(crate) fn possible_modes(cycle: &CycleRecord) -> Vec<&'static str> {
    let possible = |mode: &Mode| cycle.possible_modes & (1 << mode.number()) != 0;
    let modes = Mode::ALL.into_iter().filter(possible);
    modes.map(Mode::name).collect()
}
