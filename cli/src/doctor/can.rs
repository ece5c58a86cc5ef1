//! CAN: adapters, bit timing, errors, queues, and whether the configuration's frames find room.

use super::finding::{Findings, Fix};
use super::links::{Link, can_interfaces};
use super::machine::Machine;
use crate::check::bus_load::{Bitrate, BusLoad, bus_loads};
use robot_config::{BusParameters, Carrier};

/// Frames that an interface should queue where the configuration is not known.
const QUEUE: u64 = 64;
/// Errors that a counter of the controller shows for a moment after a single disturbance: each error of
/// sending counts 8 (ISO 11898-1).
const DISTURBANCE: u64 = 16;
/// CiA 301 recommends sampling at 87.5 % of a bit, drivers choose 75 to 87.5 % by the bit rate.
const SAMPLE_POINTS: std::ops::RangeInclusive<f64> = 0.7..=0.9;
/// MTU of an interface that carries CAN FD.
const FD_MTU: u64 = 72;

pub(super) fn check(machine: &Machine, findings: &mut Findings) {
    let buses = on_can(machine);
    let present = can_interfaces(&machine.root);
    for (_, name) in &buses {
        if !present.iter().any(|other| other == name) {
            let here = if present.is_empty() {
                "there is none".to_owned()
            } else {
                format!("there are {}", present.join(", "))
            };
            findings.error(
                "can-missing",
                format!("the CAN interface {name} does not exist; {here}"),
                "the daemon does not start",
                if name.starts_with("vcan") {
                    format!("ip link add dev {name} type vcan; ip link set {name} mtu 72 up")
                } else {
                    "plug the adapter in, load its driver (dmesg | grep -i can); \
                              ip link set can0 name NAME renames"
                        .to_owned()
                },
            );
        }
    }
    if present.is_empty() {
        return;
    }
    let links = match Link::all(&machine.root) {
        Ok(links) => links,
        Err(why) => return findings.not_seen(format!("CAN: {why}")),
    };
    for link in links {
        let bus = buses.iter().find(|(_, name)| *name == link.name());
        // An interface of another program is not ours to judge, unless no robot is known.
        if machine.robot.is_some() && bus.is_none() {
            continue;
        }
        one(machine, &link, bus.map(|&(index, _)| index), findings);
    }
}

/// The configuration's CAN interfaces, with their buses' numbers.
fn on_can(machine: &Machine) -> Vec<(usize, String)> {
    let buses = machine
        .robot
        .iter()
        .flat_map(|robot| robot.parameters.buses.iter().enumerate());
    let names = buses.filter_map(|(index, bus)| match &bus.carrier {
        Carrier::SocketCan(name) => Some((index, name.clone())),
        Carrier::UdpMulticast(_) => None,
    });
    names.collect()
}

fn one(machine: &Machine, link: &Link, bus: Option<usize>, findings: &mut Findings) {
    let name = link.name();
    let parameters = bus.and_then(|bus| machine.robot.as_ref()?.parameters.buses.get(bus));
    if !link.is_up() {
        findings.error(
            "can-down",
            format!("{name} is down"),
            "no frame is sent or received",
            format!("ip link set {name} up type can bitrate 1000000 restart-ms 100, with the drives' own bit rate"),
        );
    }
    frames(link, parameters, findings);
    queue(machine, link, bus, findings);
    if link.is_virtual() {
        return;
    }
    controller(link, findings);
    timing(machine, link, bus, findings);
    adapter(machine, name, findings);
}

fn frames(link: &Link, bus: Option<&BusParameters>, findings: &mut Findings) {
    let name = link.name();
    if bus.is_some_and(|bus| bus.fd) && link.mtu() < FD_MTU {
        findings.error(
            "can-fd",
            format!("{name} carries only classic CAN, and its bus has fd = true"),
            "the daemon does not start",
            format!("ip link set {name} down; ip link set {name} up type can bitrate 1000000 dbitrate 5000000 fd on"),
        );
    }
    if link.lost() > 0 {
        findings.warning(
            "can-overrun",
            format!(
                "{name} has lost {} received frames since it is up",
                link.lost()
            ),
            "answers of drives are missing: joints become stale",
            "interrupts of the adapter to a CPU with less work; an adapter with a longer buffer",
        );
    }
}

fn controller(link: &Link, findings: &mut Findings) {
    let name = link.name();
    let cable = "check termination (60 ohm between CAN_H and CAN_L, power off), wiring, ground, and the bit rate of all nodes";
    match link.state() {
        "BUS-OFF" => findings.error(
            "can-bus-off",
            format!("{name} is off the bus after too many errors"),
            "no frame is sent or received",
            format!("{cable}; then ip link set {name} type can restart"),
        ),
        state @ ("ERROR-PASSIVE" | "ERROR-WARNING") => findings.error(
            "can-state",
            format!("{name} is in state {state}"),
            "nobody acknowledges its frames, or the bus is disturbed; the next step is off the bus",
            cable,
        ),
        _ => {
            let [sending, receiving] = link.error_counters();
            if sending.max(receiving) >= DISTURBANCE {
                let what = format!(
                    "{name} has error counters of {sending} (sending) and {receiving} (receiving)"
                );
                findings.warning(
                    "can-errors",
                    what,
                    "frames are sent again and arrive late",
                    cable,
                );
            }
        }
    }
    let (off, passive) = (link.happened("bus_off"), link.happened("error_passive"));
    if off + passive > 0 && link.state() == "ERROR-ACTIVE" {
        findings.warning(
            "can-history",
            format!("{name} was off the bus {off} times and error-passive {passive} times since it is up"),
            "the bus is disturbed now and then, e.g. when drives switch on",
            cable,
        );
    }
    for (mode, why) in [
        ("LISTEN-ONLY", "it acknowledges and sends nothing"),
        ("LOOPBACK", "its frames do not reach the bus"),
        (
            "ONE-SHOT",
            "a frame that loses arbitration is not sent again",
        ),
    ] {
        if link.has_mode(mode) {
            let option = mode.to_lowercase();
            let mend =
                format!("ip link set {name} down; ip link set {name} up type can {option} off");
            findings.error("can-mode", format!("{name} is set to {option}"), why, mend);
        }
    }
    if link.restart_ms() == Some(0) {
        findings.warning(
            "can-restart",
            format!("{name} does not restart by itself (restart-ms 0)"),
            "after one disturbance that takes it off the bus it stays off until somebody restarts it",
            format!("ip link set {name} down; ip link set {name} up type can restart-ms 100"),
        );
    }
}

