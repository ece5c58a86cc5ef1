//! CAN interfaces as the kernel lists them, and their conditions for the start of the loop.

use super::Line;
use problem::{Problem, Problems};
use std::fmt::Write as _;
use std::path::Path;

/// Bytes that a CAN FD interface takes at once; a classic one takes 16.
const FD_MTU: u32 = 72;
/// `ARPHRD_CAN`: the type of a CAN interface.
const TYPE_CAN: u32 = 280;
/// `IFF_UP`.
const FLAG_UP: u32 = 1;

/// A network interface.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Interface {
    pub(super) name: String,
    pub(super) index: i32,
    is_can: bool,
    up: bool,
    mtu: u32,
}

/// Every network interface, by name. `root` is `/sys/class/net` but in tests.
pub(super) fn list(root: &Path) -> Vec<Interface> {
    let Ok(entries) = std::fs::read_dir(root) else {
        return Vec::new();
    };
    let mut found: Vec<_> = entries
        .flatten()
        .filter_map(|entry| read(&entry.path()))
        .collect();
    found.sort_by(|a, b| a.name.cmp(&b.name));
    found
}

fn read(path: &Path) -> Option<Interface> {
    let text = |file: &str| std::fs::read_to_string(path.join(file)).ok();
    let number = |file: &str| text(file)?.trim().parse::<u32>().ok();
    let flags = text("flags")?;
    let flags = u32::from_str_radix(flags.trim().trim_start_matches("0x"), 16).ok()?;
    Some(Interface {
        name: path.file_name()?.to_str()?.to_owned(),
        index: i32::try_from(number("ifindex")?).ok()?,
        is_can: number("type")? == TYPE_CAN,
        up: flags & FLAG_UP != 0,
        mtu: number("mtu")?,
    })
}

/// The interface of each line, or every obstacle to opening the buses.
pub(super) fn match_lines(
    lines: &[Line<'_>],
    found: &[Interface],
) -> Result<Vec<Interface>, Problems> {
    let mut refusals = Vec::new();
    let mut taken: Vec<Interface> = Vec::new();
    for line in lines {
        match check(line, found) {
            Ok(interface) if taken.iter().any(|other| other.index == interface.index) => {
                let reason = format!("{} already belongs to another bus", line.interface);
                let problem = Problem::new(reason, "one bus for each interface");
                refusals.push(problem.of(line.place));
            }
            Ok(interface) => taken.push(interface.clone()),
            Err(refusal) => refusals.push(refusal),
        }
    }
    if refusals.is_empty() {
        Ok(taken)
    } else {
        Err(Problems(refusals))
    }
}

fn check<'a>(line: &Line<'_>, found: &'a [Interface]) -> Result<&'a Interface, Problem> {
    let Line {
        place,
        interface,
        fd,
    } = *line;
    let refuse = |reason: String| Err(Problem::new(reason, "").of(place));
    let Some(it) = found.iter().find(|it| it.name == interface) else {
        return refuse(format!(
            "{interface} does not exist; {}; a virtual one is made by `ip link add \
             dev {interface} type vcan && ip link set {interface} mtu 72 up`",
            here(found)
        ));
    };
    if !it.is_can {
        return refuse(format!(
            "{interface} is not a CAN interface; {}",
            here(found)
        ));
    }
    if fd && it.mtu < FD_MTU {
        return refuse(format!(
            "{interface} carries only classic CAN (MTU {}) and the bus has fd = \
             true; `ip link set {interface} down`, then for hardware `ip link set {interface} up \
             type can bitrate 1000000 dbitrate 5000000 fd on`, for a virtual one `ip link set \
             {interface} mtu 72 up`; or fd = false",
            it.mtu
        ));
    }
    if !it.up {
        let bit_rates = if fd {
            "bitrate 1000000 dbitrate 5000000 fd on"
        } else {
            "bitrate 1000000"
        };
        return refuse(format!(
            "{interface} is down; for hardware `ip link set {interface} up type can \
             {bit_rates}`, for a virtual one `ip link set {interface} up`"
        ));
    }
    Ok(it)
}

/// The CAN interfaces that exist, as text.
fn here(found: &[Interface]) -> String {
    let mut text = String::new();
    for it in found.iter().filter(|it| it.is_can) {
        let comma = if text.is_empty() { "" } else { ", " };
        let state = if it.up { "" } else { " (down)" };
        let _ = write!(text, "{comma}{}{state}", it.name);
    }
    if text.is_empty() {
        "there is no CAN interface here".to_owned()
    } else {
        format!("CAN interfaces here: {text}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn interface(name: &str, index: i32, is_can: bool, up: bool, mtu: u32) -> Interface {
        Interface {
            name: name.to_owned(),
            index,
            is_can,
            up,
            mtu,
        }
    }

    fn line<'a>(interface: &'a str, fd: bool) -> Line<'a> {
        Line {
            place: "robot.toml:7: bus.interface (a)",
            interface,
            fd,
        }
    }

    fn refusal(line: Line<'_>) -> String {
        let found = [
            interface("can0", 3, true, true, 16),
            interface("can1", 4, true, false, 72),
            interface("eth0", 2, false, true, 1500),
        ];
        match_lines(&[line], &found).unwrap_err().to_string()
    }

    #[test]
    fn refusals_name_bus_and_interface_and_the_way_out() {
        let text = refusal(line("can7", false));
        assert!(text.starts_with("robot.toml:7: bus.interface (a): can7 does not exist"));
        assert!(
            text.contains("CAN interfaces here: can0, can1 (down)"),
            "{text}"
        );
        assert!(text.contains("ip link add dev can7 type vcan"), "{text}");
        let text = refusal(line("eth0", false));
        assert!(text.contains("not a CAN interface"), "{text}");
        let text = refusal(line("can1", false));
        assert!(
            text.contains("is down") && text.contains("ip link set can1 up"),
            "{text}"
        );
        let text = refusal(line("can0", true));
        assert!(
            text.contains("MTU 16") && text.contains("fd = false"),
            "{text}"
        );
    }

    #[test]
    fn lines_get_their_interfaces_in_order_and_each_only_once() {
        let found = [
            interface("can0", 3, true, true, 72),
            interface("can1", 4, true, true, 72),
        ];
        let taken = match_lines(&[line("can1", true), line("can0", false)], &found).unwrap();
        assert_eq!([taken[0].index, taken[1].index], [4, 3]);
        let twice = match_lines(&[line("can1", true), line("can1", false)], &found).unwrap_err();
        assert!(twice.to_string().contains("another bus"));
    }

    #[test]
    fn the_kernels_files_are_read() {
        let root = std::env::temp_dir().join(format!("torqued-interfaces-{}", std::process::id()));
        for (name, kind, flags) in [("vcan0", "280\n", "0xc1\n"), ("lo", "772\n", "0x9\n")] {
            let folder = root.join(name);
            std::fs::create_dir_all(&folder).unwrap();
            for (file, text) in [
                ("type", kind),
                ("flags", flags),
                ("mtu", "72\n"),
                ("ifindex", "5\n"),
            ] {
                std::fs::write(folder.join(file), text).unwrap();
            }
        }
        // Entries that are no interfaces (as `bonding_masters`) are passed over.
        std::fs::write(root.join("bonding_masters"), "").unwrap();
        let found = list(&root);
        std::fs::remove_dir_all(&root).unwrap();
        let expected = [
            interface("lo", 5, false, true, 72),
            interface("vcan0", 5, true, true, 72),
        ];
        assert_eq!(found, expected);
    }
}
