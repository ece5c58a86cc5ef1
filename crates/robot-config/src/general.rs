//! `[robot] [loop] [[bus]] [control] [cross_check]`.

use crate::parameters::{
    BusParameters, Carrier, CrossCheckSettings, FastTorqueFeedback, ModeSettings, MotionSettings,
    RealTime, Timing, TorqueFeedback, TorqueLaw, UdpGroup,
};
use crate::reader::{Allowed, Diagnostics, Section};
use crate::{Read, paths, unreadable};
use core::net::Ipv4Addr;
use dynamics::Base;

/// Names that a [`robot_state::Name`] can hold.
const NAME: &str = "a name of 1 to 48 letters, digits, _ or -";

/// `[robot]`.
pub(crate) struct Named {
    pub(crate) name: String,
    pub(crate) urdf_path: String,
    pub(crate) base: Base,
}

/// `[control]`.
pub(crate) struct Feedback {
    pub(crate) torque_law: TorqueLaw,
    /// Time from a sample until the drives have the command computed from it, s.
    pub(crate) command_delay: f64,
    pub(crate) k_f: f64,
    pub(crate) motion: MotionSettings,
    pub(crate) modes: ModeSettings,
}

/// What `bus.dbc` takes.
pub(crate) const DBC: &str = "the path of a DBC file, relative to this file, or a list";

/// What `bus.sync` takes.
pub(crate) const SYNC: &str = "the name of the message that starts a cycle";

/// `[[bus]]`.
pub(crate) struct Bus {
    pub(crate) place: usize,
    /// Its key `dbc` is there; only a bus of nodes may lack it, and `sync`.
    pub(crate) has_dbc: bool,
    pub(crate) has_sync: bool,
    pub(crate) parameters: BusParameters,
    pub(crate) sync: String,
    pub(crate) sync_place: usize,
    pub(crate) dbc_places: Vec<usize>,
    pub(crate) constants: Vec<Constant>,
}

/// A signal of a sent message that no key of a joint sets.
pub(crate) struct Constant {
    /// `MESSAGE.signal`.
    pub(crate) signal: String,
    /// In the DBC file's unit.
    pub(crate) value: f64,
    pub(crate) place: usize,
}

pub(crate) fn robot(root: &Section<'_, '_>, config: &str) -> Option<Named> {
    let section = root.section("robot")?;
    let name = name(&section, "name");
    let urdf = section.text("urdf", "the path of a URDF file, relative to this file");
    let base = section.choice(
        "base",
        &[("fixed", Base::Fixed), ("floating", Base::Floating)],
    );
    section.finish();
    Some(Named {
        name,
        urdf_path: paths::resolved(config, urdf?.value),
        base,
    })
}

/// A name that fits into a record; empty if a problem was noted.
pub(crate) fn name(section: &Section<'_, '_>, key: &'static str) -> String {
    let Some(name) = section.text(key, NAME).map(|text| text.value) else {
        return String::new();
    };
    let fine = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if name.len() > 48 || !name.chars().all(fine) {
        section.problem(key, format!("{name:?} is not allowed"), NAME);
    }
    name.to_owned()
}

/// Longest time for which a robot may follow the last reference of a client that has vanished, ms.
const LONGEST_REFERENCE_TIMEOUT_MS: f64 = 1000.0;

