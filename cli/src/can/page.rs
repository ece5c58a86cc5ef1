//! Drives that a scan has found, as text.

use super::Target;
use drives::scan::Found;
use terminal::TextTable;

/// Facts that name a device.
const IDENTITY: [&str; 7] = [
    "name", "vendor", "product", "revision", "serial", "firmware", "network",
];

/// One line for each device.
pub(super) fn scan(target: &Target, found: &[Found], notes: &[String]) -> String {
    if found.is_empty() {
        return ended(
            "Nobody answered: power, bit rate, termination? CubeMars actuators are not asked.\n",
            notes,
        );
    }
    let heading = [
        "bus", "node", "family", "joint", "state", "error", "identity",
    ];
    let mut rows = vec![heading.map(str::to_owned).to_vec()];
    for device in found {
        let facts = device
            .facts
            .iter()
            .filter(|(name, _)| IDENTITY.contains(name));
        let mut identity: Vec<_> = facts
            .map(|(name, value)| format!("{name} {value}"))
            .collect();
        identity.extend(device.reply.map(|id| format!("answers to {id:#x}")));
        rows.push(vec![
            bus(target, device),
            device.node.to_string(),
            device.family.to_owned(),
            target.joint(device).unwrap_or("-").to_owned(),
            device.state.unwrap_or("-").to_owned(),
            device.error.clone().unwrap_or_else(|| "-".to_owned()),
            identity.join(", "),
        ]);
    }
    ended(&format!("{}", TextTable(rows)), notes)
}

/// All that each says.
pub(super) fn show(target: &Target, found: &[Found], notes: &[String]) -> String {
    if found.is_empty() {
        return ended("Nobody answered under that identifier.\n", notes);
    }
    let mut text = String::new();
    for device in found {
        let joint = target.joint(device).map(|name| format!(", joint {name}"));
        let joint = joint.unwrap_or_default();
        text += &format!(
            "{} {} on {}{joint}\n",
            device.family,
            device.node,
            bus(target, device)
        );
        let mut rows = vec![vec!["what".to_owned(), "value".to_owned()]];
        let mut row = |name: &str, value: &str| rows.push(vec![name.to_owned(), value.to_owned()]);
        row("state", device.state.unwrap_or("not reported"));
        row("error", device.error.as_deref().unwrap_or("none"));
        if let Some(reply) = device.reply {
            row("reply_id", &format!("{reply:#x}"));
        }
        for (name, value) in device.facts.iter().filter(|(name, _)| *name != "reply_id") {
            row(name, value);
        }
        text += &format!("{}", TextTable(rows));
    }
    ended(&text, notes)
}

fn bus(target: &Target, device: &Found) -> String {
    target.buses[usize::from(device.bus)].name.clone()
}

fn ended(text: &str, notes: &[String]) -> String {
    let mut all = text.to_owned();
    for note in notes {
        all += &format!("note: {note}\n");
    }
    all
}