fn timing(machine: &Machine, link: &Link, bus: Option<usize>, findings: &mut Findings) {
    let name = link.name();
    let Some(rate) = link.bit_rate("bittiming") else {
        findings.error(
            "can-bit-rate",
            format!("{name} has no bit rate"),
            "the interface cannot be started",
            format!(
                "ip link set {name} up type can bitrate 1000000, with the drives' own bit rate"
            ),
        );
        return;
    };
    if let Some(point) = link
        .sample_point()
        .filter(|&point| point > 0.0 && !SAMPLE_POINTS.contains(&point))
    {
        findings.warning(
            "can-sample-point",
            format!("{name} samples at {:.1} % of a bit", 100.0 * point),
            "nodes that sample at different places disturb each other on long cables",
            format!("ip link set {name} down; ip link set {name} up type can bitrate {rate:.0} sample-point 0.875"),
        );
    }
    let (Some(robot), Some(bus)) = (&machine.robot, bus) else {
        return;
    };
    let data = link.bit_rate("data_bittiming").unwrap_or(rate);
    let load = bus_loads(
        robot,
        Bitrate {
            nominal: rate,
            data,
        },
    );
    let Some(BusLoad {
        time: Some(time), ..
    }) = load.get(bus)
    else {
        return;
    };
    let deadline = robot.parameters.timing.gather_deadline;
    let answers = time.answers_s;
    if time.load > 1.0 {
        findings.error(
            "can-load",
            format!(
                "{name}: the frames of a cycle take {:.0} % of it at {rate:.0} bit/s",
                100.0 * time.load
            ),
            "commands and answers pile up and arrive ever later",
            "a higher bit rate, joints on further buses, or a lower loop.rate_hz",
        );
    } else if answers > deadline {
        findings.warning(
            "can-deadline",
            format!(
                "{name}: answers take up to {:.0} us, loop.gather_deadline_us is {:.0}",
                1e6 * answers,
                1e6 * deadline
            ),
            "the last drives' answers miss their cycle",
            "a longer loop.gather_deadline_us, a higher bit rate, or joints on further buses",
        );
    }
}

fn queue(machine: &Machine, link: &Link, bus: Option<usize>, findings: &mut Findings) {
    let robot = machine.robot.as_ref();
    let frames = robot.zip(bus).map(|(robot, bus)| {
        let messages =
            (0..robot.send.message_count()).filter_map(|index| robot.send.message(index));
        // The cycle's own, SYNC and heartbeat, and as many again where the bus is held up for a cycle.
        2 * (messages
            .filter(|message| usize::from(message.bus) == bus)
            .count() as u64
            + 2)
    });
    let needed = frames.unwrap_or(QUEUE);
    if link.queue() >= needed {
        return;
    }
    let name = link.name();
    findings.warning(
        "can-queue",
        format!(
            "{name} queues {} frames, two cycles have {needed}",
            link.queue()
        ),
        "set-points that find no room are lost (event 107 send_failed)",
        format!("ip link set {name} txqueuelen {}", QUEUE.max(needed)),
    );
    let file = format!("/sys/class/net/{name}/tx_queue_len");
    findings.fixed_by(Fix::Write(vec![(file, QUEUE.max(needed).to_string())]));
}

fn adapter(machine: &Machine, name: &str, findings: &mut Findings) {
    let root = &machine.root;
    let device = format!("/sys/class/net/{name}/device");
    let driver = std::fs::read_link(root.path(&format!("{device}/driver"))).ok();
    let driver = driver.as_ref().and_then(|path| path.file_name()?.to_str());
    // A serial line has no device of its own, and a name of its driver's.
    if driver == Some("slcan") || name.starts_with("slcan") {
        findings.warning(
            "can-adapter",
            format!("{name} is an adapter on a serial line (slcan)"),
            "frames wait for milliseconds, and bus errors are not shown",
            "an adapter with a driver of its own: PCI, SPI, or USB with gs_usb (candleLight firmware)",
        );
    }
    // The sysfs folder of a USB adapter is its interface; the settings of power are one above.
    let power = [
        format!("{device}/power/control"),
        format!("{device}/../power/control"),
    ];
    let sleeps: Vec<&String> = power
        .iter()
        .filter(|file| root.text(file) == "auto")
        .collect();
    let is_usb = std::fs::canonicalize(root.path(&device))
        .is_ok_and(|path| path.to_string_lossy().contains("/usb"));
    if is_usb && let Some(file) = sleeps.last() {
        findings.writable(
            "can-power",
            format!("the USB adapter of {name} may be put to sleep"),
            "it takes milliseconds to wake up, and some lose frames",
            vec![((*file).clone(), "on".into())],
        );
    }
}