pub(crate) fn timing(root: &Section<'_, '_>) -> Timing {
    let mut timing = Timing {
        sample_period: f64::NAN,
        gather_deadline: f64::NAN,
        stale_after: f64::NAN,
        reference_timeout: f64::NAN,
        real_time: RealTime::Try,
        priority: 80,
        cpu: None,
    };
    let Some(section) = root.section("loop") else {
        return timing;
    };
    timing.sample_period = 1.0 / section.number("rate_hz", Allowed::Within(1.0, 10_000.0));
    // While the rate is unknown the other keys are checked against the lowest rate.
    let period = if timing.sample_period.is_nan() {
        1.0
    } else {
        timing.sample_period
    };
    let us = section.number("gather_deadline_us", Allowed::Positive);
    if us * 1e-6 >= period {
        let allowed = format!("above 0 and below the period of {} us", period * 1e6);
        section.problem(
            "gather_deadline_us",
            format!("{us} is not allowed"),
            allowed,
        );
    }
    timing.gather_deadline = us * 1e-6;
    // While the rate is unknown, the highest one counts.
    let period_ms = if timing.sample_period.is_nan() {
        0.1
    } else {
        period * 1e3
    };
    let limit_ms = |key, default_ms, periods, most_ms| {
        let allowed = Allowed::Within(periods * period_ms, most_ms);
        section.number_or(key, default_ms, allowed) * 1e-3
    };
    timing.stale_after = limit_ms("stale_after_ms", 20.0, 1.0, 10_000.0);
    // Two periods: a client that sends one reference for each cycle is not lost by its jitter.
    let most_ms = LONGEST_REFERENCE_TIMEOUT_MS;
    timing.reference_timeout = limit_ms("reference_timeout_ms", 40.0, 2.0, most_ms);
    let choices = [("try", RealTime::Try), ("require", RealTime::Require)];
    timing.real_time = section.choice_or("real_time", RealTime::Try, &choices);
    timing.priority = section.optional_integer("priority", 1..100).unwrap_or(80) as u8;
    timing.cpu = section
        .optional_integer("cpu", 0..1024)
        .map(|cpu| cpu as usize);
    section.finish();
    timing
}

pub(crate) fn buses(root: &Section<'_, '_>, config: &str) -> Vec<Bus> {
    const MAX_BUSES: usize = 32;
    let sections = root.list("bus");
    if sections.is_empty() || sections.len() > MAX_BUSES {
        let what = format!("{} buses are not allowed", sections.len());
        root.problem("bus", what, format!("1 to {MAX_BUSES} tables [[bus]]"));
    }
    let mut buses = Vec::<Bus>::new();
    for mut section in sections {
        let name = name(&section, "name");
        section.which = format!(" ({name})");
        let taken = |other: &str, own: &str| !own.is_empty() && other == own;
        if buses.iter().any(|bus| taken(&bus.parameters.name, &name)) {
            section.problem("name", "a second bus has this name", "a name for each bus");
        }
        let carrier = carrier(&section);
        if let Some(first) = buses.first() {
            check_carrier(&section, &carrier, &first.parameters.carrier);
        }
        if buses
            .iter()
            .any(|bus| is_shared(&bus.parameters.carrier, &carrier))
        {
            let what = format!("a second bus is on {carrier}");
            let (key, allowed) = match carrier {
                Carrier::SocketCan(_) => ("interface", "one bus for each interface"),
                Carrier::UdpMulticast(_) => ("port", "one bus for each pair of group and port"),
            };
            let allowed = format!("{allowed}; it may list several DBC files");
            section.problem(key, what, allowed);
        }
        let (has_dbc, has_sync) = (section.has("dbc"), section.has("sync"));
        let dbcs = if has_dbc {
            section.texts("dbc", DBC)
        } else {
            Vec::new()
        };
        let sync = section.optional_text("sync", SYNC);
        let fd = section.flag_or("fd", false);
        buses.push(Bus {
            place: section.place(),
            has_dbc,
            has_sync,
            parameters: BusParameters {
                name,
                carrier,
                interface_place: section.place_of("interface"),
                dbc_paths: dbcs
                    .iter()
                    .map(|dbc| paths::resolved(config, dbc.value))
                    .collect(),
                fd,
            },
            sync: sync
                .as_ref()
                .map_or_else(String::new, |sync| sync.value.to_owned()),
            sync_place: sync.map_or_else(|| section.place(), |sync| sync.place),
            dbc_places: dbcs.iter().map(|dbc| dbc.place).collect(),
            constants: section
                .list("constants")
                .into_iter()
                .map(constant)
                .collect(),
        });
        section.finish();
    }
    buses
}

fn constant(section: Section<'_, '_>) -> Constant {
    let signal = section.text("signal", "MESSAGE.signal");
    let constant = Constant {
        value: section.number("value", Allowed::Finite),
        place: signal
            .as_ref()
            .map_or_else(|| section.place(), |text| text.place),
        signal: signal.map_or_else(String::new, |text| text.value.to_owned()),
    };
    section.finish();
    constant
}

/// Carrier of the bus's frames.
fn carrier(section: &Section<'_, '_>) -> Carrier {
    if !section.choice_or(
        "kind",
        false,
        &[("socketcan", false), ("udp_multicast", true)],
    ) {
        let interface = section.text("interface", INTERFACE);
        return Carrier::SocketCan(interface.map_or_else(String::new, |text| {
            check_interface(section, text.value);
            text.value.to_owned()
        }));
    }
    let interface = section.optional_text("interface", INTERFACE);
    if let Some(text) = &interface {
        check_interface(section, text.value);
    }
    Carrier::UdpMulticast(UdpGroup {
        group: group(section),
        port: section
            .optional_integer("port", 1..65_536)
            .map_or(UDP_PORT, |port| port as u16),
        interface: interface.map(|text| text.value.to_owned()),
        hop_limit: section.optional_integer("hop_limit", 0..256).unwrap_or(0) as u8,
    })
}

const INTERFACE: &str = "1 to 15 bytes without space, / or :, as can0 or vcan0";

/// Notes a name that Linux does not accept for a network interface.
fn check_interface(section: &Section<'_, '_>, name: &str) {
    let bad = |c: char| c.is_whitespace() || c.is_control() || c == '/' || c == ':';
    if name.len() > 15 || name == "." || name == ".." || name.chars().any(bad) {
        let what = format!("{name:?} is no name of an interface");
        section.problem("interface", what, INTERFACE);
    }
}

/// python-can's IPv4 group and port.
const UDP_GROUP: Ipv4Addr = Ipv4Addr::new(239, 74, 163, 2);
const UDP_PORT: u16 = 43_113;

fn group(section: &Section<'_, '_>) -> Ipv4Addr {
    const ALLOWED: &str = "an IPv4 multicast address, 224.0.1.0 to 239.255.255.255";
    let Some(text) = section.optional_text("group", ALLOWED) else {
        return UDP_GROUP;
    };
    // 224.0.0.0/24 belongs to routing protocols and is never filtered by switches.
    let may_be = |group: &Ipv4Addr| group.is_multicast() && group.octets()[..3] != [224, 0, 0];
    let group = text.value.parse().ok().filter(may_be);
    if group.is_none() {
        section.problem("group", format!("{:?} is not allowed", text.value), ALLOWED);
    }
    group.unwrap_or(UDP_GROUP)
}

fn check_carrier(section: &Section<'_, '_>, carrier: &Carrier, first: &Carrier) {
    if core::mem::discriminant(carrier) != core::mem::discriminant(first) {
        let what = "the buses of this robot are of two kinds";
        section.problem("kind", what, "the kind of the first [[bus]]");
    }
}

/// Frames of one would reach the other.
fn is_shared(one: &Carrier, other: &Carrier) -> bool {
    match (one, other) {
        (Carrier::SocketCan(one), Carrier::SocketCan(other)) => !one.is_empty() && one == other,
        (Carrier::UdpMulticast(one), Carrier::UdpMulticast(other)) => {
            (one.group, one.port) == (other.group, other.port)
        }
        _ => false,
    }
}

pub(crate) fn feedback(root: &Section<'_, '_>, sample_period: f64) -> Feedback {
    use FastTorqueFeedback::{DelayCompensated, Levelled, Torsion};
    use TorqueFeedback::{Encoder, WholeBody};
    let mut feedback = Feedback {
        torque_law: TorqueLaw::ProportionalIntegral(Encoder),
        command_delay: sample_period,
        k_f: 0.0,
        motion: MotionSettings {
            velocity: 0.25,
            acceleration: 0.05,
            jerk_time: 0.2,
        },
        modes: ModeSettings {
            passive_damping: 0.005,
            low_stiffness: 0.05,
            low_damping: 0.2,
        },
    };
    if let Some(section) = root.section("control") {
        let laws = [("proportional_integral", false), ("predictive", true)];
        feedback.torque_law = if section.choice_or("law", false, &laws) {
            let choices = [
                ("torsion", Torsion),
                ("levelled", Levelled),
                ("tau_hat", DelayCompensated),
            ];
            TorqueLaw::Predictive(section.choice("torque_feedback", &choices))
        } else {
            let choices = [("encoder", Encoder), ("whole_body", WholeBody)];
            TorqueLaw::ProportionalIntegral(section.choice("torque_feedback", &choices))
        };
        let longest = 8e6 * sample_period;
        let us = section.number_or(
            "command_delay_us",
            1e6 * sample_period,
            Allowed::Within(0.0, longest),
        );
        feedback.command_delay = 1e-6 * us;
        feedback.k_f = section.number_or("K_f", 0.0, Allowed::NonNegative);
        let share = |key, default| {
            0.01 * section.number_or(key, 100.0 * default, Allowed::Within(1.0, 100.0))
        };
        let motion = &mut feedback.motion;
        motion.velocity = share("motion_velocity_per_cent", motion.velocity);
        motion.acceleration = share("motion_acceleration_per_cent", motion.acceleration);
        let ms = Allowed::Within(1.0, 10_000.0);
        motion.jerk_time = 1e-3 * section.number_or("motion_jerk_ms", 1e3 * motion.jerk_time, ms);
        let per_cent = |key, default, least, most| {
            let allowed = Allowed::Within(100.0 * least, 100.0 * most);
            0.01 * section.number_or(key, 100.0 * default, allowed)
        };
        let modes = &mut feedback.modes;
        let damping = modes.passive_damping;
        modes.passive_damping = per_cent("passive_damping_per_cent", damping, 0.0, 0.5);
        let stiffness = modes.low_stiffness;
        modes.low_stiffness = per_cent("low_gain_stiffness_per_cent", stiffness, 0.001, 1.0);
        // With less damping than stiffness a joint swings.
        let (least, damping) = (modes.low_stiffness, modes.low_damping);
        let damping = damping.max(least);
        modes.low_damping = per_cent("low_gain_damping_per_cent", damping, least, 1.0);
        section.finish();
    }
    feedback
}

/// `[cross_check]`.
pub(crate) fn cross_check(root: &Section<'_, '_>) -> Option<CrossCheckSettings> {
    let section = root.optional_section("cross_check")?;
    let positive = |key, default| section.number_or(key, default, Allowed::Positive);
    let settings = CrossCheckSettings {
        encoder_share: 0.01 * positive("encoder_per_cent", 4.0),
        current_load_share: 0.01 * positive("current_load_per_cent", 12.0),
        current_ratio: [
            positive("current_ratio_min", 0.6),
            positive("current_ratio_max", 1.5),
        ],
        residual_ratio: positive("residual_sigmas", 8.0),
        average: positive("average_s", 0.25),
        hold: positive("hold_s", 0.4),
    };
    if settings.current_ratio[0] >= 1.0 || settings.current_ratio[1] <= 1.0 {
        let what =
            "the range of the ratio of the current's torque to the others' does not contain 1";
        section.problem(
            "current_ratio_min",
            what,
            "current_ratio_min < 1 < current_ratio_max",
        );
    }
    section.finish();
    Some(settings)
}

/// The text of a file that the section names.
pub(crate) fn read_file(
    diagnostics: &Diagnostics<'_>,
    root: &Section<'_, '_>,
    key: &'static str,
    path: &str,
    read: Read<'_>,
) -> Option<String> {
    read(path)
        .map_err(|error| {
            let section = root.optional_section(key);
            let named_in = section.map_or_else(String::new, |section| section.path("urdf"));
            let mut problem = unreadable(path, &error);
            problem.reason.push_str(&format!(" ({named_in})"));
            diagnostics.note(problem);
        })
        .ok()
}
